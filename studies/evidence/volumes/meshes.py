"""What two meshes of one body do to parameters, to first order: the truth of `scale.py` on its mesh, the model's.

python studies/evidence/volumes/meshes.py [SIDE:SCANS:ELEMENTS ...]

No images: a voxel tells the difference e of the two motions along its gradient, so that images of N voxels on the body
weigh it by c = N g^2 / s^2, with the mean square g^2 of a gradient component and the noise s^2 of a residual. With the
derivatives phi of motion and force by the parameters (central differences on ELEMENTS / 2) the bias is

    (c <phi phi> + phi_F phi_F / s_F^2)^-1 (c <phi e> + phi_F e_F / s_F^2)

512:8:31 (the default; one increment per scan): E +0.82, nu -0.50, yield stress +0.01, hardening -4.9 %; the
identification of these scans was +0.82, -0.51, +0.02, -5.2 % off, with std of noise of 0.004, 0.002, 0.004, 0.04 %.
"""

from __future__ import annotations

import sys

import numpy as np
import scale
from scipy.interpolate import RegularGridInterpolator

from idic.fe import raise_order

POINTS = 63  # per side, where motions are compared
STEP = 2e-3  # of a parameter
EDGE_PX = 3.0  # that the identification leaves out
LEAVES_OF_NOISE = 1.764  # variance of a residual over that of a voxel: the reference and the cubic spline


def sampled(fields: np.ndarray) -> np.ndarray:
    """Motions (n_scans, nz, ny, nx, 3) on a regular grid at the middles of `POINTS` cubed cells  # (n_scans, n, 3)"""
    middles = (np.arange(POINTS) + 0.5) / POINTS
    places = np.stack(np.meshgrid(*[middles] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    axes = [np.linspace(0.0, 1.0, n) for n in fields.shape[1:4]]
    return np.array([RegularGridInterpolator(axes, field)(places) for field in fields])


def on_bricks(elements: int, side_mm: float, stroke_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sampled motions mm and forces N of ELEMENTS cubed hex8."""
    u, force = scale.pulled(scale.brick((elements,) * 3, side_mm), stroke_mm, 1)
    return sampled(u.reshape(len(u), *[elements + 1] * 3, 3))[1:], force[1:]


def bias(side: int, n_scans: int, elements: int) -> dict[str, float]:
    """Relative error of every parameter."""
    side_px = side - 1.0 - 2.0 * scale.RIM_PX
    side_mm, truth = side_px * scale.VOXEL_MM, dict(scale.TRUTH)
    stroke = np.concatenate([[0.0], np.linspace(0.0, scale.STRAIN * side_mm, n_scans - 1)])
    mesh = raise_order(scale.brick(scale.TRUE_ELEMENTS, side_mm))
    true_u, true_force = scale.pulled(mesh, stroke, 1)
    true_motion = sampled(np.array([scale.on_half_grid(u, mesh, scale.TRUE_ELEMENTS) for u in true_u]))[1:]
    motion, force = on_bricks(elements, side_mm, stroke)
    slopes, force_slopes = [], []
    for name, value in truth.items():
        ends = []
        for step in (STEP, -STEP):
            scale.TRUTH[name] = value * (1.0 + step)
            ends.append(on_bricks((elements + 1) // 2, side_mm, stroke))
        scale.TRUTH[name] = value
        slopes.append((ends[0][0] - ends[1][0]) / (2.0 * STEP))
        force_slopes.append((ends[0][1] - ends[1][1]) / (2.0 * STEP))
    phi, phi_force = np.array(slopes).reshape(len(truth), -1), np.array(force_slopes)
    squared_wave = (2.0 * np.pi) ** 2 / np.prod(scale.WAVELENGTHS_PX)  # mean of (2 pi / wavelength)^2
    gradient = scale.CONTRAST_GV**2 * squared_wave / 3.0 / scale.VOXEL_MM**2
    noise = LEAVES_OF_NOISE * (scale.NOISE_GV**2 + 1.0 / 12.0)
    weight = (side_px - 2.0 * EDGE_PX) ** 3 * gradient / noise / POINTS**3
    M = weight * phi @ phi.T + phi_force @ phi_force.T / scale.FORCE_NOISE_N**2
    b = (weight * phi @ (true_motion - motion).ravel()
         + phi_force @ (true_force[1:] - force) / scale.FORCE_NOISE_N**2)
    return dict(zip(truth, np.linalg.solve(M, b).tolist(), strict=True))


if __name__ == "__main__":
    for case in sys.argv[1:] or ["512:8:31"]:
        changes = bias(*map(int, case.split(":")))
        print(case, ", ".join(f"{name} {100.0 * change:+.2f} %" for name, change in changes.items()), flush=True)
