"""The effects of indistinguishable pairs, in a form that a monotonous test cannot tell from its counterpart.

A monotonous test separates most of the single effects of the same names, with a chi-square of 85 to 1700: grip slip
that begins within the test from machine compliance, creep with the cube of the stress from a branch that relaxes within
seconds. A back stress without saturation does not show at all. The forms of the pairs are

    grip_slip            at a constant rate from the start: under a constant loading rate it equals a compliance
    creep                linear in the stress: a Maxwell body
    viscoelasticity      a Maxwell body: the whole shear modulus relaxes, slowly
    kinematic_hardening  a back stress that saturates as the term of Voce does

Every other effect is that of `idic_studies.trial.scenes.effects`. `tests/trial/test_indistinguishable_pairs.py`
measures the chi-square between the members of a pair.
"""

from __future__ import annotations

from dataclasses import replace

from idic_studies.trial.scenes.effects import EFFECTS, Effect
from idic_studies.trial.scenes.scene import elapsed

STRENGTH_OF = {"kinematic_hardening": "hardening_curvature"}  # its own strengths hold under a reversed load
RELAXATION_TIME_S = 20.0  # at amplitude 1


def grip_slip(scene, a, rng):
    return scene.moved("RIGHT", scene.along, -0.05 * a * elapsed(scene))


def creep(scene, a, rng):
    return replace(scene, law="creep", values={**scene.values, "rate": 4e-4 * a, "n": 1.0, "stress": 30.0})


def viscoelasticity(scene, a, rng):
    return replace(scene, law="maxwell", values={**scene.values, "g_1": 1.0, "tau_1": RELAXATION_TIME_S / a})


def kinematic_hardening(scene, a, rng):
    bent = EFFECTS["hardening_curvature"].change(scene, a, rng)
    values = {name: value for name, value in bent.values.items() if name not in ("Q", "b")}
    return replace(bent, law="j2_kinematic",
                   values=values | {"C": bent.values["Q"] * bent.values["b"], "gamma": bent.values["b"]})


def indistinguishable_form(effect: Effect) -> Effect:
    """The effect as trials of indistinguishable pairs generate it."""
    change_by_name = {change.__name__: change for change in (grip_slip, creep, viscoelasticity, kinematic_hardening)}
    if effect.name not in change_by_name:
        return effect
    solved = effect.calculix and effect.name != "kinematic_hardening"  # CalculiX has no saturating back stress
    begins = effect.begins and effect.name != "grip_slip"
    return replace(effect, change=change_by_name[effect.name], calculix=solved, begins=begins)
