"""The figure of docs/evidence/virtual-boundaries.md, from its table.

    python studies/evidence/virtual_boundaries_picture.py
"""

import sys
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.patches import Rectangle

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "tests" / "twins"))

from reduced_domains import CAMERA, HALF, SHAPE, WIDTH, true_mesh, user_mesh  # noqa: E402

from idic.images import dense_speckle  # noqa: E402
from idic.virtual_tests import Sensor, clean_image, painted  # noqa: E402

BLUE, ORANGE, GREY = "#0072b2", "#d55e00", "#8c959f"
FULL = ("full", "full, log 1 % off")


def main() -> None:
    """Reduced domain on the reference image; error of the parameters by route, with the scatter of one test."""
    figure, axes = plt.subplots(1, 3, figsize=(11.5, 3.9), width_ratios=(1.1, 1.0, 1.0), layout="constrained")
    _draw_domain(axes[0])
    rows = table(ROOT / "docs" / "evidence" / "virtual-boundaries.md")
    routes = list(dict.fromkeys(row["route"] for row in rows))
    for axis, name in zip(axes[1:], ("E", "nu"), strict=True):
        for shift, case, marker in ((-0.13, "strip", "s"), (0.13, "plate", "o")):
            for row in (row for row in rows if row["case"] == case):
                axis.errorbar(row[name], routes.index(row["route"]) + shift, xerr=row[f"{name} scatter"], fmt=marker,
                              color=ORANGE if row["route"] in FULL else BLUE, capsize=3, ms=5)
        axis.axvline(0.0, color=GREY, lw=0.8)
        axis.set(yticks=range(len(routes)), yticklabels=routes if name == "E" else [], ylim=(len(routes) - 0.5, -0.5),
                 xlabel=f"error of {name} [%]")
        axis.grid(axis="x", alpha=0.3)
    axes[2].plot([], [], "s", color=GREY, label="strip")
    axes[2].plot([], [], "o", color=GREY, label="plate with a hole")
    axes[2].legend(fontsize=8, loc="upper left")
    figure.savefig(ROOT / "docs" / "evidence" / "virtual-boundaries.png", dpi=110)


def table(page: Path) -> list[dict]:
    """The rows of the page's table: case, route, and per parameter the mean error and the scatter in percent."""
    rows = []
    for line in page.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("| ").split("|")]
        if cells[0] in ("strip", "plate"):
            number = [float(cell.split()[0]) for cell in cells[4:8]]
            rows.append({"case": cells[0], "route": cells[1], "E": number[0], "E scatter": number[1], "nu": number[2],
                         "nu scatter": number[3]})
    return rows


def _draw_domain(axis) -> None:
    mesh = true_mesh("plate")
    texture = painted(dense_speckle(np.random.default_rng(11), 1.6, 20.0, 235.0, extent_px=400.0), CAMERA)
    image = clean_image(np.zeros_like(mesh.nodes), mesh.nodes, mesh.blocks, CAMERA, texture,
                        Sensor(SHAPE, background=25.0, supersampling=1))
    axis.imshow(image, cmap="gray", vmax=330)
    for is_whole, colour in ((True, ORANGE), (False, BLUE)):
        mesh = user_mesh("plate", is_whole)
        outline = mesh.blocks[0].connectivity[:, [0, 4, 1, 5, 2, 6, 3, 7, 0]]
        for cell in CAMERA.project(mesh.nodes)[outline]:
            axis.plot(*cell.T, color=colour, lw=1.0 if is_whole else 1.2)
    for side in (-HALF, HALF):
        ends = CAMERA.project(np.array([[side, -WIDTH / 2], [side, WIDTH / 2]]))
        axis.plot(*ends.T, color=BLUE, lw=4, solid_capstyle="butt")
    axis.add_patch(Rectangle((-0.5, -0.5), SHAPE[1], SHAPE[0], fill=False, color="k", lw=1.0))
    axis.set(xlim=(-45, SHAPE[1] + 45), ylim=(SHAPE[0] + 20, -20), xticks=[], yticks=[])
    axis.set_title("reduced domain (blue), whole specimen (orange)", fontsize=9)


if __name__ == "__main__":
    main()
