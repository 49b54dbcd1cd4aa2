"""Picture a recorded flight as Rerun shows it, without a display: software Vulkan suffices.

python docs/pictures.py jacksboro.mcap docs 24

Debian and Ubuntu have it in the package mesa-vulkan-drivers.
"""

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from time import sleep

import numpy as np
from rerun.experimental import ViewerClient

from orchestrator.recording.provenance import EPOCH_NS
from orchestrator.recording.reader import Recording
from orchestrator.viewing.rrd import TIMELINE, write_rrd

PORT = 19876
SIZE = "1600x900"


def picture(recording: Path, out: Path, time_s: float) -> None:
    """Write a screenshot of a recording at an instant."""
    with TemporaryDirectory() as folder:
        rrd = Path(folder) / "flight.rrd"
        write_rrd(Recording.open(recording), rrd)
        viewer = [
            Path(sys.executable).with_name("rerun"), "--headless", "--window-size", SIZE,
            "--renderer", "vulkan", "--port", f"{PORT}", "--hide-welcome-screen", rrd,
        ]  # fmt: skip
        with subprocess.Popen(viewer) as process:
            try:
                _shoot(out, time_s)
            finally:
                process.wait(timeout=20)


def _shoot(out: Path, time_s: float) -> None:
    for attempt in range(60):
        sleep(1.0)
        try:
            client = ViewerClient.connect(f"rerun+http://127.0.0.1:{PORT}/proxy")
            break
        except Exception:
            if attempt == 59:
                raise
    sleep(12)
    instant = np.datetime64(EPOCH_NS + round(time_s * 1e9), "ns")
    client.set_time(TIMELINE, timestamp=instant, play_state="paused")
    sleep(6)
    client.save_screenshot(str(out))
    client.quit()


if __name__ == "__main__":
    picture(Path(sys.argv[1]), Path(sys.argv[2]), float(sys.argv[3]))
