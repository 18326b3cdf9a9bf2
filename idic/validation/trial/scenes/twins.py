"""Effects of the twin trials: made so that the record of the test, which only grows, cannot tell them from their twin.

Of the single effects of the same names most can be told apart on that record, by a chi-square of 85 to 1700: a slip that
begins in the middle of a test from a machine that gives way in proportion to the force, creep with the cube of the
stress from a branch that relaxes within seconds; a back stress that never saturates does not show at all. Twins are

    grip_slip            from the start, evenly in time: under an even ramp as a compliance
    creep                with the stress itself: a Maxwell body
    viscoelasticity      a Maxwell body: its whole shear modulus relaxes, slowly
    kinematic_hardening  a back stress that saturates as Voce's term does

(`tests/trial/test_twins.py` measures by how much a record tells them apart.) What is not here is as in
`idic.validation.trial.scenes.effects`.
"""

from __future__ import annotations

from dataclasses import replace

from idic.validation.trial.scenes.effects import EFFECTS, Effect
from idic.validation.trial.scenes.scene import elapsed

LIKE = {"kinematic_hardening": "hardening_curvature"}  # whose strengths count: its own ones are of a reversed load
SLOW = 20.0  # s, relaxation time at amplitude 1


def grip_slip(scene, a, rng):
    return scene.moved("RIGHT", "x", -0.05 * a * elapsed(scene))


def creep(scene, a, rng):
    return replace(scene, law="creep", values={**scene.values, "rate": 4e-4 * a, "n": 1.0, "stress": 30.0})


def viscoelasticity(scene, a, rng):
    return replace(scene, law="maxwell", values={**scene.values, "g_1": 1.0, "tau_1": SLOW / a})


def kinematic_hardening(scene, a, rng):
    bent = EFFECTS["hardening_curvature"].change(scene, a, rng)
    values = {name: value for name, value in bent.values.items() if name not in ("Q", "b")}
    return replace(bent, law="j2_kinematic",
                   values=values | {"C": bent.values["Q"] * bent.values["b"], "gamma": bent.values["b"]})


def twin_effect(effect: Effect) -> Effect:
    """The effect as twin trials make it."""
    own = {change.__name__: change for change in (grip_slip, creep, viscoelasticity, kinematic_hardening)}
    if effect.name not in own:
        return effect
    solved = effect.calculix and effect.name != "kinematic_hardening"  # no saturating back stress there
    return replace(effect, change=own[effect.name], calculix=solved, begins=effect.begins and effect.name != "grip_slip")
