"""The plan that is ranked first separates two models in simulated tests, the one that is ranked last does not.

Both models are fitted to a recording of the first one; the plans are ranked with these fits. Then each of the two plans
is simulated with the first model and fresh noise, and both models are identified from it: the log-odds are half the
difference of their residual chi-squares of images and channels.
"""

from __future__ import annotations

import numpy as np
import pytest
from planned_tests import FORCE, GRIPS, PLAN, plan_folder
from test_design_command import (
    CURVED, Diagnosed, LINEAR_BODY, NONLINEAR, PLASTIC, RefittedModel, _merit, _of_plan, law,
)

import idic
from idic.experiment_file import read_toml
from idic.virtual_tests import simulate

LINEAR = law("elastic", E=2000.0, nu=0.35)
DRIFTING = {"dof": [{"name": "channel.force_N.drift"}],
            "channel": [{"column": "force_N", "simulated": {"reaction": "RIGHT", "component": "x"}, "noise_std": 1.0,
                         "drift_from_s": 5.5}]}
HARD = law("j2_linear", E=2000.0, nu=0.35, yield_stress=14.0, hardening_modulus=1200.0)
KINEMATIC = {"material.BODY": PLASTIC["material.BODY"] | {
    "law": "j2_kinematic", "hardening_modulus": 0.0, "gamma": 0.0,
    "C": {"value": 800.0, "unit": "MPa", "identify": True}}}


def flowing(law_name, **values):
    """A law whose further parameters are given as they stand in experiment.toml."""
    return {"material.BODY": {"law": law_name, "E": {"value": 2000.0, "unit": "MPa", "identify": True}, "nu": 0.35,
                              **values}}


RELAXING = flowing("maxwell", g_1={"value": 0.2, "identify": True},
                   tau_1={"value": 6.0, "unit": "s", "identify": True})
CREEPING = flowing("creep", rate={"value": 1e-4, "unit": "1/s", "identify": True}, n={"value": 3.0, "identify": True},
                   stress={"value": 10.0, "unit": "MPa"})
DAMAGING = flowing("elastic_damage", threshold={"value": 0.006, "identify": True},
                   softening={"value": 25.0, "identify": True})
VISCOUS = {"material.BODY": PLASTIC["material.BODY"] | {
    "law": "viscoplastic", "eta": {"value": 2000.0, "unit": "MPa*s", "identify": True}, "m": 1.0}}
SETS = {  # the truth, its rival, the largest motion of the recording, mm
    "a softening material, a bent load cell": (NONLINEAR, LINEAR | CURVED, 0.09),
    "a softening material, a drift": (NONLINEAR, LINEAR | DRIFTING, 0.09),
    "a softening material, finite strains": (law("nonlinear_elastic", E=2000.0, nu=0.35, nonlinearity=-10.0),
                                             LINEAR | {"material.BODY.kinematics": "finite"}, 0.07),
    "isotropic, kinematic hardening": (PLASTIC, KINEMATIC, 0.11),
    "yield, a bent load cell": (HARD, LINEAR | CURVED, 0.09),
    "yield, a drift": (HARD, LINEAR | DRIFTING, 0.09),
    "relaxation, a drift": (RELAXING, LINEAR | DRIFTING, 0.09),
    "relaxation, a softening material": (RELAXING, NONLINEAR, 0.09),
    "creep, yield": (CREEPING, HARD, 0.09),
    "damage, yield": (DAMAGING, HARD, 0.09),
    "damage, a softening material": (DAMAGING, NONLINEAR, 0.09),
    "viscous, rate-independent flow": (VISCOUS, PLASTIC, 0.11)}
PLANS = {"steady": "[[0, 0], [11, 0.09]]", "tiny": "[[0, 0], [11, 0.012]]", "unload": "[[0, 0], [6, 0.11], [11, 0]]",
         "hold": "[[0, 0], [3, 0.09], [11, 0.09]]",
         "reverse": "[[0, 0], [4, 0.11], [11, -0.11]]"}
TESTS, WANTED = 10, 9


def plan(folder, program):
    return plan_folder(folder, LINEAR_BODY + GRIPS + FORCE + PLAN.replace("n_frames = 6", "n_frames = 12")
                       + f"\n[design.program]\ngrip_mm = {program}\n")


def fitted(folder, edits):
    return idic.identify(folder, overrides={**edits, "options.estimator": "ordinary"}).content


def objective(content):
    return min(entry["phi"] for entry in content["history"] if entry["accepted"])


def ranked(tmp_path, truth, rival, motion):
    """The plans by rank, as (name, folder)."""
    source = plan(tmp_path / "source", f"[[0, 0], [11, {motion}]]")
    simulate(source, tmp_path / "recording", truth, seed=1)
    models = []
    for name, edits in (("truth", truth), ("rival", rival)):
        content = fitted(tmp_path / "recording", edits)
        values = {key: entry["value"] for key, entry in content["parameters"].items() if entry.get("free")}
        models.append(RefittedModel(name, edits, values))  # MPa and N are internal units
    force = np.genfromtxt(tmp_path / "recording" / "loads.csv", delimiter=",", names=True)["force_N"]
    origin = Diagnosed(tuple(models), read_toml(source / "experiment.toml"), {"force_N": float(np.abs(force).max())})
    folders = {name: plan(tmp_path / name, program) for name, program in PLANS.items()}
    merits = {name: _merit(_of_plan(origin, folder, None, None)) for name, folder in folders.items()}
    return sorted(((name, folders[name]) for name in PLANS if np.isfinite(merits[name])),
                  key=lambda entry: -merits[entry[0]])


def separated(tmp_path, folder, truth, rival, number):
    """In how many of so many simulated tests the truth leads by 99:1."""
    count = 0
    for seed in range(100, 100 + number):
        test = tmp_path / f"{folder.name}-{seed}"
        simulate(folder, test, truth, seed=seed)
        lead = 0.5 * (objective(fitted(test, rival)) - objective(fitted(test, truth)))
        count += lead > np.log(99.0)
    return count


def test_kinematic_hardening_is_told_by_a_reversal_in_a_simulated_test(tmp_path):
    truth, rival, _ = SETS["isotropic, kinematic hardening"]
    steady, reverse = (plan(tmp_path / name, PLANS[name]) for name in ("steady", "reverse"))
    origin = Diagnosed((RefittedModel("truth", truth, {}), RefittedModel("rival", rival, {})),
                       read_toml(reverse / "experiment.toml"), {})
    assert _of_plan(origin, steady, None, None)["log_odds"] < 0.1
    assert _of_plan(origin, reverse, None, None)["log_odds"] > 100.0
    assert separated(tmp_path, reverse, truth, rival, 1) == 1


@pytest.mark.slow
@pytest.mark.parametrize("name", SETS)
def test_the_first_plan_separates_and_the_last_does_not(name, tmp_path):
    truth, rival, motion = SETS[name]
    plans = ranked(tmp_path, truth, rival, motion)
    assert separated(tmp_path, plans[0][1], truth, rival, TESTS) >= WANTED
    assert separated(tmp_path, plans[-1][1], truth, rival, TESTS) <= TESTS - WANTED
