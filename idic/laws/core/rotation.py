"""The rotation of a deformation gradient, and tensors in compiled code that turn with it."""

from __future__ import annotations

import math

import numpy as np

from idic.laws.core import tensors
from idic.laws.core.inner import inner

MAX_POLAR_ITERATIONS = 60
POLAR_TOLERANCE = 1e-4  # change of R, quadratic: 1e-8 and 1e-16 in the next two iterations, which are still made


@inner
def rotation(f):
    """R of f = R U, det f > 0, real or complex: Newton's iteration (Higham 1986) of the mean of R and R^-T."""
    det, inv = tensors.inverse(f)
    size = det ** (-1.0 / 3.0)
    r = (size * f[0], size * f[1], size * f[2], size * f[3], size * f[4], size * f[5], size * f[6], size * f[7],
         size * f[8])
    rounds_left = MAX_POLAR_ITERATIONS
    while rounds_left > 0:
        rounds_left -= 1
        det, inv = tensors.inverse(r)
        r_new = (0.5 * (r[0] + inv[0]), 0.5 * (r[1] + inv[3]), 0.5 * (r[2] + inv[6]),
                 0.5 * (r[3] + inv[1]), 0.5 * (r[4] + inv[4]), 0.5 * (r[5] + inv[7]),
                 0.5 * (r[6] + inv[2]), 0.5 * (r[7] + inv[5]), 0.5 * (r[8] + inv[8]))
        change = (abs(r_new[0].real - r[0].real) + abs(r_new[1].real - r[1].real) + abs(r_new[2].real - r[2].real)
                  + abs(r_new[3].real - r[3].real) + abs(r_new[4].real - r[4].real) + abs(r_new[5].real - r[5].real)
                  + abs(r_new[6].real - r[6].real) + abs(r_new[7].real - r[7].real) + abs(r_new[8].real - r[8].real))
        r = r_new
        if change < POLAR_TOLERANCE:
            rounds_left = min(rounds_left, 2)
    return r


@inner
def to_axes(R, angle):
    """Rotation from the current frame into the material axes, (R Q)^T, as a 9-tuple."""
    c, s = np.cos(angle * (math.pi / 180.0)), np.sin(angle * (math.pi / 180.0))
    return tensors.transposed((c * R[0] + s * R[1], c * R[1] - s * R[0], R[2],
                               c * R[3] + s * R[4], c * R[4] - s * R[3], R[5],
                               c * R[6] + s * R[7], c * R[7] - s * R[6], R[8]))


@inner
def real_parts(s):
    """Real parts of a 6-tuple."""
    return s[0].real, s[1].real, s[2].real, s[3].real, s[4].real, s[5].real
