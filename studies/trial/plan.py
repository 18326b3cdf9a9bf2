"""The trials of a campaign, and the truth of each.

A truth consists of numbers and words: it is hashed before the simulation, and the scene is built from it again.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from idic.errors import InputError
from idic_studies.trial.kinds import BEYOND, LIBRARY, is_unseen, kind_named
from idic_studies.trial.scenes.effects import EFFECTS, Effect
from idic_studies.trial.scenes.indistinguishable import STRENGTH_OF, indistinguishable_form
from idic_studies.trial.scenes.outside import OUTSIDE
from idic_studies.trial.scenes.photographs import check_photographs
from idic_studies.trial.scenes.recording import Paint, on_photograph
from idic_studies.trial.scenes.scene import NULLS, Geometry, Scene, plain_scene
from idic_studies.trial.scenes.worlds import (as_solid, drawn_world, photograph_of, photographed_world,
                                                 world_scene)
from idic_studies.trial.strength import CLEAR, CONCEALED, FAINT, STRENGTHS
from idic_studies.trial.world_strength import amplitude_in
from idic_studies.trial.strengths import strengths

SINGLES = ("plasticity", "kinematic_hardening", "hardening_curvature", "creep", "viscoelasticity", "damage",
           "orthotropy", "thermal_expansion", "heterogeneity", "grip_slip", "grip_rotation", "machine_compliance",
           "lens_distortion", "magnification", "illumination", "force_offset", "force_drift", "frame_time_offset")
PAIRS = (("plasticity", "grip_rotation"), ("plasticity", "lens_distortion"), ("orthotropy", "force_offset"),
         ("heterogeneity", "grip_rotation"), ("thermal_expansion", "lens_distortion"), ("creep", "grip_rotation"),
         ("viscoelasticity", "illumination"), ("damage", "force_offset"))
INDISTINGUISHABLE_PAIRS = (  # two effects and the model on whose record they cannot be told apart
    ("hardening_curvature", "kinematic_hardening", "plastic_ramp"), ("creep", "viscoelasticity", "ramp_hold"),
    ("grip_slip", "machine_compliance", "ramp"), ("force_scale", "force_drift", "known"))
GROUPS = ("singles", "clean", "outside", "pairs", "twins")  # the stored keys
GROUP_NAMES = {"indistinguishable": "twins"}  # of --only, for the stored key
NUMBER = {"full": {"singles": 3, "clean": 100, "outside": 2, "pairs": 2, "twins": 3},
          "sketch": {"singles": 1, "clean": 4, "outside": 1, "pairs": 1, "twins": 1}}
WORLDS, KNOWN_WORLDS = "worlds", "worlds-known"  # sizes with drawn worlds: all kinds; known ones alone
PICTURES = "pictures"  # drawn worlds of known kinds on photographed surfaces, their motion by CalculiX
SIZES = (*NUMBER, WORLDS, KNOWN_WORLDS, PICTURES)
WORLD_NUMBER = {"singles": 2, "clean": 120, "outside": 6, "pairs": 4}
PICTURES_NUMBER = {"clean": 6, "pairs": 3}  # beside one of each known kind: 30 trials
NOT_BY_CALCULIX = ("nonlinear_elasticity", "viscoelasticity")
PAIR_STRENGTH = CLEAR
STORED_AS = {"counterpart": "twin"}  # keys of sealed truths
MAX_WORLDS = 8  # that are drawn for one trial
CLEAN_NULLS = ("elastic", "elastic", "plastic", "held", "ramp")


@dataclass(frozen=True)
class Trial:
    """One trial of the campaign, before its truth is drawn.

    key : GROUP/NAME
    null : the user's model, see `idic_studies.trial.scenes.scene.NULLS`
    effects : (name, strength), none for a clean recording
    counterpart : effect of an indistinguishable pair that this record cannot tell from the true one
    in_world : specimen, images, programme, noise and mechanics are drawn, too
    photographs : folder of real surfaces (`idic_studies.trial.scenes.photographs`), "": painted dots
    """

    key: str
    null: str
    effects: tuple[tuple[str, str], ...] = ()
    counterpart: str = ""
    in_world: bool = False
    photographs: str = ""

    @property
    def group(self) -> str:
        return self.key.partition("/")[0]


@dataclass(frozen=True)
class Truth:
    """The sealed truth of a trial, plain values only.

    amplitudes : of the effects, in their order
    parameters : true values of the law of the null, units of the file
    seed : of the random choices of the effects
    solver : "calculix" or "built-in"
    world : see `idic_studies.trial.scenes.worlds.drawn_world`, empty for the strip of 132 x 84 px
    """

    key: str
    null: str
    effects: tuple[tuple[str, str], ...]
    counterpart: str
    amplitudes: tuple[float, ...]
    geometry: Mapping[str, float]
    parameters: Mapping[str, float]
    paint: Mapping[str, float]
    seed: int
    solver: str
    world: Mapping[str, Any] = field(default_factory=dict)

    @property
    def group(self) -> str:
        return self.key.partition("/")[0]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(name for name, _ in self.effects)

    @property
    def content(self) -> dict:
        """JSON values under their stored keys."""
        return {STORED_AS.get(name, name): value for name, value in asdict(self).items()}

    @classmethod
    def read(cls, content: Mapping) -> Truth:
        """The truth of a sealed `content`."""
        fields = {name: content[STORED_AS.get(name, name)] for name in cls.__dataclass_fields__ if name != "world"}
        fields["world"] = content.get("world", {})  # truths that were sealed before there were worlds
        return cls(**fields | {"effects": tuple((n, s) for n, s in content["effects"]),
                               "amplitudes": tuple(content["amplitudes"])})


@dataclass(frozen=True)
class Campaign:
    """A list of trials and the seed of all their truths; photographs : folder of the size "pictures"."""

    size: str = "full"
    seed: int = 1
    singles: tuple[str, ...] = SINGLES
    photographs: str = ""
    trials: tuple[Trial, ...] = field(init=False)

    def __post_init__(self):
        if self.size not in SIZES:
            raise InputError("no such size of a trial", key="size", expected=", ".join(SIZES),
                             found=self.size, remedy="choose one of these sizes")
        if self.size == PICTURES:
            check_photographs(self.photographs)
            trials = _on_photographs(self.seed, self.photographs)
        elif self.size in (WORLDS, KNOWN_WORLDS):
            trials = _in_worlds(self.seed, self.size == KNOWN_WORLDS)
        else:
            trials = _trials(self.size, self.singles)
        object.__setattr__(self, "trials", trials)

    def select(self, only: Sequence[str] | None) -> tuple[Trial, ...]:
        """The trials of these keys, groups or beginnings of keys (``clean``, ``singles/plasticity``); all without any.

        Raises
        ------
        InputError
            If a word selects no trial.
        """
        if not only:
            return self.trials
        keys, chosen = {trial.key for trial in self.trials}, []
        for selection in only:
            group, slash, name = selection.partition("/")
            word = GROUP_NAMES.get(group, group) + slash + name
            fits = {word} & keys or {key for key in keys if key.startswith(word)}
            if not fits:
                raise InputError("there is no such trial", key="--only", found=selection,
                                 expected=f"{', '.join(GROUPS)}, or the beginning of {self.trials[0].key}",
                                 remedy="correct the word, or leave --only out to run all trials")
            chosen.append(fits)
        return tuple(trial for trial in self.trials if any(trial.key in fits for fits in chosen))


def _trials(size: str, singles: Sequence[str]) -> tuple[Trial, ...]:
    n = NUMBER[size]
    strengths_of_size = STRENGTHS if size == "full" else (CONCEALED,)
    trials = [Trial(f"singles/{name}-{strength}-{k}", EFFECTS[name].null, ((name, strength),))
             for k in range(n["singles"]) for strength in strengths_of_size for name in singles]
    trials += [Trial(f"clean/{k}", CLEAN_NULLS[k % len(CLEAN_NULLS)]) for k in range(n["clean"])]
    trials += [Trial(f"outside/{name}-{k}", effect.null, ((name, CLEAR),))
              for k in range(n["outside"]) for name, effect in OUTSIDE.items()]
    trials += [Trial(f"pairs/{first}+{second}-{k}", "elastic", ((first, PAIR_STRENGTH), (second, PAIR_STRENGTH)))
              for k in range(n["pairs"]) for first, second in PAIRS]
    for k in range(n["twins"]):
        for first, second, null in INDISTINGUISHABLE_PAIRS:
            name, counterpart = (first, second) if k % 2 == 0 else (second, first)
            trials.append(Trial(f"twins/{first}~{second}-{k}", null, ((name, CLEAR),), counterpart))
    return tuple(trials)


def _in_worlds(seed: int, known_alone: bool) -> tuple[Trial, ...]:
    """Trials in drawn worlds, in an order that the seed draws: its beginning is a sample of all.

    known_alone : no kind that is kept from development
    """
    n, library, beyond = WORLD_NUMBER, sorted(LIBRARY), sorted(BEYOND)
    trials = [Trial(f"singles/{name}-{strength}-{k}", LIBRARY[name].null, ((name, strength),), in_world=True)
             for k in range(n["singles"]) for strength in STRENGTHS for name in library]
    trials += [Trial(f"clean/{k}", ("elastic", "elastic", "plastic", "rubber")[k % 4], in_world=True)
              for k in range(n["clean"])]
    trials += [Trial(f"outside/{name}-{k}", BEYOND[name].null, ((name, CLEAR),), in_world=True)
              for k in range(n["outside"]) for name in beyond]
    trials += [Trial(f"pairs/{first}+{second}-{k}", "elastic", ((first, PAIR_STRENGTH), (second, PAIR_STRENGTH)),
                    in_world=True) for k in range(n["pairs"]) for first, second in PAIRS]
    if known_alone:
        trials = [trial for trial in trials if not any(is_unseen(name) for name, _ in trial.effects)]
    return _shuffled(trials, seed)


def _on_photographs(seed: int, folder: str) -> tuple[Trial, ...]:
    """Concealed effects on real surfaces: known kinds whose motion CalculiX computes, pairs, clean recordings."""
    kinds = [name for name in sorted(LIBRARY) if not is_unseen(name) and name not in NOT_BY_CALCULIX]
    trials = [Trial(f"singles/{name}-{CONCEALED}-0", LIBRARY[name].null, ((name, CONCEALED),)) for name in kinds]
    trials += [Trial(f"outside/{name}-0", BEYOND[name].null, ((name, CLEAR),))
              for name in sorted(BEYOND) if not is_unseen(name)]
    pairs = [pair for pair in PAIRS if not any(is_unseen(name) or name in NOT_BY_CALCULIX for name in pair)]
    chosen = np.random.default_rng([seed, 3]).permutation(len(pairs))[:PICTURES_NUMBER["pairs"]]
    trials += [Trial(f"pairs/{first}+{second}-0", "elastic", ((first, PAIR_STRENGTH), (second, PAIR_STRENGTH)))
              for first, second in (pairs[i] for i in sorted(chosen))]
    trials += [Trial(f"clean/{k}", ("elastic", "elastic", "plastic")[k % 3]) for k in range(PICTURES_NUMBER["clean"])]
    return _shuffled([replace(trial, in_world=True, photographs=folder) for trial in trials], seed)


def _shuffled(trials: Sequence[Trial], seed: int) -> tuple[Trial, ...]:
    return tuple(trials[i] for i in np.random.default_rng([seed, 2]).permutation(len(trials)))


def effect_named(name: str) -> Effect:
    """The effect of a kind."""
    return kind_named(name)


def effect_in(group: str, name: str) -> Effect:
    """The effect as trials of a group make it."""
    return indistinguishable_form(effect_named(name)) if group == "twins" else effect_named(name)


def draw(trial: Trial, seed: int) -> Truth:
    """Draw the truth of a trial: geometry, true parameters, amplitudes, texture and noise.

    A world that shows nothing of one of the effects at its largest plausible amplitude is drawn again: that would be a
    recording of no error, under the name of one.
    """
    rng = np.random.default_rng([seed, zlib.crc32(trial.key.encode())])
    null, effects = NULLS[trial.null], [effect_in(trial.group, name) for name, _ in trial.effects]
    for _ in range(MAX_WORLDS):
        world = drawn_world(rng, [name for name, _ in trial.effects], trial.null) if trial.in_world else {}
        if trial.photographs:
            world |= photographed_world(rng, trial.photographs)
        stiff, geometry = rng.uniform(0.95, 1.05), {"radius": float(rng.uniform(0.85, 1.15))}
        scaled = {name: float(value * (stiff if name not in ("nu", "kappa") else 1.0))
                  for name, value in null.truth.items()}
        amplitudes, is_visible = [], True
        for effect, (name, strength) in zip(effects, trial.effects, strict=True):
            sign = rng.choice([-1.0, 1.0]) if effect.signed else 1.0
            measured = STRENGTH_OF.get(name, name) if trial.group == "twins" else name
            size, is_shown = (amplitude_in(world, trial.null, scaled, effect, strength, photograph_of(world)) if world
                              else (strengths()[measured][strength]["amplitude"], True))
            amplitudes.append(float(sign * size))
            is_visible &= is_shown
        if is_visible:
            break
    scaled_known = scaled | ({"E": null.truth["E"]} if trial.null == "known" else {})
    paint = {"texture": int(rng.integers(2**31)), "noise": int(rng.integers(2**31)),
             "dots_px": float(rng.uniform(1.5, 1.7)), "noise_gv": 2.0}
    solver = "calculix" if any(effect.calculix for effect in effects) else "built-in"
    if trial.group == "clean":
        solver = "calculix" if int(trial.key.rpartition("/")[2]) % 10 == 0 else "built-in"
    if "viscoelasticity" in (name for name, _ in trial.effects):
        solver = "built-in"
    truth = Truth(trial.key, trial.null, trial.effects, trial.counterpart, tuple(amplitudes), geometry, scaled_known,
                  paint, int(rng.integers(2**31)), solver, world)
    by_calculix = bool(trial.photographs) or (bool(world) and scene_of(truth).solid)
    return replace(truth, solver="calculix" if by_calculix else solver) if world else truth


def scene_of(truth: Truth, with_effects: bool = True) -> Scene:
    """The scene of a truth, or the same test without its effects."""
    scene = (world_scene(truth.world, truth.null, truth.geometry["radius"], truth.parameters) if truth.world
             else plain_scene(truth.null, Geometry(**truth.geometry), truth.parameters))
    if not with_effects:
        return as_solid(truth.world, scene) if truth.world else scene
    rng = np.random.default_rng(truth.seed)
    for (name, _), amplitude in zip(truth.effects, truth.amplitudes, strict=True):
        scene = effect_in(truth.group, name).change(scene, amplitude, rng)
    return as_solid(truth.world, scene) if truth.world else scene


def paint_of(truth: Truth) -> Paint:
    photograph = photograph_of(truth.world)
    if photograph is not None:
        return on_photograph(int(truth.paint["texture"]), int(truth.paint["noise"]), photograph)
    return Paint(**truth.paint)


__all__ = ["CLEAR", "CONCEALED", "FAINT", "GROUPS", "Campaign", "Trial", "Truth", "draw", "effect_in", "effect_named",
           "paint_of", "scene_of"]
