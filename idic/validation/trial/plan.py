"""Which trials there are, and what a sealed truth holds.

Everything in a truth is plain numbers and words, so that it can be hashed before anything is simulated; the scene is
made of it again wherever it is needed.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from idic.errors import InputError
from idic.validation.trial.scenes.effects import EFFECTS, Effect
from idic.validation.trial.scenes.outside import OUTSIDE
from idic.validation.trial.scenes.recording import Paint
from idic.validation.trial.scenes.scene import NULLS, Geometry, Scene, plain_scene
from idic.validation.trial.scenes.twins import LIKE, twin_effect
from idic.validation.trial.strength import CLEAR, CONCEALED, FAINT, STRENGTHS
from idic.validation.trial.strengths import strengths

SINGLES = ("plasticity", "kinematic_hardening", "hardening_curvature", "creep", "viscoelasticity", "damage",
           "orthotropy", "thermal_expansion", "heterogeneity", "grip_slip", "grip_rotation", "machine_compliance",
           "lens_distortion", "magnification", "illumination", "force_offset", "force_drift", "frame_time_offset")
PAIRS = (("plasticity", "grip_rotation"), ("plasticity", "lens_distortion"), ("orthotropy", "force_offset"),
         ("heterogeneity", "grip_rotation"), ("thermal_expansion", "lens_distortion"), ("creep", "grip_rotation"),
         ("viscoelasticity", "illumination"), ("damage", "force_offset"))
TWINS = (("hardening_curvature", "kinematic_hardening", "plastic_ramp"), ("creep", "viscoelasticity", "ramp_hold"),
         ("grip_slip", "machine_compliance", "ramp"), ("force_scale", "force_drift", "known"))
GROUPS = ("singles", "clean", "outside", "pairs", "twins")
NUMBER = {"full": {"singles": 3, "clean": 100, "outside": 2, "pairs": 2, "twins": 3},
          "sketch": {"singles": 1, "clean": 4, "outside": 1, "pairs": 1, "twins": 1}}
PAIR_STRENGTH = CLEAR
CLEAN_NULLS = ("elastic", "elastic", "plastic", "held", "ramp")


@dataclass(frozen=True)
class Trial:
    """One trial before anything is drawn.

    key : GROUP/NAME; effects : (name, strength), none for a clean one; null : the user's model; twin : the name that
    this record cannot tell from the truth
    """

    key: str
    null: str
    effects: tuple[tuple[str, str], ...] = ()
    twin: str = ""

    @property
    def group(self) -> str:
        return self.key.partition("/")[0]


@dataclass(frozen=True)
class Truth:
    """What is sealed: plain values only.

    amplitudes : of the effects, in their order; parameters : true values of the null's law, units of the file; seed :
    of everything that an effect draws; solver : "calculix" or "built-in"
    """

    key: str
    null: str
    effects: tuple[tuple[str, str], ...]
    twin: str
    amplitudes: tuple[float, ...]
    geometry: Mapping[str, float]
    parameters: Mapping[str, float]
    paint: Mapping[str, float]
    seed: int
    solver: str

    @property
    def group(self) -> str:
        return self.key.partition("/")[0]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(name for name, _ in self.effects)

    @classmethod
    def read(cls, content: Mapping) -> Truth:
        """From the JSON values of `dataclasses.asdict`."""
        fields = {name: content[name] for name in cls.__dataclass_fields__}
        return cls(**fields | {"effects": tuple((n, s) for n, s in content["effects"]),
                               "amplitudes": tuple(content["amplitudes"])})


@dataclass(frozen=True)
class Campaign:
    """A list of trials and the seed that all their truths are drawn from."""

    size: str = "full"
    seed: int = 1
    singles: tuple[str, ...] = SINGLES
    trials: tuple[Trial, ...] = field(init=False)

    def __post_init__(self):
        if self.size not in NUMBER:
            raise InputError("no such size of a trial", key="size", expected=", ".join(NUMBER), found=self.size)
        object.__setattr__(self, "trials", _trials(self.size, self.singles))

    def select(self, only: Sequence[str] | None) -> tuple[Trial, ...]:
        """The trials of these keys, or whose key begins with one of these words (``clean``, ``singles/plasticity``).

        Raises
        ------
        InputError
            If a word fits nothing.
        """
        if not only:
            return self.trials
        keys, chosen = {trial.key for trial in self.trials}, []
        for word in only:
            fits = {word} & keys or {key for key in keys if key.startswith(word)}
            if not fits:
                raise InputError("there is no such trial", key="--only", found=word,
                                 expected=f"{', '.join(GROUPS)}, or the beginning of {self.trials[0].key}")
            chosen.append(fits)
        return tuple(trial for trial in self.trials if any(trial.key in fits for fits in chosen))


def _trials(size: str, singles: Sequence[str]) -> tuple[Trial, ...]:
    n = NUMBER[size]
    wanted = STRENGTHS if size == "full" else (CONCEALED,)
    found = [Trial(f"singles/{name}-{strength}-{k}", EFFECTS[name].null, ((name, strength),))
             for k in range(n["singles"]) for strength in wanted for name in singles]
    found += [Trial(f"clean/{k}", CLEAN_NULLS[k % len(CLEAN_NULLS)]) for k in range(n["clean"])]
    found += [Trial(f"outside/{name}-{k}", effect.null, ((name, CLEAR),))
              for k in range(n["outside"]) for name, effect in OUTSIDE.items()]
    found += [Trial(f"pairs/{one}+{other}-{k}", "elastic", ((one, PAIR_STRENGTH), (other, PAIR_STRENGTH)))
              for k in range(n["pairs"]) for one, other in PAIRS]
    for k in range(n["twins"]):
        for one, other, null in TWINS:
            name, twin = (one, other) if k % 2 == 0 else (other, one)
            found.append(Trial(f"twins/{one}~{other}-{k}", null, ((name, CLEAR),), twin))
    return tuple(found)


def effect_named(name: str) -> Effect:
    return EFFECTS[name] if name in EFFECTS else OUTSIDE[name]


def effect_in(group: str, name: str) -> Effect:
    """The effect as trials of a group make it."""
    return twin_effect(effect_named(name)) if group == "twins" else effect_named(name)


def draw(trial: Trial, seed: int) -> Truth:
    """Draw the truth of a trial: strip, true parameters, signs, paint."""
    rng = np.random.default_rng([seed, zlib.crc32(trial.key.encode())])
    null, effects = NULLS[trial.null], [effect_in(trial.group, name) for name, _ in trial.effects]
    stiff, geometry = rng.uniform(0.95, 1.05), {"radius": float(rng.uniform(0.85, 1.15))}
    scaled = {name: float(value * (stiff if name not in ("nu", "kappa") else 1.0))
              for name, value in null.truth.items()}
    amplitudes = []
    for effect, (name, strength) in zip(effects, trial.effects, strict=True):
        sign = rng.choice([-1.0, 1.0]) if effect.signed else 1.0
        measured = LIKE.get(name, name) if trial.group == "twins" else name
        amplitudes.append(float(sign * strengths()[measured][strength]["amplitude"]))
    scaled_known = scaled | ({"E": null.truth["E"]} if trial.null == "known" else {})
    paint = {"texture": int(rng.integers(2**31)), "noise": int(rng.integers(2**31)),
             "dots_px": float(rng.uniform(1.5, 1.7)), "noise_gv": 2.0}
    solver = "calculix" if any(effect.calculix for effect in effects) else "built-in"
    if trial.group == "clean":
        solver = "calculix" if int(trial.key.rpartition("/")[2]) % 10 == 0 else "built-in"
    if "viscoelasticity" in (name for name, _ in trial.effects):
        solver = "built-in"
    return Truth(trial.key, trial.null, trial.effects, trial.twin, tuple(amplitudes), geometry, scaled_known, paint,
                 int(rng.integers(2**31)), solver)


def scene_of(truth: Truth, with_effects: bool = True) -> Scene:
    """The scene of a truth, or the same test without its effects."""
    scene = plain_scene(truth.null, Geometry(**truth.geometry), truth.parameters)
    if not with_effects:
        return scene
    rng = np.random.default_rng(truth.seed)
    for (name, _), amplitude in zip(truth.effects, truth.amplitudes, strict=True):
        scene = effect_in(truth.group, name).change(scene, amplitude, rng)
    return scene


def paint_of(truth: Truth) -> Paint:
    return Paint(**truth.paint)


__all__ = ["CLEAR", "CONCEALED", "FAINT", "GROUPS", "Campaign", "Trial", "Truth", "draw", "effect_in", "effect_named",
           "paint_of", "scene_of"]
