"""The cost of a term of the composed law over linear J2 plasticity, in turn in one run: CPU time of the same points."""

import time

import numpy as np
import pytest

from idic.laws import compile, directional_stresses, point_tangents

pytestmark = [pytest.mark.bench, pytest.mark.slow]
N, REPEATS = 4000, 15


def cost(law, mode, path, params):
    """CPU time (s) of tangent and sensitivities along a path."""
    state = np.tile(law.initial_state(mode), (N, 1))
    directions = np.eye(len(params)) * params
    dF = np.zeros((N, len(params), *path.shape[2:]))
    began = time.process_time()
    for F in path:
        directional_stresses(law, mode, F, state, params, 1.0, dF, dparams=directions)
        _, state, _, ok = point_tangents(law, mode, F, state, params, 1.0)
        assert ok
    return time.process_time() - began


def ratios_of(measured, laws, values):
    """CPU time of the last of two laws over that of the first, in 3D and in plane stress."""
    reference_law, law = laws
    ratios = {}
    for mode, label in ((0, "3D"), (2, "plane stress")):
        d = 3 if mode == 0 else 2
        rng = np.random.default_rng(0)
        way = rng.standard_normal((N, d, d))
        path = np.array([np.eye(d) + 0.004 * (k + 1) * way / np.linalg.norm(way, axis=(1, 2))[:, None, None]
                         for k in range(4)])
        times = np.array([[cost(reference_law, mode, path, values[0]), cost(law, mode, path, values[1])]
                          for _ in range(REPEATS)]).min(axis=0)
        ratios[label] = times[1] / times[0]
        measured(f"{law.spec.name}, {label}", f"{1e6 * times[1] / N / len(path):.2f} us per point and step",
                 f"{reference_law.spec.name} {1e6 * times[0] / N / len(path):.2f} us: ratio {ratios[label]:.2f}")
    return ratios


@pytest.mark.parametrize("terms", [
    "voce", "power", "swift", "free8", "linear+norton", "linear+perzyna", "linear+johnson_cook",
    "drucker_prager+linear", "linear+prager", "linear+armstrong_frederick", "linear+lemaitre", "hill48+linear",
    "linear+linear*flow_stress", "orthotropic+linear"])
def test_the_cost_of_a_term_over_linear_j2_plasticity(measured, terms):
    reference_law, law = compile("j2_linear"), compile(f"elastoplastic({terms})")
    assert min(ratios_of(measured, (reference_law, law),
                         (reference_law.spec.defaults(), law.spec.defaults())).values()) > 0.5
