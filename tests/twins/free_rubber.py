"""Rubber strips with a hole whose energy is none of idic's: Ogden, Arruda-Boyce, Gent, Haines-Wilson, on a mesh of
their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from strip_twin import marched, pulled, strip_toml, write_recording, write_rest

from idic.images import Camera
from idic.laws import LawParameter, LawSpec, all_laws, compile, register
from idic.virtual_tests import strip_with_hole

LENGTH, WIDTH, RADIUS, THICKNESS, KAPPA = 24.0, 16.0, 3.0, 2.0, 200.0  # mm, MPa
PIXEL, SHAPE, ORIGIN = 0.2, (100, 215), (72.3, 49.6)
CAMERA = Camera.from_table(pixel_size=PIXEL, origin=ORIGIN)
NOISE, FORCE_NOISE = 2.0, 0.02  # grey values of 255, N
GRIP = np.linspace(0.0, 15.0, 11)
CHAIN = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)  # series of the inverse Langevin function
OGDEN, ARRUDA_BOYCE, GENT, HAINES_WILSON = range(4)
FORMS = {  # MPa and -, up to six
    "ogden": (OGDEN, 0.63, 1.3, 0.012, 5.0, -0.01, -2.0), "arruda_boyce": (ARRUDA_BOYCE, 0.35, 2.2, 0.0, 0.0, 0.0, 0.0),
    "gent": (GENT, 0.4, 12.0, 0.0, 0.0, 0.0, 0.0),
    "haines_wilson": (HAINES_WILSON, 0.17, 0.03, -0.0015, 0.003, 0.0002, 0.0004),
}
STEPS = 3  # increments of the truth per frame
TOML = strip_toml(PIXEL, ORIGIN, THICKNESS, FORCE_NOISE) + f"""
[material.sheet]
law = "free_rubber"
kappa = {{ value = {KAPPA}, unit = "MPa" }}
"""


@njit
def principal(c, L, form, x, y):
    """L dW/dL of an isochoric principal stretch L, real or complex; x, y: I1 - 3, I2 - 3 of the isochoric tensor."""
    if form == OGDEN:
        return c[0] * L ** c[1] + c[2] * L ** c[3] + c[4] * L ** c[5]
    g1, g2 = 0.0 * x, 0.0 * x
    if form == ARRUDA_BOYCE:
        for i in range(5):
            g1 += c[0] * (i + 1) * CHAIN[i] * ((x + 3.0) / (c[1] * c[1])) ** i
    elif form == GENT:
        g1 = 0.5 * c[0] * c[1] / (c[1] - x)
    else:
        g1, g2 = c[0] + c[2] * y + 2.0 * c[3] * x + 3.0 * c[5] * x * x, c[1] + c[2] * x + 2.0 * c[4] * y
    return 2.0 * g1 * L * L - 2.0 * g2 / (L * L)


def update(F, state, params, dt, P, state_new):
    """Stress by principal stretches, of an F without shear out of the plane."""
    J = (F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]) * F[2, 2]
    if not J.real > 0.0:
        return 1
    form, c = int(params[1].real), params[2:]
    b11, b22 = F[0, 0] ** 2 + F[0, 1] ** 2, F[1, 0] ** 2 + F[1, 1] ** 2
    b12 = F[0, 0] * F[1, 0] + F[0, 1] * F[1, 1]
    mean, r = 0.5 * (b11 + b22), np.sqrt(0.25 * (b11 - b22) ** 2 + b12 ** 2 + 1e-16)
    iso = J ** (-2.0 / 3.0)
    l1, l2, l3 = iso * (mean + r), iso * (mean - r), iso * F[2, 2] ** 2
    x, y = l1 + l2 + l3 - 3.0, l1 * l2 + l2 * l3 + l3 * l1 - 3.0
    t1, t2, t3 = (principal(c, np.sqrt(l1), form, x, y), principal(c, np.sqrt(l2), form, x, y),
                  principal(c, np.sqrt(l3), form, x, y))
    sphere = params[0] * (J - 1.0) * J - (t1 + t2 + t3) / 3.0
    half, steep = 0.5 * (t1 + t2) + sphere, 0.5 * (t1 - t2) / r
    s11, s22, s12 = half + steep * (b11 - mean), half + steep * (b22 - mean), steep * b12
    area = F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]
    i11, i12, i21, i22 = F[1, 1] / area, -F[0, 1] / area, -F[1, 0] / area, F[0, 0] / area
    P[:, :] = 0.0
    P[0, 0], P[0, 1] = s11 * i11 + s12 * i12, s11 * i21 + s12 * i22
    P[1, 0], P[1, 1] = s12 * i11 + s22 * i12, s12 * i21 + s22 * i22
    P[2, 2] = (t3 + sphere) / F[2, 2]
    return 0


def true_law():
    """The law of the truth, registered once."""
    if "true_rubber" not in all_laws():
        names = ("kappa", "form", "a", "b", "c", "d", "e", "f")
        register(LawSpec("true_rubber", tuple(LawParameter(name, "-", name) for name in names), {"finite": update},
                         reference="truth of a test"))
    return compile("true_rubber")


@dataclass(frozen=True)
class Truth:
    """Motion of the true mesh (n_frames, n_nodes, 2) mm, force (n_frames,) N, and largest I1 - 3, I2 - 3 (99 % of the
    points)."""

    mesh: object
    u: np.ndarray
    force: np.ndarray
    reached: tuple[float, float]


def truth_of(form: str) -> Truth:
    """What really happens."""
    mesh = strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", around=4, radial=6, along=3)
    u, force, last = marched(pulled(mesh, "sheet", true_law(), GRIP, THICKNESS),
                             {"sheet": np.array([KAPPA, *FORMS[form]])}, np.arange(len(GRIP), dtype=float), STEPS)
    F = np.concatenate([group.F for group in last.points])
    l1, l2 = np.linalg.svd(F, compute_uv=False).T
    l3 = 1.0 / (l1 * l2)
    return Truth(mesh, u, force,
                 (float(np.percentile(l1**2 + l2**2 + l3**2 - 3.0, 99.0)),
                  float(np.percentile(l1**-2 + l2**-2 + l3**-2 - 3.0, 99.0))))


def true_stress(form: str, mode: str, stretch: np.ndarray) -> np.ndarray:
    """Nominal stress of the incompressible truth, MPa  # (m,)"""
    kind, *c = FORMS[form]
    L = np.asarray(stretch, dtype=float)
    out = []
    for value in L:
        first = {"uniaxial": (value, value**-0.5, value**-0.5), "pure shear": (value, 1.0, 1.0 / value),
                 "equibiaxial": (value, value, value**-2.0)}[mode]
        x, y = sum(f**2 for f in first) - 3.0, sum(f**-2 for f in first) - 3.0
        own, last = (principal.py_func(c, f, kind, x, y) for f in (first[0], first[2]))
        out.append((own - last) / value)
    return np.array(out)


def write_folder(folder, truth: Truth, seed: int, material: str):
    """The experiment of a user who does not know the energy; material : I1 and I2."""
    rng = np.random.default_rng(50 + seed)
    noise = write_recording(folder, truth.mesh, truth.u, CAMERA, SHAPE, NOISE, rng, texture_px=400.0)
    force = truth.force + FORCE_NOISE * rng.standard_normal(len(truth.u))
    user = strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", around=3, radial=4, along=2)
    return write_rest(folder, user, TOML.replace("NOISE", f"{noise:.4f}", 1) + material,
                      np.arange(len(truth.u), dtype=float), {"force_N": force, "grip_mm": GRIP})
