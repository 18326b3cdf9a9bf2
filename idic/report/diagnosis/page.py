"""The page of a diagnosis: one self-contained HTML file, its sentence at the top."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from idic.diagnose import Notes
from idic.identification import z_text
from idic.parameters import digits_text
from idic.report.diagnosis import figures
from idic.report.diagnosis.free_form import free_curve
from idic.report.diagnosis.law import law_curves, window_courses
from idic.report.diagnosis.record import DiagnosisRecord
from idic.report.diagnosis.words import (MIN_EVEN_PROBABILITY, MIN_GOOD_PROBABILITY, heldout_drop, is_sure,
                                         standing_of)
from idic.report.html import filled_in
from idic.report.page import Section
from idic.report.result.words import number_text, short_names, size_text

STANDINGS = {"significant": "significant", "small": "significant, below the practical margin",
             "inadmissible": "significant with an inadmissible sign", "excluded": "excluded with a bound",
             "cannot_tell": "not visible in this test"}
EXCLUDED_BY = {"refit": "its refit", "bound": "the bound of its score"}
MIN_WHOLE_SCORE = 8.0  # from here on a score is shown without decimals
VERDICTS = {"none": "no candidate is significant and large enough", "single": "one candidate selected",
            "set": "one of several indistinguishable candidates", "multiple": "several candidates selected",
            "outside_library": "unexplained by the library", "blind": "this test cannot decide"}


def draw_diagnosis_sections(record: DiagnosisRecord, notes: Notes) -> tuple[Section, ...]:
    """Every figure in the order of a reader's questions; empty sections, and figures that fail, are left out."""
    def drawn(figure: Callable, *arguments) -> Any:
        return notes.attempt(f"the figure {figure.__name__.replace('_', ' ')}", figure, *arguments)

    curves = tuple(drawn(figures.channel, record, curve) for curve in record.curves)
    enriched = record.excess_after is not None
    plan = (
        ("better", "Residual before and after",
         "The identified model (before) and the enriched model (after)." if enriched
         else "The identified model, without the pixels of the spots." if record.content.get("spots")
         else "The identified model; no candidate was selected.",
         (*(drawn(figures.residual_maps, record) or ()), drawn(figures.excess_course, record), *curves)),
        ("where", "Place, onset and side", "", record.further),
        ("which", "Candidates by score", "", (drawn(figures.ranking, record), drawn(figures.courses, record))),
        ("free", "Free law", "No named physics fits: the law of the material with a curve in the place of a form.",
         (drawn(free_curve, record),)),
        ("moved", "Change of the parameters" if enriched else "Constancy of the parameters", "",
         (drawn(figures.parameters, record), drawn(window_courses, record), *(drawn(law_curves, record) or ()))),
    )
    sections = (Section(a, t, x, tuple(p for p in pictures if p is not None)) for a, t, x, pictures in plan)
    return tuple(s for s in sections if s.pictures)


def render_diagnosis_page(record: DiagnosisRecord, sections: tuple[Section, ...] | None = None) -> str:
    """The HTML text; `sections` from `draw_sections`, drawn here if not given."""
    content = record.content
    next_test = content["sentence"].partition(" Next: ")[2]
    bounded = {entry["name"] for entry in content["excluded"]}
    return filled_in(
        "diagnosis.html.j2", title=record.title, first=content["headline"],
        rest=[next_test.removesuffix(".")] if next_test else [], left_over=content.get("left_over"),
        not_excluded=content.get("not_excluded", ()), chain=chain_rows(content), odds=odds_words(record),
        facts=_facts(content), sure=is_sure(content),
        cautions=content.get("cautions", ()),
        sections=draw_diagnosis_sections(record, Notes()) if sections is None else sections,
        parameters=_parameters(content), candidates=[_candidate(record, entry) for entry in content["candidates"]],
        excluded=[f"{_title(record, entry['name'])}: {entry['bound']}, by {EXCLUDED_BY[entry['by']]}"
                  for entry in content["excluded"]],
        cannot_tell=[_title(record, name) + (" (other forms)" if name in bounded else "")
                     for name in content["cannot_tell"]], costs=_costs(content["cost"]))


def chain_rows(content: Mapping) -> list[dict[str, str]]:
    """The rows of the chain of evidence: what, number, threshold with the side on which it holds, whether it does."""
    rows = []
    for link in content.get("chain", ()):
        number, threshold = (float("nan") if link[key] is None else link[key] for key in ("number", "threshold"))
        unit = f" {link['unit']}" if link["unit"] else ""
        rows.append({"what": link["what"], "number": f"{number:.3g}{unit}",
                     "threshold": f"{link['sense']} {threshold:.3g}{unit}", "holds": "yes" if link["holds"] else "no"})
    return rows


def odds_words(record: DiagnosisRecord) -> list[str]:
    """What plausible sizes say of the members of every indistinguishable set, and what the recording alone does."""
    lines = []
    for group in record.content.get("odds", ()):
        members = [f"{_title(record, member['name'])} {size_text(100.0 * member['share_with'])} %{_times(member)}"
                   for member in group]
        lines.append(f"The recording alone does not tell these {len(group)} apart "
                     f"({size_text(100.0 * group[0]['share_without'])} % each). By the plausible size of each: "
                     f"{'; '.join(members)}.")
    return lines


def _times(member: Mapping) -> str:
    """How large a member is beside its plausible size."""
    if member["times_plausible"] is None:
        return " (any size)"
    return f" ({size_text(member['times_plausible'])} times {member['plausible']}: {member['source']})"


def _facts(content: Mapping) -> list[tuple[str, str, bool | None]]:
    """Label, value, and whether it is good news, bad news or neither: what is no step of the chain of evidence."""
    fit = content["fit"]
    excess_after, std = fit["heldout_excess_after"], fit["heldout_excess_std"]
    facts: list[tuple[str, str, bool | None]] = [("verdict", VERDICTS[content["verdict"]], _news(content)),
             ("held-out excess before", number_text(fit["heldout_excess_before"], std), None)]
    if content.get("probability") is not None:
        facts.insert(1, (_of_what(content),
                         f"{size_text(100.0 * content['probability'])} %", _good_or_bad(content["probability"])))
    margin = content["margin"]
    source = ("assumed: no frame is at rest" if margin["camera_floor_px"] is None else "from images at rest"
              if margin["px"] > margin["assumed_px"] else "assumed, above that of the images at rest")
    facts.append(("practical margin", f"{margin['px']:.2g} px, {source}", None))
    if content["named"]:
        beyond_noise = fit["heldout_excess_before"] > 5.0 * std  # of noise nothing is gained
        facts.append(("held-out excess after", number_text(excess_after, std),
                      excess_after < 0.1 * fit["heldout_excess_before"] + 5.0 * std if beyond_noise else None))
    return facts


def _of_what(content: Mapping) -> str:
    """What the probability is that of."""
    if not content["named"]:
        return "probability that nothing of practical size is missing"
    is_set = any(len(group) > 1 for group in content["indistinguishable"])
    return f"probability that {'the set holds' if is_set else 'this is'} the cause"


def _news(content: Mapping) -> bool | None:
    """Whether the verdict is good news (sure), bad news (unexplained, undecided, hardly probable) or neither."""
    if is_sure(content):
        return True
    probable = content.get("probability")
    doubted = content["verdict"] in ("outside_library", "blind") or (probable is not None
                                                                     and probable < MIN_EVEN_PROBABILITY)
    return False if doubted else None


def _good_or_bad(probability: float) -> bool | None:
    return True if probability > MIN_GOOD_PROBABILITY else False if probability < MIN_EVEN_PROBABILITY else None


def _parameters(content: Mapping) -> list[dict]:
    identified, enriched = content["model"]["parameters_before"], content["model"]["parameters_after"]
    real = content["model"]["parameters_of_real_body"]
    labels = short_names({**identified, **enriched})
    rows = []
    for name in {**identified, **enriched}:
        old_entry, new_entry = identified.get(name), enriched.get(name)
        rows.append({"name": labels[name], "unit": (new_entry or old_entry)["unit"] or "–", "before": _value(old_entry),
                     "after": _value(new_entry), "real": _value(real.get(name))})
    return rows


def _value(entry: Mapping | None) -> str:
    if entry is None:
        return "–"
    std = entry["std"]
    return number_text(entry["value"], std) + (f" ± {number_text(std, std)}" if std else "")


def _candidate(record: DiagnosisRecord, entry: Mapping) -> dict:
    drop = lambda key: "–" if entry[key] is None else f"{entry[key]:.3g}"  # noqa: E731
    return {"title": _title(record, entry["name"]) + (f" ({entry['form']})" if entry["form"] else ""),
            "label": entry["label"], "score": _score(entry["score"]),
            "effect": f"{entry['effect_px_rms']:.2g}",
            "visibility": f"{entry['visibility']:.2f}", "predicted": drop("predicted_chi2_drop"),
            "achieved": "given up" if entry.get("problem") and not entry["refitted"] else drop("achieved_chi2_drop"),
            "heldout": heldout_drop(entry),
            "standing": standing_of(record.content, entry, STANDINGS[entry["standing"]])}


def _score(score: float) -> str:
    return f"{score:.0f}" if abs(score) >= MIN_WHOLE_SCORE else z_text(score)


def _title(record: DiagnosisRecord, name: str) -> str:
    return record.titles.get(name, name.replace("_", " "))


def _costs(cost: Mapping) -> list[tuple[str, str]]:
    """Processor and wall time; the parts of it are in diagnosis.json."""
    return [(key.removesuffix("_s").replace("_", " "), f"{digits_text(value)} s") for key, value in cost.items()
            if key in ("cpu_s", "wall_s")]
