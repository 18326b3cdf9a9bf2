"""The table of evidence/time-step.md: error of the parameters by the increments, with and without extrapolation.

    python studies/evidence/time_step_numbers.py [LAW ...]

A strip with a hole is pulled (or pulled and held, or loaded and partly unloaded) in 16 frames. Displacements at the
nodes count with 0.5 micrometre and the force with 0.1 % of its largest value: those give the standard deviations. The
truth has 128 increments per frame, extrapolated. One Gauss-Newton step tells what the error of a simulation does to
the parameters.
"""

import sys

import numpy as np

from idic.fe import Constraints, Direction, Body, Reaction, Section, march, march_extrapolated
from idic.laws import compile as compile_law
from idic.virtual_tests import strip_with_hole

LENGTH, WIDTH, RADIUS, FRAMES, TRUE_INCREMENTS = 20.0, 10.0, 2.0, 16, 128
MOTION_STD_MM, FORCE_STD_SHARE = 5e-4, 1e-3
TIMES = np.linspace(0.0, 16.0, FRAMES + 1)
PULL, HOLD = TIMES / TIMES[-1], np.minimum(TIMES / 4.0, 1.0)
CYCLE = np.interp(TIMES, [0.0, 6.0, 10.0, 16.0], [0.0, 1.0, 0.4, 1.6])
CASES = {  # law, parameters that differ from their defaults, identified ones, course of the grip (share of the length)
    "viscoplastic, pulled": ("viscoplastic", {"E": 2000.0, "nu": 0.35, "yield_stress": 20.0, "hardening_modulus": 300.0,
                                              "eta": 2000.0, "m": 1.0},
                             ("E", "yield_stress", "hardening_modulus", "eta"), 0.05 * PULL),
    "viscoplastic, unloaded": ("viscoplastic", {"E": 2000.0, "nu": 0.35, "yield_stress": 20.0,
                                                "hardening_modulus": 300.0, "eta": 100.0, "m": 3.0},
                               ("E", "yield_stress", "hardening_modulus", "eta", "m"), 0.04 * CYCLE),
    "maxwell, held": ("maxwell", {"E": 2000.0, "nu": 0.35, "g_1": 0.3, "tau_1": 1.5, "g_2": 0.2, "tau_2": 8.0,
                                  "g_3": 0.0, "tau_3": 0.0}, ("E", "g_1", "tau_1", "g_2", "tau_2"), 0.03 * HOLD),
    "creep, pulled": ("creep", {"E": 2000.0, "nu": 0.35, "rate": 1e-3, "n": 4.0, "stress": 20.0}, ("E", "rate", "n"),
                      0.05 * PULL),
    "creep, held": ("creep", {"E": 2000.0, "nu": 0.35, "rate": 1e-3, "n": 4.0, "stress": 20.0}, ("E", "rate", "n"),
                    0.03 * HOLD),
    "egp, pulled": ("egp", {}, ("Gr", "Sa", "tau0", "G1", "eta0"), 0.12 * PULL),
    "egp_2, pulled": ("egp_2", {}, ("Gr", "Sa", "tau0", "G1", "eta01"), 0.12 * PULL),
    "egp, held": ("egp", {}, ("Gr", "Sa", "tau0", "G1", "eta0"), 0.08 * HOLD),
}


def problem(law, stated_values, identified, grip):
    """Body, its parameters, directions of the identified ones and their values."""
    mesh = strip_with_hole(LENGTH, WIDTH, RADIUS, "quad4", 2, 3, 2, name="B")
    left_end, right_end = mesh.node_sets["LEFT"], mesh.node_sets["RIGHT"]
    dofs = np.concatenate([2 * right_end, 2 * right_end + 1, 2 * left_end, 2 * left_end + 1])
    basis = np.zeros((len(dofs), 1))
    basis[:len(right_end)] = 1.0
    compiled = compile_law(law, "finite")
    model = Body(mesh=mesh, kind="plane_stress", sections=(Section("B", compiled, mesh.element_sets["B"]),),
                  thickness=1.0, constraints=Constraints(dofs, basis, LENGTH * grip[:, None]),
                  channels=(Reaction(2 * right_end),))
    names = compiled.spec.parameter_names
    values = np.array([stated_values.get(p.name, p.default or 0.0) for p in compiled.spec.parameters], float)
    directions = tuple(Direction(name, material=(0, names.index(name))) for name in identified)
    return model, {"B": values}, directions, np.array([values[names.index(name)] for name in identified])


def table(name):
    law, stated_values, identified, grip = CASES[name]
    model, values, directions, free_values = problem(law, stated_values, identified, grip)
    exact, _ = _outcome(march_extrapolated(model, values, TIMES, increments=TRUE_INCREMENTS))
    force = np.abs(exact[-len(TIMES):]).max() * FORCE_STD_SHARE
    scale = np.concatenate([np.full(len(exact) - len(TIMES), MOTION_STD_MM), np.full(len(TIMES), force)])
    states = list(march(model, values, TIMES, directions, substeps=4))
    slopes = np.concatenate([np.array([s.du for s in states]).reshape(-1, len(identified)),
                             np.array([s.dchannels for s in states]).reshape(-1, len(identified))])
    slopes *= free_values / scale[:, None]
    covariance = np.linalg.inv(slopes.T @ slopes)

    def error(outcome):
        return np.abs(covariance @ (slopes.T @ ((outcome - exact) / scale)) / np.sqrt(np.diag(covariance))).max()

    print(f"{name}: {', '.join(identified)}")
    for n in (1, 2, 4, 8, 16, 32, 64):
        plain, plain_cost = _outcome(march(model, values, TIMES, substeps=n))
        line = f"  {n:3d} per frame: {error(plain):8.3f} std, {plain_cost:5d} Newton iterations"
        if n > 1:
            ahead, cost = _outcome(march_extrapolated(model, values, TIMES, increments=n))
            line += f"; extrapolated from {n // 2} and {n}: {error(ahead):8.3f} std, {cost:5d}"
        print(line, flush=True)


def _outcome(states):
    """Nodal motions and forces of all frames in one vector, and the Newton iterations they cost."""
    frames = [(s.u.ravel(), s.channels, s.n_newton) for s in states]
    return (np.concatenate([*(u for u, _, _ in frames), *(f for _, f, _ in frames)]), sum(n for _, _, n in frames))


if __name__ == "__main__":
    for case in CASES:
        if not sys.argv[1:] or case.partition(",")[0] in sys.argv[1:]:
            table(case)
