"""Planned tests on the polycarbonate strip: which of them would tell its parameters best (`idic design`)?

Four folders without images: the test as published, one whose speed changes tenfold, one that is compressed first (it
would need guides against buckling), and one with a notch. All are pulled to the same elongation and recorded in the
same number of frames.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from string import Template

import numpy as np

from idic.fe import Mesh
from idic.virtual_tests import IMAGES, empty_folder, write_inp
from idic_studies.examples.polycarbonate import FORCE_NOISE_N, FULL, VISIBLE_LEFT_OF_MIDDLE_MM, REDUCED, TOML, Size
from idic_studies.examples.polycarbonate_model import DURATION_S, GRIP_SPEED_MM_PER_S, WIDTH, model_toml, strip_mesh

ELONGATION = GRIP_SPEED_MM_PER_S * DURATION_S  # mm
NOISE_GV = 1.22  # 1 % of the pattern
NOTCH_RADIUS, NOTCH_DEPTH = 8.0, 3.0  # mm, on either edge
COMPRESSION_MM = 3.0  # mm: 6 %, beyond yield
SPEED_FACTOR = 10.0
WHAT = """\
# A planned test of a polycarbonate strip, as `idic example polycarbonate-plans` writes it; there are no images yet.
# $what
# Try:  idic design ../*"""
PLAN = """
[design]
image_px = [$columns, $rows]
n_frames = $frames
speckle_px = 5.0
contrast_gv = 60.0
[design.program]
grip_displacement_mm = $course   # [time in s, mm]
"""


@dataclass(frozen=True)
class PlannedStrip:
    """One test: its folder's name, its special feature, course of the grip ((s, mm), ...), with a notch or not."""

    name: str
    what: str
    course: tuple[tuple[float, float], ...]
    notched: bool = False


PLANS = (
    PlannedStrip("published", "Pulled at 1e-3/s.", ((0.0, 0.0), (DURATION_S, ELONGATION))),
    PlannedStrip("two-rates", "Pulled at 1e-3/s, and ten times as fast in its second half.",
                 ((0.0, 0.0), (0.5 * DURATION_S, 0.5 * ELONGATION),
                  (0.5 * DURATION_S + 0.5 * DURATION_S / SPEED_FACTOR, ELONGATION))),
    PlannedStrip("compressed-first", "Compressed by 6 % (with guides against buckling), then pulled, at 1e-3/s.",
                 ((0.0, 0.0), (COMPRESSION_MM / GRIP_SPEED_MM_PER_S, -COMPRESSION_MM),
                  (2.0 * COMPRESSION_MM / GRIP_SPEED_MM_PER_S + DURATION_S, ELONGATION))),
    PlannedStrip("notched", "Notches of 8 mm radius, 3 mm deep, in both edges; pulled at 1e-3/s.",
                 ((0.0, 0.0), (DURATION_S, ELONGATION)), notched=True),
)


def write_polycarbonate_plans(out: Path | str, reduced: bool, noise: float | None, seed: int, foreign: bool) -> Path:
    """Write the folders of all `PLANS` into `out`; noise : over the contrast of the pattern. Returns `out`.

    Planned tests have no images: `seed` and `foreign` change nothing.

    Raises
    ------
    InputError
        A folder that is not empty.
    """
    folder = empty_folder(out)
    (folder / IMAGES).rmdir()
    size = REDUCED if reduced else FULL
    noise_gv = NOISE_GV if noise is None else 60.0 * noise
    for plan in PLANS:
        plan_folder = folder / plan.name
        plan_folder.mkdir()
        mesh = strip_mesh(size.divisions)
        write_inp(notched(mesh) if plan.notched else mesh, plan_folder / "mesh.inp", plan.name)
        (plan_folder / "experiment.toml").write_text(plan_toml(plan, size, noise_gv), encoding="utf-8")
    return folder


def notched(mesh: Mesh) -> Mesh:
    """The strip with a round notch in the middle of both edges; rows of nodes follow the contour.

    The axis of the radius lies so far beyond the edge that the notch is `NOTCH_DEPTH` deep.
    """
    x, y = mesh.nodes[:, 0], mesh.nodes[:, 1]
    beyond = NOTCH_RADIUS - NOTCH_DEPTH
    depth = np.maximum(np.sqrt(np.maximum(NOTCH_RADIUS**2 - x**2, 0.0)) - beyond, 0.0)
    nodes = mesh.nodes.copy()
    nodes[:, 1] = y * (1.0 - 2.0 * depth / WIDTH)
    return replace(mesh, nodes=nodes)


def plan_toml(plan: PlannedStrip, size: Size, noise_gv: float) -> str:
    """experiment.toml of a plan: the model at the expected values, and the planned recording."""
    rows, columns = size.shape
    comment = Template(WHAT).substitute(what=plan.what)
    _, _, body = TOML.partition("\n\n")
    table = Template(PLAN).substitute(columns=columns, rows=rows, frames=size.frames + 1,
                                      course=[list(point) for point in plan.course])
    return Template(comment + "\n\n" + body + table).substitute(
        pixel_size=size.pixel, column=float(round(VISIBLE_LEFT_OF_MIDDLE_MM / size.pixel)), row=(rows - 1) / 2,
        model=model_toml(FORCE_NOISE_N, factor=1.0), substeps=size.substeps, noise_std_gv=f"{noise_gv:.4g}")

