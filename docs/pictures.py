"""Picture a recorded flight as Rerun shows it; no display is needed, software Vulkan suffices.

python docs/pictures.py jacksboro.mcap docs

writes `rerun.png`, the whole window, and `scene.png`, the scene alone. Debian and Ubuntu have
software Vulkan in the package mesa-vulkan-drivers.
"""

import subprocess
import sys
from pathlib import Path
from socket import socket
from tempfile import TemporaryDirectory
from time import monotonic, sleep

import numpy as np
import rerun_cli
from rerun.experimental import ViewerClient

from orchestrator.recording.provenance import EPOCH_NS
from orchestrator.recording.reader import Recording
from orchestrator.viewing.rrd import TIMELINE, write_rrd

SIZE = "1600x900"
INSTANT_S = 24.0
PATIENCE_S, REST_S = 60.0, 8.0  # until the viewer answers; until it has read and drawn


def pictures(recording: Path, folder: Path) -> None:
    """Write the pictures of a recording."""
    with TemporaryDirectory() as scratch:
        rrd = Path(scratch) / "flight.rrd"
        write_rrd(Recording.open(recording), rrd)
        with socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        # the program itself: ending the script `rerun` would leave it running
        program = Path(rerun_cli.__file__).with_name("rerun")
        viewer = [
            program, "--headless", "--window-size", SIZE, "--renderer", "vulkan",
            "--bind", "127.0.0.1", "--port", f"{port}", "--hide-welcome-screen", rrd,
        ]  # fmt: skip
        with subprocess.Popen(viewer, stderr=subprocess.DEVNULL) as process:  # noqa: S603
            try:
                _shoot(_connected(f"rerun+http://127.0.0.1:{port}/proxy"), folder)
            finally:
                process.terminate()


def _connected(address: str) -> ViewerClient:
    end = monotonic() + PATIENCE_S
    while True:
        try:
            return ViewerClient.connect(address)
        except Exception:  # whatever it is, until it has lasted too long
            if monotonic() > end:
                raise
            sleep(0.5)


def _shoot(client: ViewerClient, folder: Path) -> None:
    sleep(REST_S)
    instant = np.datetime64(EPOCH_NS + round(INSTANT_S * 1e9), "ns")
    client.set_time(TIMELINE, timestamp=instant, play_state="paused")
    sleep(REST_S)
    (folder / "rerun.png").write_bytes(client.take_screenshot())
    for view in client.get_state().views:
        if view.name == "scene":
            (folder / "scene.png").write_bytes(client.take_screenshot(view.view_id))


if __name__ == "__main__":
    pictures(Path(sys.argv[1]), Path(sys.argv[2]))
