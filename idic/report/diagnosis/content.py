"""The content of diagnosis.json: the numbers of a diagnosis, and what they say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from idic.diagnose import Diagnosis, diagnosis_numbers, free_parameters
from idic.plain_values import finite
from idic.report.diagnosis.headline import diagnosis_headline, left_over
from idic.report.diagnosis.not_excluded import not_excluded
from idic.report.diagnosis.spots import with_spots
from idic.report.diagnosis.words import sentence


def diagnosis_content(diagnosis: Diagnosis, parameters_before: Mapping[str, dict], wall_s: float = 0.0,
                      cracks: Mapping[str, dict] | None = None) -> dict:
    """The content of ``RUN/diagnosis.json`` without what comes after the verdict: the enriched experiment, notes.

    parameters_before : value, std, unit of the identified model's free parameters (`idic.diagnose.free_parameters`)
    cracks : the entry ``cracks``: what a candidate has added
    """
    if (spots := diagnosis.spots) is not None:
        without = free_parameters(spots.result)
        content = diagnosis_content(replace(diagnosis, spots=None), without, wall_s, cracks)
        return finite(with_spots(content, spots, parameters_before, without,
                                 diagnosis.identification.experiment.model.length_unit))
    content, titles = diagnosis_numbers(diagnosis, parameters_before, wall_s), titles_of(diagnosis)
    content["cracks"] = dict(cracks or {})
    model = content["model"]
    final = {name: model["parameters_of_real_body"].get(name) or model["parameters_after"].get(name) or entry
             for name, entry in parameters_before.items()}
    left_open = not_excluded(diagnosis, final)
    open_names = {entry["name"] for entry in left_open}
    content["excluded"] = [entry for entry in content["excluded"] if entry["name"] not in open_names]
    content["sentence"] = sentence(content, titles)
    content["headline"] = diagnosis_headline(content, titles)
    content["left_over"] = left_over(content, titles)
    content["not_excluded"] = [entry | {"title": titles.get(entry["name"], entry["name"])}
                               for entry in left_open]
    return content


def titles_of(diagnosis: Diagnosis) -> dict[str, str]:
    """Name of a candidate to its title in standard words."""
    left_out = {c.name: c.title for selection_round in diagnosis.rounds
                for c, _ in selection_round.screening.untestable}
    return left_out | {r.candidate.name: r.candidate.title for selection_round in diagnosis.rounds
                       for r in selection_round.screening.ranked}
