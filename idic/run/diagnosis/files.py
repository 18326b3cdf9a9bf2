"""``RUN/diagnosis.json``: a finished diagnosis under the stable keys of schema ``idic.diagnosis/1``."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from idic.diagnose import (
    Diagnosis, Fit, Misfit, Ranked, Rival, Round, better_blocks, cautions, content as courses_content, in_words,
    left_place, mismatch_content, ratio, refitted_form, unexplained,
)
from idic.experiment_file import to_toml
from idic.inside import is_inside, read_inside
from idic.parameters import ParameterSet
from idic.report import diagnosis_headline, left_over, not_excluded, sentence, with_spots
from idic.run.diagnosis.crack import cracks_content
from idic.run.store.result_file import RESULT_FILE, finite, read_result, write_json

DIAGNOSIS_FILE = "diagnosis.json"
SCHEMA = "idic.diagnosis/1"
SEPARATE = "idic design --separate RUN PLAN... ranks planned tests by how well they tell these candidates apart"
MAX_NEAREST = 2  # further candidates that are told beside a remaining residual


def write_diagnosis(run: Path | str, verdict: Mapping, enriched: Path | None, wall_s: float,
                    notes: Sequence[str] = ()) -> dict:
    """Write ``RUN/diagnosis.json``; returns its content.

    verdict : what does not change any more (`diagnosis_content`)
    notes : parts beside the verdict that failed
    """
    run = Path(run)
    model = verdict["model"] | {"experiment": None if enriched is None else enriched.relative_to(run).as_posix()}
    content = dict(verdict) | {
        "model": model, "cost": verdict["cost"] | {"wall_s": wall_s}, "notes": list(notes),
        "cautions": [*verdict["cautions"], *notes]}
    write_json(run / DIAGNOSIS_FILE, content)
    return json.loads(read_inside(run, DIAGNOSIS_FILE))


def diagnosis_content(diagnosis: Diagnosis, parameters_before: Mapping[str, Mapping], wall_s: float = 0.0) -> dict:
    """The content of ``RUN/diagnosis.json`` without what comes after the verdict: the enriched experiment, notes.

    parameters_before : value, std, unit of the identified model's free parameters (`identified_parameters`)
    """
    if (spots := diagnosis.spots) is not None:
        without = free_parameters(spots.result)
        content = diagnosis_content(replace(diagnosis, spots=None), without, wall_s)
        return finite(with_spots(content, spots, parameters_before, without,
                                 diagnosis.identification.experiment.model.length_unit))
    parameters_after = _after(diagnosis)
    real_body = of_real_body(diagnosis, parameters_after or parameters_before)
    final = {name: real_body.get(name) or parameters_after.get(name) or entry
             for name, entry in parameters_before.items()}
    verdict, left_open = diagnosis.verdict, not_excluded(diagnosis, final)
    margin = diagnosis.state.setting.margin
    open_names = {entry["name"] for entry in left_open}
    content = {
        "schema": SCHEMA, "verdict": verdict.word, "mismatch": mismatch_content(diagnosis),
        "unexplained": list(unexplained(diagnosis)), "candidates": _candidates(diagnosis),
        "named": list(verdict.selected),
        "indistinguishable": [list(group) for group in verdict.indistinguishable],
        "next_experiment": verdict.next_experiment,
        "separate": SEPARATE if any(len(group) > 1 for group in verdict.indistinguishable) else None,
        "model": {"parameters_before": parameters_before, "parameters_after": parameters_after,
                  "parameters_of_real_body": real_body, "experiment": None},
        "fit": _fit(diagnosis),
        "excluded": [dict(entry) for entry in verdict.excluded if entry["name"] not in open_names],
        "cannot_tell": list(verdict.cannot_tell), "beyond_plausible": list(verdict.beyond_plausible),
        "odds": diagnosis.odds, "chain": diagnosis.chain, "probability": diagnosis.probability,
        "camera_floor_px": None if margin.floor is None else margin.floor.px,
        "left": _left(diagnosis),
        "courses": _courses(diagnosis), "cracks": cracks_content(diagnosis),
        "free_end": None if diagnosis.state.end is None else diagnosis.state.end.content(
            list(parameters_before), diagnosis.identification.experiment.model.parameters),
        "free_form": None if diagnosis.free_form is None else diagnosis.free_form.content(),
        "spots": [],
        "register": None if diagnosis.register is None else diagnosis.register.content(),
        "rounds": [_round(selection_round) for selection_round in diagnosis.rounds], "margin": margin.content(),
        "refits": [{"name": model.fit.name, "edits": to_toml(dict(model.source.edits)),
                    "values": dict(model.fit.values)} for model in diagnosis.refitted],
        "cost": dict(diagnosis.state.setting.clock.seconds) | {"wall_s": wall_s},
    }
    content = finite(content)
    titles = titles_of(diagnosis)
    content["cautions"] = cautions(diagnosis)
    content["sentence"] = sentence(content, titles)
    content["headline"] = diagnosis_headline(content, titles)
    content["left_over"] = left_over(content, titles)
    content["not_excluded"] = [entry | {"title": titles.get(entry["name"], entry["name"])}
                               for entry in left_open]
    return content


def _left(diagnosis: Diagnosis) -> dict:
    """What the last model leaves on the whole recording: motion, channels."""
    excess, experiment = diagnosis.remainder.excesses[0], diagnosis.identification.experiment
    enriched = diagnosis.enriched
    place = None if enriched is None else left_place(enriched.residual, diagnosis.identified.grid)
    return {"motion_px": excess.motion_px, "motion_z": excess.after.excess_z,
            "motion_share": excess.share if diagnosis.verdict.selected else None,
            "place_mm": None if place is None else place.tolist(),
            "place": None if place is None else
            f"around {in_words(place, size=experiment.model.mesh.size)} {experiment.model.length_unit}",
            "nearest": _nearest(diagnosis),
            "channels": [{"column": channel.column, "z": channel.z, "share": channel.share,
                          "reading_share": channel.reading_share,
                          "significant": channel.is_significant, "matters": channel.matters}
                         for channel in diagnosis.remainder.channels]}


def _nearest(diagnosis: Diagnosis) -> list[str]:
    """Candidates beside the last model that are significant and not selected, the strongest first."""
    last_round, verdict = diagnosis.rounds[-1], diagnosis.verdict
    in_model = set(verdict.selected).union(*verdict.indistinguishable)
    candidates = sorted((r for r in last_round.screening.ranked if r.standing in ("significant", "small")
                         and r.candidate.name not in in_model), key=lambda r: -r.statistic)
    return list(dict.fromkeys(r.candidate.name for r in candidates))[:MAX_NEAREST]


def _courses(diagnosis: Diagnosis) -> list[dict]:
    """Course and error band of every selected cause that is no material."""
    courses = [course for selection_round in diagnosis.rounds if selection_round.winner is not None
               for course in diagnosis.courses(selection_round)]
    return courses_content(courses, diagnosis.identification.experiment.model.times)


def titles_of(diagnosis: Diagnosis) -> dict[str, str]:
    """Name of a candidate to its title in standard words."""
    left_out = {c.name: c.title for selection_round in diagnosis.rounds
                for c, _ in selection_round.screening.untestable}
    return left_out | {r.candidate.name: r.candidate.title for selection_round in diagnosis.rounds
                       for r in selection_round.screening.ranked}


def _candidates(diagnosis: Diagnosis) -> list[dict]:
    """Every candidate once, by its standing in the first round, or in the round that selected it."""
    entries = {}
    for selection_round in diagnosis.rounds:
        rivals = {rival.ranked.key: rival for rival in selection_round.rivals}
        for ranked in selection_round.screening.ranked:
            name = ranked.candidate.name
            won = selection_round.winner is not None and selection_round.winner.ranked.key == ranked.key
            if name not in entries or won:
                entries[name] = _candidate(ranked, rivals.get(ranked.key), selection_round)
    for entry in entries.values():
        entry["named"] = entry["name"] in diagnosis.verdict.selected
    return sorted(entries.values(), key=lambda entry: -(entry["score"] or 0.0))


def _candidate(ranked: Ranked, rival: Rival | None, selection_round: Round) -> dict:
    usable = rival is not None and rival.refitted.usable
    return {
        "name": ranked.candidate.name, "family": ranked.candidate.family,
        "form": refitted_form(ranked, rival if usable else None),
        "place_mm": None if ranked.variant.place is None else list(ranked.variant.place),
        "label": ranked.label, "score": ranked.statistic, "p_familywise": ranked.p_familywise,
        "expected_change": _expected(ranked), "expected_change_std": ranked.std, "visibility": ranked.visibility,
        "effect_px_rms": ranked.effect_px, "effect_px_local": ranked.local_px,
        "effect_channel_std": ranked.effect_channel, "bias_uncovered": dict(ranked.bias),
        "standing": ranked.standing if rival is None or rival.is_large else "small",
        "predicted_chi2_drop": ranked.gain, "achieved_chi2_drop": rival.achieved if usable else None,
        "heldout_chi2_drop": rival.heldout if usable else None,
        "heldout_copies": rival.copies if usable else None,
        "heldout_ratio": ratio(*selection_round.heldout_fits(rival)) if usable else None,
        "refitted": usable, "problem": rival.refitted.problem if rival is not None else ""}


def _expected(ranked: Ranked) -> dict[str, float]:
    """The change that the residual asks for: of the degree of freedom, or as a part of the probe."""
    return {ranked.label: ranked.amplitude}


def identified_parameters(run: Path | str) -> dict:
    """Value, std, unit of the free parameters of a RUN; {} without a result.json."""
    run = Path(run)
    return free_parameters(read_result(run) if is_inside(run, RESULT_FILE) else {})


def free_parameters(result: Mapping) -> dict[str, dict]:
    """Value, std, unit of the free parameters of a result (result.json)."""
    return {name: {key: entry.get(key) for key in ("value", "std", "unit")}
            for name, entry in result.get("parameters", {}).items() if entry.get("free")}


def _after(diagnosis: Diagnosis) -> dict:
    if diagnosis.enriched is None:
        return {}
    return _refitted(diagnosis.enriched.fit, diagnosis.last_parameters)


def _refitted(refit: Fit, parameters: ParameterSet) -> dict[str, dict]:
    """Value, std, unit of the free parameters of a refit."""
    entries = {}
    for name, std in refit.stds.items():
        factor = parameters[name].factor
        entries[name] = {"value": refit.values[name] / factor, "std": None if std is None else std / abs(factor),
                         "unit": parameters[name].unit}
    return entries


def of_real_body(diagnosis: Diagnosis, entries: Mapping[str, Mapping]) -> dict[str, dict]:
    """Value and std of a body of real thickness and finite strains, where the last model neglects them and its
    parameters depend on them; {} elsewhere.

    entries : their value, std and unit
    """
    neglected, parameters = diagnosis.neglected, diagnosis.last_parameters
    if diagnosis.corrected is not None:
        entries = _refitted(diagnosis.corrected.fit, parameters)
    if neglected is None:
        return dict(entries) if diagnosis.corrected is not None else {}
    corrected_entries = {}
    for name, entry in entries.items():
        if name in neglected.change and entry["std"] is not None:
            factor = parameters[name].factor
            corrected_entries[name] = entry | {"value": entry["value"] + neglected.change[name] / factor,
                                               "std": float(np.hypot(entry["std"],
                                                                     neglected.change_std[name] / factor))}
    return corrected_entries


def _fit(diagnosis: Diagnosis) -> dict:
    misfit_before, misfit_after = diagnosis.verdict.before, diagnosis.verdict.after
    better, worst = better_blocks(misfit_before, misfit_after)
    return {"affected_blocks_better": better, "unaffected_block_worse": worst,
            "heldout_excess_before": misfit_before.excess, "heldout_excess_after": misfit_after.excess,
            "heldout_excess_std": misfit_before.excess_std, "explainable_share_recovered": diagnosis.verdict.share,
            "heldout_channel_chi2_before": _by_channel(diagnosis, misfit_before),
            "heldout_channel_chi2_after": _by_channel(diagnosis, misfit_after),
            "blocks": [block.content() for block in diagnosis.remainder.blocks]}


def _by_channel(diagnosis: Diagnosis, misfit: Misfit) -> Mapping[str, float]:
    names = [channel.column for channel in diagnosis.identification.experiment.model.channels]
    return dict(zip(names, np.asarray(misfit.channel_chi2).tolist(), strict=True))


def _round(selection_round: Round) -> dict:
    winner = selection_round.winner
    added_names = () if winner is None else [name for name in winner.refitted.stds
                                             if name not in selection_round.null.stds]
    return {"winner": winner.name if winner else None,
            "form": refitted_form(winner.ranked, winner) if winner else None, "new": list(added_names),
            "equals": list(selection_round.equals),
            "passed_over": None if selection_round.passed_over is None else selection_round.passed_over.name,
            "shortlist": [rival.name for rival in selection_round.rivals],
            "null_excess": selection_round.null.judgement.excess}
