"""Evaluation of the answers against the sealed truths; it shares no code with the decisions of the tool."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

import numpy as np

from idic.diagnose import FAMILIES
from idic_studies.trial.kinds import is_unseen
from idic_studies.trial.plan import Truth, effect_named, scene_of
from idic_studies.trial.scenes.recording import as_logged, model_mesh
from idic_studies.trial.scenes.scene import Scene
from idic_studies.trial.scenes.solve import Motion, solve
from idic_studies.trial.seal import Folder
from idic_studies.trial.strength import apparent
from idic_studies.trial.trial import NOT_GENERATED, motion_of

ONSET_MOTION_SHARE = 0.02  # of the largest motion of an effect: its onset
BIASED_FROM_STD = 3.0  # standard deviations from the truth
NO_ALARM = ("none", "blind")  # verdicts
NOT_NAMED = (*NO_ALARM, "outside_library", "failed", NOT_GENERATED)  # verdicts


@dataclass(frozen=True)
class TrialRecord:
    """One evaluated trial; its fields are the keys of ``records.json``.

    Attributes
    ----------
    truth, strength : names of the effects, their strength ("" for clean recordings)
    named, reported : selected candidates; the same with their indistinguishable alternatives
    alarm : any verdict but "none" or "blind"
    family_first : the first name belongs to the family of a true effect; inside : `reported` holds every true effect,
        or calls a slit a cut (`told_as_cut`)
    as_set : the truth and its indistinguishable counterpart are reported as one set
    side_right : side of the located mismatch
    onset_error : frames, signed; overlap : of the elements, intersection over union; None without a true or a
        reported value
    excess_ratio : held-out excess after over before; drop_ratio : achieved over predicted drop of chi-square, first
        name
    blocks_better : share of the blocks on which the enriched model is better
    world, unseen : the drawn world; whether development never sees the kind
    false_physics : a material cause is named that is not in the truth
    probability : that the tool gives its set
    intervals : parameters of the last model whose 95 % interval holds the truth, of so many
    bias_before, bias_ratio : largest distance of a parameter from the truth, in standard deviations; the median of
        after over before of those that were off by more than `BIASED_FROM_STD`
    """

    key: str
    number: str
    truth: tuple[str, ...]
    strength: str
    solver: str
    verdict: str
    named: tuple[str, ...]
    reported: tuple[str, ...]
    alarm: bool
    family_first: bool
    inside: bool
    as_set: bool
    side_right: bool
    onset_error: float | None
    overlap: float | None
    excess_ratio: float | None
    drop_ratio: float | None
    bias_before: float | None
    bias_ratio: float | None
    blocks_better: float | None
    cpu_s: float
    attempt: int
    ablations: Mapping[str, Mapping] | None
    sentence: str
    world: Mapping[str, object] = field(default_factory=dict)
    unseen: bool = False
    false_physics: bool = False
    probability: float | None = None
    intervals: tuple[int, int] = (0, 0)

    @property
    def group(self) -> str:
        return self.key.partition("/")[0]

    @property
    def content(self) -> dict:
        return asdict(self)


def evaluated(folder: Folder, number: str, truth: Truth, answer: Mapping) -> TrialRecord:
    """Compare an answer with its truth."""
    effects = [effect_named(name) for name in truth.names]
    named = tuple(answer.get("named", ()))
    sets = answer.get("indistinguishable", ())
    reported = tuple(dict.fromkeys([*named, *(name for group in sets for name in group)]))
    families = {c["name"]: c["family"] for c in answer.get("candidates", ())}
    identified = answer.get("identified", {}).get("parameters", {})
    mismatch = answer.get("mismatch", {})
    silent = not effects or answer["verdict"] in ("failed", NOT_GENERATED, *NO_ALARM)
    onset, elements = (None, None) if silent else true_onset_and_place(folder, number, truth)
    bias = _bias(truth, identified, answer.get("model", {}).get("parameters_after", {}))
    first = named[0] if named else None
    as_cut = told_as_cut(scene_of(truth), answer)
    true = {effect.name for effect in effects} | _implied(truth) | ({"heterogeneity", "crack"} if as_cut else set())
    bulk = [name for name in named if name in families and FAMILIES[families[name]].side == "bulk"]  # no spots
    is_named = answer["verdict"] not in NOT_NAMED
    return TrialRecord(
        truth.key, number, truth.names, truth.effects[0][1] if truth.effects else "", truth.solver, answer["verdict"],
        named, reported, answer["verdict"] not in NO_ALARM and not (is_named and set(named) <= _implied(truth)),
        first is not None and families.get(first) in [effect.family for effect in effects],
        bool(effects) and all(effect.name in reported or (effect.name == "slit" and as_cut) for effect in effects),
        any({*truth.names, truth.counterpart} <= set(group) for group in sets),
        mismatch.get("side") in [effect.side for effect in effects],
        _difference(mismatch.get("onset_frame"), onset), _overlap(mismatch.get("elements"), elements),
        _ratio(answer.get("fit", {})), _drop(answer, first), *bias, _blocks(answer),
        float(answer.get("cost", {}).get("cpu_s", 0.0)),
        int(answer.get("attempt", 1)), answer.get("ablations"), answer.get("sentence", answer.get("problem", "")),
        truth.world, any(is_unseen(name) for name in truth.names), is_named and bool(set(bulk) - true),
        answer.get("probability"), _intervals(truth, identified | _last(answer.get("model", {}))))


def told_as_cut(scene: Scene, answer: Mapping) -> bool:
    """Whether a slit is named at its place: a crack whose middle is no farther from the slit than half of the crack's
    length, or "a void, a cut or a crack" whose centre is no farther from it than its radius. An inclusion of some
    stiffness is a wrong name.
    """
    return bool(scene.slit) and any(_from_slit(scene, place) <= reach for place, reach in _cuts(answer))


def _cuts(answer: Mapping) -> list[tuple[np.ndarray, float]]:
    """Middle (mm) and half length of every crack and void that an answer names."""
    named = {c["name"]: c for c in answer.get("candidates", ()) if c.get("named")}
    values = {name.rpartition(".")[2]: entry["value"] for name, entry in _last(answer.get("model", {})).items()
              if ".inclusion." in name}
    cuts = []
    if named.get("heterogeneity", {}).get("form") == "void" and {"x", "y", "radius"} <= set(values):
        cuts.append((np.array([values["x"], values["y"]]), values["radius"]))
    for crack in answer.get("cracks", {}).values() if "crack" in named else ():
        turn, half = np.radians(crack["direction_deg"]), 0.5 * max(crack["length_mm"])
        cuts.append((np.array(crack["start_mm"]) + half * np.array([np.cos(turn), np.sin(turn)]), half))
    return cuts


def _from_slit(scene: Scene, place: np.ndarray) -> float:
    edge = scene.geometry.radius
    return float(np.hypot(place[0], place[1] - np.clip(place[1], edge, edge + scene.slit)))


def _last(model: Mapping) -> Mapping:
    """Parameters of the last model; of a body of real thickness and finite strains where the answer states them."""
    return model.get("parameters_after", {}) | model.get("parameters_of_real_body", {})


def _implied(truth: Truth) -> set[str]:
    """What is in the truth of a world without being one of its effects: finite strains under a law of small ones, and
    the pressure in the yield condition of CalculiX.

    CalculiX compares the Cauchy stress with its flow stress, idic's laws the Kirchhoff stress, J times as large. At
    1.5 % of yield strain tension yields by 0.5 % later than in CalculiX and compression by 0.5 % earlier: in idic's
    stress that truth is a yield that depends on the pressure.
    """
    scene = scene_of(truth)
    if not truth.world:
        return set()
    finite = scene.has_finite_strains and scene.user_has_small_strains
    return ({"geometric_nonlinearity"} if finite else set()) | (
        {"pressure_dependence"} if _yields_by_cauchy_stress(truth, scene) else set())


def _yields_by_cauchy_stress(truth: Truth, scene: Scene) -> bool:
    return truth.solver == "calculix" and "yield_stress" in scene.values


def generated_values(truth: Truth, scene: Scene) -> dict[str, float]:
    """Values of the scene's law in the definitions of idic.

    The flow stress of CalculiX is a Cauchy stress s. In uniaxial tension J = 1 + (1 - 2 nu) s / E, and the Kirchhoff
    stress is J s, its slope over the plastic strain that of s times 1 + 2 (1 - 2 nu) s / E.
    """
    values = dict(scene.values)
    if not _yields_by_cauchy_stress(truth, scene):
        return values
    dilation = (1.0 - 2.0 * values["nu"]) * values["yield_stress"] / values["E"]
    slopes = {name: values[name] * (1.0 + 2.0 * dilation) for name in ("hardening_modulus",) if name in values}
    return values | slopes | {"yield_stress": values["yield_stress"] * (1.0 + dilation)}


def _intervals(truth: Truth, entries: Mapping) -> tuple[int, int]:
    """How many parameters of the null have a 95 % interval that holds the truth, and how many have one."""
    generated, n_held, n = generated_values(truth, scene_of(truth)), 0, 0
    for name in truth.parameters:
        entry = entries.get(f"BODY.{name}", {})
        if name in generated and entry.get("std"):
            n += 1
            n_held += abs(entry["value"] - generated[name]) <= 1.96 * entry["std"]
    return int(n_held), n


def true_onset_and_place(folder: Folder, number: str, truth: Truth) -> tuple[int | None, frozenset[int] | None]:
    """Onset frame of the only effect, and labels of the model's elements where it sits; None where it has none."""
    if len(truth.names) != 1:
        return None, None
    effect, scene = effect_named(truth.names[0]), scene_of(truth)
    if not effect.begins and scene.modulus is None:
        return 0, None
    motion = motion_of(folder, number, truth, scene)
    onset = _onset(scene, scene_of(truth, False)) if effect.begins else 0
    return onset, _elements(scene, motion)


def _onset(scene: Scene, plain: Scene) -> int:
    """The first frame in which the motion of the effect reaches `ONSET_MOTION_SHARE` of its largest one.

    Both motions come from the built-in solver: the difference of two solvers is as large as this threshold.
    """
    motion = solve(scene)
    plain = as_logged(scene, plain, motion)
    plain_motion = solve(plain)
    size = np.array([np.sqrt(np.mean((apparent(scene, motion, k) - apparent(plain, plain_motion, k)) ** 2))
                     for k in range(len(scene.times))])
    return int(np.argmax(size > ONSET_MOTION_SHARE * size.max()))


def _elements(scene: Scene, motion: Motion) -> frozenset[int] | None:
    """Elements of the model: the inclusion, or the elements strained beyond yield."""
    mesh = model_mesh(scene.geometry, scene.view)
    centres = mesh.nodes[mesh.blocks[0].connectivity[:, :4]].mean(axis=1)
    if scene.modulus is not None:
        inside = scene.modulus(centres) != 1.0
    elif "yield_stress" in scene.values:
        inside = yielded(scene, motion, centres)
    else:
        return None
    return frozenset(int(label) for label in mesh.element_labels[inside])


def yielded(scene: Scene, motion: Motion, points: np.ndarray) -> np.ndarray:
    """Whether the true element next to a point was ever strained beyond elasticity  # (n,) bool

    Equivalent strain of its corners' mean gradient, plane stress, against yield stress / 3 G.
    """
    block, E, nu = motion.mesh.blocks[0], scene.values["E"], scene.values["nu"]
    corners = motion.mesh.nodes[block.connectivity[:, :4]]
    gradient = np.stack([[-1, 1, 1, -1], [-1, -1, 1, 1]], axis=1) / 4.0  # of the bilinear shape at the middle
    inverse = np.linalg.inv(np.einsum("eai,ak->eik", corners, gradient))
    H = np.einsum("teai,ak,ekj->teij", motion.u[:, block.connectivity[:, :4]], gradient, inverse)
    strain = 0.5 * (H + H.swapaxes(2, 3))
    third = -nu / (1.0 - nu) * (strain[..., 0, 0] + strain[..., 1, 1])
    mean = (strain[..., 0, 0] + strain[..., 1, 1] + third) / 3.0
    square = (strain**2).sum(axis=(2, 3)) + third**2 - 3.0 * mean**2
    beyond = np.sqrt(2.0 / 3.0 * square).max(axis=0) > scene.values["yield_stress"] * 2.0 * (1.0 + nu) / (3.0 * E)
    nearest = np.argmin(((points[:, None] - corners.mean(axis=1)[None]) ** 2).sum(axis=2), axis=1)
    return beyond[nearest]


def _difference(estimate, true) -> float | None:
    return None if estimate is None or true is None else float(estimate - true)


def _overlap(estimate, true: frozenset[int] | None) -> float | None:
    if true is None or not true:
        return None
    estimate = set(estimate or ())
    return len(estimate & true) / len(estimate | true)


def _ratio(fit: Mapping) -> float | None:
    excess_before, excess_after = fit.get("heldout_excess_before"), fit.get("heldout_excess_after")
    return None if not excess_before or excess_before <= 0.0 or excess_after is None else max(excess_after,
                                                                                              0.0) / excess_before


def _blocks(answer: Mapping) -> float | None:
    blocks = answer.get("fit", {}).get("blocks") or ()
    return float(np.mean([bool(block["better"]) for block in blocks])) if blocks else None


def _drop(answer: Mapping, first: str | None) -> float | None:
    for entry in answer.get("candidates", ()):
        if entry["name"] == first and entry.get("achieved_chi2_drop") and entry.get("predicted_chi2_drop"):
            return entry["achieved_chi2_drop"] / entry["predicted_chi2_drop"]
    return None


def _bias(truth: Truth, identified: Mapping, refitted: Mapping) -> tuple[float | None, float | None]:
    """Largest distance from the truth before, in standard deviations; median of after over before."""
    sizes, ratios, generated = [], [], scene_of(truth).values
    for name in truth.parameters:
        full, true = f"BODY.{name}", generated.get(name)  # an effect may change the true value of the null's parameter
        if true is None or full not in identified or not identified[full]["std"]:
            continue
        sizes.append(abs(identified[full]["value"] - true) / identified[full]["std"])
        if sizes[-1] > BIASED_FROM_STD and full in refitted:
            ratios.append(abs(refitted[full]["value"] - true) / abs(identified[full]["value"] - true))
    return (max(sizes) if sizes else None), (float(np.median(ratios)) if ratios else None)
