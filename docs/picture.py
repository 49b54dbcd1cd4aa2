"""Draw a recorded flight: course over the terrain, height profile with the plans, height error.

python docs/picture.py jacksboro.mcap docs/flight.png
"""

import sys
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LightSource

from orchestrator.recording.reader import Recording
from plant.terrain import Terrain, TerrainParameters

SCENARIOS = Path(__file__).parents[1] / "scenarios"
INK, FLOWN, PLANNED, GROUND = "#1b1b1e", "#0b6e99", "#e8a33d", "#8a7f6d"


def draw(recording: Recording, terrain: Terrain, picture: Path) -> None:
    """Write the picture of a flight over a terrain."""
    _, north = recording["vehicle.pose.north"]
    east, altitude = recording["vehicle.pose.east"][1], -recording["vehicle.pose.down"][1]
    ground = altitude - recording["vehicle.clearance"][1]
    s = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(north), np.diff(east)))])
    _, path_n = recording["mpc.path.north"]
    _, path_e = recording["mpc.path.east"]
    _, path_d = recording["mpc.path.down"]

    figure = plt.figure(figsize=(11, 6.6), constrained_layout=True)
    grid = figure.add_gridspec(3, 1, height_ratios=[1.35, 1.5, 0.75])
    chart, profile, error = (figure.add_subplot(cell) for cell in grid)

    n = np.linspace(north.min() - 60, north.max() + 60, 700)
    e = np.linspace(east.min() - 190, east.max() + 190, 260)
    h = terrain.elevation(*np.meshgrid(n, e, indexing="ij")).T
    shade = LightSource(225, 40).shade(h, plt.get_cmap("terrain"), vert_exag=3, blend_mode="soft",
                                       vmin=h.min() - 160, vmax=h.max() + 120)  # fmt: skip
    chart.imshow(shade, extent=(n[0], n[-1], e[0], e[-1]), origin="lower", aspect="equal")
    chart.invert_yaxis()  # east to the right of north, as on any map
    chart.plot(north, east, color="white", lw=3)
    chart.plot(north, east, color=FLOWN, lw=1.6)
    chart.set(xlabel="north (m)", ylabel="east (m)")
    chart.set_title(
        "Across the Jacksboro fault at 30 m/s, 10 m above ground", loc="left", color=INK
    )

    profile.fill_between(s, ground, ground.min() - 25, color=GROUND, lw=0)
    profile.plot(s, altitude, color=FLOWN, lw=4, alpha=0.45, label="flown")
    for k in range(0, len(path_n), 4):
        near = int(np.argmin(np.hypot(north - path_n[k][0], east - path_e[k][0])))
        along = s[near] + np.concatenate(
            [[0.0], np.cumsum(np.hypot(np.diff(path_n[k]), np.diff(path_e[k])))]
        )
        inside = along < s[-1]
        profile.plot(along[inside], -path_d[k][inside], color=PLANNED, lw=0.9,
                     label="plans, every 2 s" if k == 0 else None)  # fmt: skip
    profile.set(
        ylabel="altitude (m)", xlim=(0, s[-1]), ylim=(ground.min() - 25, altitude.max() + 25)
    )
    profile.legend(frameon=False, ncols=3, loc="upper center")

    error.plot(s, recording["vehicle.clearance"][1], color=FLOWN, lw=1.2)
    error.axhline(10.0, color=INK, lw=0.7, ls=":")
    error.set(xlabel="distance flown (m)", ylabel="height above\nground (m)")
    error.set(xlim=(0, s[-1]), ylim=(9, 11))
    for axes in (chart, profile, error):
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    draw(
        Recording.open(sys.argv[1]),
        Terrain(TerrainParameters(file=SCENARIOS / "terrain" / "jacksboro.npz")),
        Path(sys.argv[2]),
    )
