"""A notched tube in tension before two cameras at an angle: a curved surface; the truth by CalculiX.

The half of the tube that faces the cameras is modelled, with its plane of symmetry; the axis is x, the front at z = 0.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "fe"))
from calculix_solids import pulled, with_surfaces  # noqa: E402
from fe_bodies import grid  # noqa: E402

from idic.fe import Mesh  # noqa: E402
from idic.virtual_tests import PlateSize, PlateTest, Rig, Scene  # noqa: E402

LENGTH, OUTER, INNER, NOTCH, NOTCH_WIDTH = 28.0, 8.0, 6.5, 0.6, 3.0  # mm; depth and width of the groove
SEEN_DEG = 60.0  # of the circumference, on both sides of the front
VALUES = {"E": 70e3, "nu": 0.3, "yield_stress": 200.0, "hardening_modulus": 1500.0}  # MPa
GRIP = np.concatenate([np.linspace(0.0, 0.06, 4), np.linspace(0.06, 0.30, 7)[1:]])  # mm
SIZE = PlateSize(0.1, (200, 330), (0, 0, 0), (10, 12, 1, 0), (16, 18, 2, 0))


def tube(along: int, around: int, through: int) -> Mesh:
    """Half of the tube; sets LEFT, RIGHT, CUT (its plane of symmetry, without the ends), faces FRONT and REST."""
    def shape(x: np.ndarray) -> np.ndarray:
        s = 2.0 * x[:, 0] - 1.0
        at = 0.5 * LENGTH * (0.5 * s + 0.5 * s**3)
        outer = OUTER - NOTCH * np.exp(-((at / NOTCH_WIDTH) ** 2))
        angle = np.radians(90.0) * (1.0 - 2.0 * x[:, 1])
        radius = INNER + (outer - INNER) * x[:, 2]
        return np.column_stack([at, radius * np.sin(-angle), radius * np.cos(angle) - OUTER])

    mesh = grid("hex20", (along, around, through), mapping=shape)
    x, y, z = mesh.nodes.T
    angle, radius = np.degrees(np.arctan2(np.abs(y), z + OUTER)), np.hypot(y, z + OUTER)
    outer = OUTER - NOTCH * np.exp(-((x / NOTCH_WIDTH) ** 2))
    ends = np.abs(np.abs(x) - 0.5 * LENGTH) < 1e-9
    front = np.flatnonzero((np.abs(radius - outer) < 1e-3) & (angle < SEEN_DEG + 1e-6))
    return with_surfaces(mesh, front, LEFT=np.flatnonzero(ends & (x < 0)), RIGHT=np.flatnonzero(ends & (x > 0)),
                         CUT=np.flatnonzero((np.abs(z + OUTER) < 1e-9) & ~ends))


def tube_test(folder: Path, size: PlateSize = SIZE) -> PlateTest:
    """The test before noise; CalculiX in `folder`."""
    mesh = tube(*size.true[:3])
    return _test(mesh, *pulled(folder, mesh, VALUES, GRIP, ("LEFT, 1, 3", "RIGHT, 2, 3", "CUT, 3, 3")), size)


def still_tube(size: PlateSize) -> PlateTest:
    """The user's mesh at rest in every frame."""
    mesh = tube(*size.user[:3])
    return _test(mesh, np.zeros((len(GRIP), mesh.n_nodes, 3)), np.zeros(len(GRIP)), size)


def _test(mesh: Mesh, u: np.ndarray, force: np.ndarray, size: PlateSize) -> PlateTest:
    scene = Scene(mesh.nodes, mesh.face_cells(mesh.edge_sets["FRONT"]), mesh.face_cells(mesh.edge_sets["REST"]))
    return PlateTest(scene, u, GRIP, force, Rig.around(size.shape, size.pixel, size.distance, (-15.0, 15.0)),
                     tube(*size.user[:3]), size)


def write_tube(folder: Path, test: PlateTest, seed: int = 0, deviations: dict[str, float] | None = None) -> Path:
    """The experiment folder, as that of the example stereo with another body."""
    file = test.write(folder, seed=seed, deviations=deviations)
    file.write_text(file.read_text().replace(
        "[[channel]]", '[[boundary]]\nnodes = "CUT"\nuz = 0.0\n\n[[channel]]'))
    return file


def measured_end(text: str) -> str:
    """The experiment with the motion of the right end measured in all components, in the place of the log."""
    return text.replace('ux = { column = "grip_displacement_mm", noise_std = 0.0002 }\nuy = 0.0\nuz = 0.0',
                        'ux = "measured"\nuy = "measured"\nuz = "measured"')
