"""``RUN/diagnosis.json``: a finished diagnosis under the stable keys of schema ``idic.diagnosis/1``."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy import stats

from idic.diagnose.candidates.heterogeneity import STIFFNESS, form_of
from idic.diagnose.locate.place import clusters, element_centres, in_words
from idic.diagnose.next_test import reason_against_continuation
from idic.diagnose.refit import MAX_EVALUATIONS
from idic.diagnose.residual.heldout import Fit, better_blocks, ratio
from idic.diagnose.screen.select import Ranked
from idic.diagnose.verdict import MIN_EXCESS_Z, MAX_EXCESS_LEFT, MAX_LOCAL_EXCESS_LEFT, Rival, Round
from idic.parameters import ParameterSet
from idic.report.diagnosis.words import sentence
from idic.report.words import short_names
from idic.run.diagnosis.chain import Diagnosis
from idic.store.result_file import RESULT_FILE, finite, read_result, write_json

DIAGNOSIS_FILE = "diagnosis.json"
SCHEMA = "idic.diagnosis/1"
MIN_ACTIVE_ELEMENTS = 60  # elements that share what acts evenly would be as many: fewer do not resolve its course in space
MIN_RIVAL_SHARE = 0.3  # of what the winner reached: who is not given up (`refit.EarlyStop`) may still overtake it
MIN_LEFT_SHARE = 0.1  # of the difference between the two, left of both
MIN_CLUSTER_SHARE, MAX_PLACES = 0.3, 3  # of the largest cluster: a place of its own; so many are said
MAX_WORSE_SHARE, MAX_WORSE_STD = 0.05, 5.0  # of the excess before, and standard deviations: worse, not alike
STATUS_WORDS = {"stalled": "no step lowered the residual", "max_iterations": "it had reached its limit of evaluations",
          "at_bound": "a parameter is at its bound", "forward_failed": "the simulation failed",
          "interrupted": "it was interrupted"}
MAX_LOCAL_ELEMENTS = 0.5  # of the elements; more is the whole body


def write_diagnosis(run: Path | str, diagnosis: Diagnosis, enriched: Path | None, wall_s: float,
                    blocks: list[dict] | None = None, further: Sequence[str] = ()) -> dict:
    """Write ``RUN/diagnosis.json``; returns its content.

    blocks : judgement on blocks of the recording (`idic.run.diagnosis.blocks`)
    further : cautions beside those of the diagnosis
    """
    run = Path(run)
    content = diagnosis_content(run, diagnosis, enriched, wall_s)
    content["fit"]["blocks"] = finite(blocks or [])
    content["cautions"] += further
    write_json(run / DIAGNOSIS_FILE, content)
    return json.loads((run / DIAGNOSIS_FILE).read_text(encoding="utf-8"))


def diagnosis_content(run: Path, diagnosis: Diagnosis, enriched: Path | None, wall_s: float) -> dict:
    """Everything that a program or a page wants to know."""
    verdict = diagnosis.verdict
    content = {
        "schema": SCHEMA, "verdict": verdict.word, "mismatch": _mismatch(diagnosis),
        "candidates": _candidates(diagnosis), "named": list(verdict.named),
        "indistinguishable": [list(group) for group in verdict.sets], "next_experiment": verdict.next_experiment,
        "model": {"parameters_before": _before(run), "parameters_after": _after(diagnosis),
                  "experiment": None if enriched is None else str(enriched.relative_to(run))},
        "fit": _fit(diagnosis), "excluded": [dict(entry) for entry in verdict.excluded],
        "cannot_tell": list(verdict.cannot_tell),
        "rounds": [_round(one) for one in diagnosis.rounds],
        "cost": dict(diagnosis.cost) | {"wall_s": wall_s},
    }
    content = finite(content)
    content["cautions"] = cautions(diagnosis)
    content["sentence"] = sentence(content, titles_of(diagnosis))
    return content


def titles_of(diagnosis: Diagnosis) -> dict[str, str]:
    """Candidate to its name in a reader's words."""
    return {r.candidate.name: r.candidate.title for one in diagnosis.rounds for r in one.screening.ranked}


def _mismatch(diagnosis: Diagnosis) -> dict:
    """What, where and when; null where nothing was located. The side is that of what was named, if anything was.

    Of a law that yields or is damaged the elements are those in which it acts in the enriched model; `pushing_elements`
    are those that the residual alone points at, and what the words and the figure show.
    """
    first = diagnosis.rounds[0]
    if diagnosis.mismatch is None:
        whole = diagnosis.whole_before
        keys = ("side", "onset_frame", "onset_ci", "visible_frame", "centroid_mm", "frames")
        content = dict.fromkeys(keys) | {"elements": [], "effect_px_rms": diagnosis.effect_px,
                                         "p_value": float(stats.chi2.sf(whole.gain.sum(), whole.rank.sum()))}
    else:
        content = diagnosis.mismatch.content(diagnosis.side, diagnosis.always, diagnosis.acts, diagnosis.bent)
    content["located_side"] = content["side"]
    content["side"] = diagnosis.side or content["side"]
    p_values = [content["p_value"], *(r.p_familywise for r in first.screening.ranked)]
    content["p_value"] = min(1.0, 2.0 * min(p_values))
    figure = "figures/diagnosis_where.png" if content["elements"] else None
    content["pushing_elements"] = content["elements"]
    if diagnosis.active is not None:
        acts = diagnosis.found.experiment.mesh.element_labels[diagnosis.active.since >= 0]
        content["elements"] = [int(label) for label in acts]
    return content | {"place": _place(diagnosis), "figure": figure, "active": _active(diagnosis)}


def _active(diagnosis: Diagnosis) -> dict | None:
    """Where and since when what was named acts in the enriched model; labels of the mesh file."""
    active = diagnosis.active
    if active is None:
        return None
    mesh = diagnosis.found.experiment.mesh
    centres = element_centres(mesh)[active.first]
    return {"verb": active.verb, "first_frame": active.first_frame, "elements": int((active.since >= 0).sum()),
            "of": mesh.n_elements, "first_elements": [int(label) for label in mesh.element_labels[active.first]],
            "first_mm": centres[np.argmax(active.amount[active.first])].tolist()}


def _place(diagnosis: Diagnosis) -> str | None:
    """Where, in words, if it is a part of the body and not all of it."""
    mismatch = diagnosis.mismatch
    if mismatch is None or not mismatch.has_place(diagnosis.side) or _everywhere(diagnosis):
        return None
    mesh, unit = diagnosis.found.experiment.mesh, diagnosis.found.experiment.length_unit
    if len(mismatch.elements) > MAX_LOCAL_ELEMENTS * mesh.n_elements:
        return None if diagnosis.active is None else f"first at {in_words(_active(diagnosis)['first_mm'])} {unit}"
    parts = clusters(mesh, mismatch.place.elements)
    centres = [element_centres(mesh)[part].mean(axis=0) for part in parts if len(part) > MIN_CLUSTER_SHARE * len(parts[0])]
    points = [in_words(centre) for centre in centres[:MAX_PLACES]]
    return f"around {' and '.join(points)} {unit}" + (" and elsewhere" if len(centres) > MAX_PLACES else "")


def _everywhere(diagnosis: Diagnosis) -> bool:
    winner = diagnosis.rounds[0].winner
    return winner is not None and bool(diagnosis.always) and acts_everywhere(winner.ranked)


def acts_everywhere(named: Ranked) -> bool:
    """Whether a candidate that is there from the start has no place on the body: a law, a stiffness that changes along
    it. A spot has one, and so has a grip."""
    return named.candidate.family not in ("heterogeneity", "boundary") or named.variant.form == "gradient"


def cautions(diagnosis: Diagnosis) -> list[str]:
    """What a careful reader would want to be told beside the error bars."""
    before, after = diagnosis.verdict.before, diagnosis.verdict.after
    shaky = search_cautions(diagnosis.found.state.status, before.excess, after.excess, before.excess_std)
    return [*shaky, *_formal_fit(diagnosis), *_few_elements(diagnosis), *_not_simulated(diagnosis),
            *refits_cut_short(diagnosis.rounds), *rivals_not_ruled_out(diagnosis.rounds, diagnosis.verdict.after)]


def _formal_fit(diagnosis: Diagnosis) -> list[str]:
    """Where what was named leaves too much of what follows it, or of what is where it was put: the clearer of these."""
    left = max((one for one in diagnosis.left if one.matters), key=lambda one: one.after.excess_z, default=None)
    if left is None:
        return []
    if left.after.excess > left.before.excess > 0.0:
        return ["What is named does not fit: motions that come and go with it, or are where it was put, are explained worse "
                f"with it than without it ({left.motion_px:.2g} px rms are left)."]
    spot = left.max_share != MAX_EXCESS_LEFT
    what = "It is no spot of another stiffness" if spot else "What is named does not fit"
    which = "right where one was fitted" if left.max_share == MAX_LOCAL_EXCESS_LEFT else "that comes and goes with it"
    look = (" Look at the specimen there: a cut, a crack or a part of another shape gives way like that." if spot else "")
    before = left.before
    part = f", {left.after.excess / before.excess:.1%} of what there was" if before.excess > before.excess_std else ""
    return [f"{what}: {left.motion_px:.2g} px rms of motion {which} are left "
            f"({left.after.excess_z:.0f} standard deviations{part}).{look}"]


def search_cautions(status: str, before: float, after: float, std: float) -> list[str]:
    """Where the identification had not arrived, and where the motions are explained worse in the end.

    status : of the identification; before, after : held-out excess of the motions; std : what noise makes of it
    """
    found = []
    if status != "converged":
        found.append(f"The identification had not converged ({STATUS_WORDS.get(status, status)}): part of what it leaves may "
                     "be the search's and no physics', and then what is named here is the nearest thing to it.")
    if after - before > max(MAX_WORSE_SHARE * abs(before), MAX_WORSE_STD * std):
        found.append("The motions are explained worse with what was named than without it (held-out excess "
                     f"{before:.3g} before, {after:.3g} after): it has taken up grey values or readings.")
    return found


def refits_cut_short(rounds: Sequence[Round]) -> list[str]:
    """Where the order of a winner and those close behind it was decided before their refits had ended."""
    found = []
    for one in (r for r in rounds if r.winner is not None):
        near = [rival for rival in one.rivals
                if rival.refitted.usable and rival.achieved > MIN_RIVAL_SHARE * one.winner.achieved]
        names = [rival.ranked.called for rival in near if rival.refitted.status == "max_iterations"]
        if len(near) > 1 and names:
            found.append(f"{one.winner.ranked.called} was preferred as the refits stood after {MAX_EVALUATIONS} evaluations; "
                         f"not at their end were: {', '.join(names)}. Their order may be another one.")
    return found


def rivals_not_ruled_out(rounds: Sequence[Round], after: Fit) -> list[str]:
    """Where so much is left in the end that a known rival of what was named may be the cause as well.

    Differences between wrong models are significant on every real camera. Where what is left is a tenth of one, what
    both leave out may decide its sign.

    after : of the last model, held out
    """
    if not after.excess_z > MIN_EXCESS_Z:
        return []
    left, found = float(after.gain.sum() - after.rank.sum()), []
    for one in (r for r in rounds if r.winner is not None):
        winner, named = one.winner, one.winner.ranked
        for rival in one.rivals:
            other = rival.ranked
            why = named.candidate.rivals.get(other.candidate.name) or other.candidate.rivals.get(named.candidate.name)
            near = rival.refitted.usable and rival.achieved > MIN_RIVAL_SHARE * winner.achieved
            if (why and near and rival is not winner and rival.name not in one.equals
                    and left > MIN_LEFT_SHARE * (winner.achieved - rival.achieved)):
                found.append(f"{other.called} is not ruled out: it comes to {rival.achieved / winner.achieved:.1%} of what "
                             f"{named.called} explains, and what is left in the end is a good part of the difference "
                             f"({why}).")
    return found


def _not_simulated(diagnosis: Diagnosis) -> list[str]:
    """Why the next experiment is the general one, where a record could not tell some candidates apart."""
    reason = reason_against_continuation(diagnosis.found.experiment) if diagnosis.verdict.sets else None
    if reason is None:
        return []
    return [f"The next experiment is what generally tells such causes apart; none was simulated with these models: {reason}."]


def _few_elements(diagnosis: Diagnosis) -> list[str]:
    active = diagnosis.active
    if active is None:
        return []
    carry = float(active.amount.sum() ** 2 / max((active.amount**2).sum(), 1e-300))
    if carry > MIN_ACTIVE_ELEMENTS:
        return []
    new = [name for one in diagnosis.rounds if one.winner is not None and one.winner.ranked.candidate.side == "bulk"
           for name in one.winner.refitted.stds if name not in one.null.stds]
    if not new:
        return []
    names = ", ".join(short_names(new)[name].replace("_", " ") for name in new)
    return [f"It acts in {int((active.since >= 0).sum())} of {len(active.since)} elements and mostly in about "
            f"{max(carry, 1.0):.0f} of them: the error bars of what it brings ({names}) know noise only, not how coarse "
            "the mesh is there. Identify the enriched model and ask  idic systematic,  or refine the mesh."]


def _candidates(diagnosis: Diagnosis) -> list[dict]:
    """Every candidate once, by its standing in the first round, or in the round that named it."""
    entries = {}
    for one in diagnosis.rounds:
        rivals = {rival.ranked.key: rival for rival in one.rivals}
        for ranked in one.screening.ranked:
            name = ranked.candidate.name
            won = one.winner is not None and one.winner.ranked.key == ranked.key
            if name not in entries or won:
                entries[name] = _candidate(ranked, rivals.get(ranked.key), one)
    for entry in entries.values():
        entry["named"] = entry["name"] in diagnosis.verdict.named
    return sorted(entries.values(), key=lambda entry: -(entry["score"] or 0.0))


def _candidate(ranked: Ranked, rival: Rival | None, one: Round) -> dict:
    usable = rival is not None and rival.refitted.usable
    return {
        "name": ranked.candidate.name, "family": ranked.candidate.family,
        "form": _form(ranked, rival if usable else None),
        "place_mm": None if ranked.variant.place is None else list(ranked.variant.place),
        "label": ranked.label, "score": ranked.statistic, "p_familywise": ranked.p_familywise,
        "expected_change": _expected(ranked), "expected_change_std": ranked.std, "visibility": ranked.visibility,
        "effect_px_rms": ranked.effect_px, "effect_channel_std": ranked.effect_channel,
        "bias_uncovered": dict(ranked.bias), "standing": ranked.verdict,
        "predicted_chi2_drop": ranked.gain, "achieved_chi2_drop": rival.achieved if usable else None,
        "heldout_chi2_drop": rival.heldout if usable else None,
        "heldout_copies": rival.copies if usable else None,
        "heldout_ratio": ratio(*one.heldout_fits(rival)) if usable else None,
        "refitted": usable, "problem": rival.refitted.problem if rival is not None else ""}


def _form(ranked: Ranked, rival: Rival | None) -> str | None:
    """Of a variant; a spot that its refit leaves next to no stiffness is a void."""
    dof = next((name for name in ranked.variant.new if name.endswith(STIFFNESS)), None)
    if dof is None or rival is None:
        return ranked.variant.form
    return form_of(rival.refitted.values[dof])


def _expected(ranked: Ranked) -> dict[str, float]:
    """The change that the residual asks for: of the degree of freedom, or as a part of the probe."""
    return {ranked.label: ranked.amplitude}


def _before(run: Path) -> dict:
    result = read_result(run) if (run / RESULT_FILE).exists() else {}
    return {name: {key: entry.get(key) for key in ("value", "std", "unit")}
            for name, entry in result.get("parameters", {}).items() if entry.get("free")}


def _after(diagnosis: Diagnosis) -> dict:
    if diagnosis.final is None or not diagnosis.final.usable:
        return {}
    parameters: ParameterSet = diagnosis.residual_after.context.experiment.parameters
    shown = {}
    for name, std in diagnosis.final.stds.items():
        factor = parameters[name].factor
        shown[name] = {"value": diagnosis.final.values[name] / factor,
                       "std": None if std is None else std / abs(factor),
                       "unit": parameters[name].unit}
    return shown


def _fit(diagnosis: Diagnosis) -> dict:
    before, after = diagnosis.verdict.before, diagnosis.verdict.after
    better, worst = better_blocks(before, after)
    return {"affected_blocks_better": better, "unaffected_block_worse": worst,
            "heldout_excess_before": before.excess, "heldout_excess_after": after.excess,
            "heldout_excess_std": before.excess_std, "explainable_share_recovered": diagnosis.verdict.share,
            "heldout_channel_chi2_before": _by_channel(diagnosis, before),
            "heldout_channel_chi2_after": _by_channel(diagnosis, after)}


def _by_channel(diagnosis: Diagnosis, one: Fit) -> Mapping[str, float]:
    names = [channel.column for channel in diagnosis.found.experiment.channels]
    return dict(zip(names, np.asarray(one.channel_chi2).tolist(), strict=True))


def _round(one: Round) -> dict:
    new = () if one.winner is None else [name for name in one.winner.refitted.stds if name not in one.null.stds]
    return {"winner": one.winner.name if one.winner else None,
            "form": _form(one.winner.ranked, one.winner) if one.winner else None, "new": list(new),
            "equals": list(one.equals),
            "shortlist": [rival.name for rival in one.rivals], "null_excess": one.null.judgement.excess}
