"""The report page: one self-contained HTML file from a RunRecord, with verdict and values at its top."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from typing import Any

from idic.model import is_mode
from idic.parameters import digits_text
from idic.report.fields.tables import gauge_rows
from idic.report.fields.viewer import viewer_data
from idic.report.figures import charts, maps, matrices
from idic.report.figures.camera_floor import camera_floor
from idic.report.figures.frame_views import Slide, slides
from idic.report.figures.hardening import hardening_curve, yield_surface
from idic.report.figures.mesh.overlay import identified_mesh
from idic.report.figures.point_maps import point_maps
from idic.report.figures.profiles import is_profile
from idic.report.crack_figure import crack_figure
from idic.report.figures.relaxation import relaxation_curve
from idic.report.figures.rubber import rubber_energy
from idic.report.figures.picture import Picture
from idic.report.figures.temperature_factor import temperature_dependence
from idic.report.free_dic import free_dic
from idic.report.html import filled_in
from idic.report.practice import practice_table
from idic.report.result.fit_words import against_free, in_words_of, noise_chi2
from idic.report.result.record import RunRecord
from idic.report.result.stress_scale import in_ratios
from idic.report.result.words import (
    MAX_CHANNEL_CHI2, NOISE_SOURCE, derived_names, discrepancy_text, error_text, hardly_determined, left_open,
    number_text, parts_of_std, relative_std, result_cautions, result_headline, result_verdict, short_names, two_digits,
    virtual_boundaries,
)
from idic.report.stress_strain import open_curves, stress_strain
from idic.report.tables import parameter_status
from idic.report.treatments import treatment_table

GOOD = ("converged",)
MAX_LOST_SHARE = 0.05  # of the pixels; more is marked
MIN_CHANNEL_CHI2 = 0.2  # below, the stated noise of the channel is twice too large
MIN_READINGS = 8  # of a channel: of fewer, chance alone leaves such a small mean square in one test of a hundred
HARDLY = "interval reaches 0"  # status of a modulus that the headline tells as not determined
MAX_LARGE_TEXT_VALUES = 6  # values in the first sentence, beyond which it is set smaller


@dataclass(frozen=True)
class Section:
    """A heading, a line on why it is there, and figures; slides : frames to look at one by one; sliding : what of;
    viewer : numbers of the field viewer."""

    anchor: str
    title: str
    text: str
    pictures: tuple[Picture, ...]
    slides: tuple[Slide, ...] = ()
    sliding: str = ""
    viewer: str = ""


@dataclass(frozen=True)
class PlannedSection:
    """A section whose figures are still to be drawn, in any order and by any process.

    pictures : functions that draw one each, or None where the record has nothing to draw; slides : draws all frames;
    viewer : makes the numbers of the field viewer
    """

    anchor: str
    title: str
    text: str
    pictures: tuple[Callable[[], Picture | None], ...] = ()
    slides: Callable[[], tuple[Slide, ...]] | None = None
    sliding: str = ""
    viewer: Callable[[], str] | None = None


def in_turn(parts: Sequence[Callable[[], Any]]) -> list:
    """What all parts of a report draw."""
    return [draw() for draw in parts]


def draw_sections(record: RunRecord, draw_all: Callable[[Sequence[Callable[[], Any]]], list] = in_turn
                  ) -> tuple[Section, ...]:
    """Every figure of the report in the order of a reader's questions; empty sections are left out.

    draw_all : called with the functions of `parts`; returns their results in the same order
    """
    return drawn_sections(plan_sections(record), draw_all)


def drawn_sections(plan: Sequence[PlannedSection],
                   draw_all: Callable[[Sequence[Callable[[], Any]]], list] = in_turn) -> tuple[Section, ...]:
    """The sections of a plan; draw_all : as for `draw_sections`"""
    drawn = iter(draw_all(parts(plan)))
    sections = []
    for planned in plan:
        pictures = tuple(next(drawn) for _ in planned.pictures)
        sections.append(Section(
            planned.anchor, planned.title, planned.text, tuple(picture for picture in pictures if picture is not None),
            next(drawn) if planned.slides else (), planned.sliding, next(drawn) if planned.viewer else ""))
    return tuple(s for s in sections if s.pictures or s.slides or s.viewer or (s.anchor == "law" and s.text))


def parts(plan: Sequence[PlannedSection]) -> list[Callable[[], Any]]:
    """All functions of a plan, in the order of the page."""
    return [draw for section in plan for draw in (*section.pictures, section.slides, section.viewer)
            if draw is not None]


def plan_sections(record: RunRecord) -> tuple[PlannedSection, ...]:
    """The sections of the report; nothing is drawn yet."""
    channels = tuple(partial(charts.channel, record, c) for c in record.channels)
    extra = () if record.fields is None else tuple(partial(maps.nodal_field, record, n) for n in record.fields.extra)
    laws = (*(partial(stress_strain, record, curve) for curve in record.curves),
            *(partial(hardening_curve, record, curve) for curve in record.hardening),
            *(partial(rubber_energy, record, curve) for curve in record.rubber),
            *(partial(relaxation_curve, record, curve) for curve in record.relaxation),
            *(partial(yield_surface, record, surface) for surface in record.surfaces),
            *(partial(temperature_dependence, tuple(factors))
              for _, factors in groupby(record.temperature_factors, lambda factor: factor.name)))
    growth = tuple(partial(crack_figure, record, name) for name in record.result.get("cracks", {}))
    return (
        PlannedSection(
            "explained", "Does the model explain the test?",
            "Residuals: measured images and channels minus simulated ones.",
            (*_of(record, charts.residual_level), *channels,
             *_of(record, point_maps, maps.local_chi2, maps.residuals, free_dic, camera_floor)),
        ),
        _frame_by_frame(record),
        _fields(record),
        PlannedSection("law", "Which law was identified?", " ".join(open_curves(record)), laws),
        PlannedSection("cracks", "How do cracks grow?", "", growth),
        PlannedSection(
            "determined", "What does the test determine?",
            "Sensitivity of the motion to each parameter, and how well the test separates the parameters.",
            _of(record, matrices.correlation, maps.sensitivities, matrices.spectrum),
        ),
        PlannedSection("moved", "How did the specimen move?", "",
                       (*_of(record, maps.displacements), *extra, *_of(record, charts.temperature, identified_mesh))),
        *(_camera_plan(name, camera_record) for name, camera_record in record.cameras),
        PlannedSection("converged", "How did the search converge?", "", _of(record, charts.convergence)),
    )


def _of(record: RunRecord, *figures: Callable[[RunRecord], Picture | None]
        ) -> tuple[Callable[[], Picture | None], ...]:
    return tuple(partial(figure, record) for figure in figures)


def _fields(record: RunRecord) -> PlannedSection:
    return PlannedSection("fields", "Fields",
                          "Displacement, strain, stress and state. Point at a field for its value. A click sets a "
                          "point, an extensometer, a line or a circle.", viewer=partial(viewer_data, record))


def _frame_by_frame(record: RunRecord) -> PlannedSection:
    if is_profile(record):
        text, sliding = ("Does the simulated section rise as the measured one? Does the residual have a structure?",
                         "Measured and simulated height, and the residual")
    else:
        text, sliding = ("Does the mesh stay on the specimen? Does the residual have a structure?",
                         "Image with the simulated mesh, and the residual")
    return PlannedSection("frames", "Frame by frame", text, slides=partial(slides, record), sliding=sliding)


def all_pictures(sections: tuple[Section, ...]) -> list[Picture]:
    """Every picture of the page, those of the slider too."""
    return [picture for section in sections
            for picture in (*section.pictures, *(picture for slide in section.slides for picture in slide.pictures))]


def _camera_plan(name: str, record: RunRecord) -> PlannedSection:
    """The section of a further camera: its figures under names of their own."""
    chi2 = record.result["residual"]["image_chi2_dof"]
    figures = (charts.residual_level, maps.local_chi2, maps.residuals, maps.displacements, maps.sensitivities)
    return PlannedSection(
        f"camera-{name}", f"Camera {name}",
        f"Its own images, noise ({digits_text(record.noise_gv)} {record.value_unit}) and residuals"
        + ("." if chi2 is None else f"; χ² per pixel {chi2:.3f}.") + _texture(record),
        tuple(partial(_named_after, name, figure, record) for figure in figures))


def _named_after(camera: str, figure: Callable[[RunRecord], Picture | None], record: RunRecord) -> Picture | None:
    picture = figure(record)
    return picture and replace(picture, name=f"{picture.name}_{camera}")


def _texture(record: RunRecord) -> str:
    """With which reference image that of a camera was compared."""
    pair = record.result.get("texture")
    if pair is None:
        return ""
    return (f" Its reference image and that of {pair['compared_with']} correlate by {pair['correlation']:.3f} on "
            f"{pair['pixels']} px ({100.0 * pair['share']:.0f} % of those of {pair['compared_with']})"
            + ("." if pair["used"] else ", too little to be compared."))


def render_page(record: RunRecord, sections: tuple[Section, ...] | None = None) -> str:
    """The HTML text of the report.

    Parameters
    ----------
    sections : tuple of Section, optional
        Finished figures, from :func:`draw_sections`; drawn here if not given.
    """
    sections = draw_sections(record) if sections is None else sections
    first, *sentences = result_headline(record.result)
    level, verdict = result_verdict(record.result)
    in_shown_units = replace(record, result=in_ratios(record.result))
    return in_words_of(record.result, filled_in(
        "page.html.j2",
        title=record.title,
        level=level,
        verdict=verdict,
        first=first,
        many=first.count(" = ") > MAX_LARGE_TEXT_VALUES,
        rest=sentences,
        cautions=result_cautions(in_shown_units.result),
        practice=practice_table(record),
        facts=_facts(record),
        value_unit=record.value_unit,
        parameters=_parameter_rows(in_shown_units),
        remedies=_remedy_rows(record),
        discrepancy=discrepancy_text(record.result),
        sections=sections,
        notes=record.notes,
        frames=_frame_rows(record),
        gauges=gauge_rows(record),
        costs=_cost_rows(record),
        has_model=any(p.get("systematic_std") is not None for kind in ("parameters", "derived")
                      for p in record.result.get(kind, {}).values()),
        treatments=treatment_table(record.result),
        has_mesh=any(p.get("discretisation_bias") is not None for p in record.result["parameters"].values()),
    ))


def _facts(record: RunRecord) -> list[tuple[str, str, bool | None]]:
    """Short facts under the headline: (label, value, all right; None: neither right nor wrong)."""
    result = record.result
    facts: list[tuple[str, str, bool | None]] = [("status", str(result["status"]).replace("_", " "),
                                                  result["status"] in GOOD)]
    chi2 = result.get("residual", {}).get("image_chi2_dof")
    if chi2 is not None:
        low, high = noise_chi2(result)
        facts.append(("χ² per pixel", f"{chi2:.3f}", low <= chi2 <= high))
        if (free_fit := against_free(result)) is not None:
            facts.append(("χ² of a free FE-DIC", f"{free_fit.free_chi2:.3g}, failed" if free_fit.failed
                          else f"{free_fit.free_chi2:.3f}",
                          not free_fit.failed and free_fit.free_chi2 <= high
                          and (low <= free_fit.free_chi2 or free_fit.floor > 0.0)))
        local = result["residual"].get("local")
        if local:
            facts.append(("largest local χ²", f"{local['chi2']:.2f} ({local['typical_chi2']:.2f} in the median)",
                          not local["is_cluster"] and local["typical_chi2"] <= high))
    floor = result.get("camera_floor") or {}
    if floor:
        scale, unit = record.motion_unit
        text = "not known: no image at rest" if floor["px"] is None else (
            f"{scale * floor['px']:.2g} {unit}" if floor["px"] else f"below {scale * floor['bound_px']:.1g} {unit}")
        facts.append(("camera's floor", text, None))
    for name, value in result.get("residual", {}).get("channel_chi2_dof", {}).items():
        if value is not None:
            few = sum(map(_is_used, result.get("frames", ()))) < MIN_READINGS
            facts.append((f"χ² of {name}", f"{value:.2f}" if value < 100.0 else f"{value:.0f}",
                          (few or value >= MIN_CHANNEL_CHI2) and value <= MAX_CHANNEL_CHI2))
    if record.noise_gv:
        source = NOISE_SOURCE.get(result["noise"].get("source", ""), result["noise"].get("source", ""))
        facts.append(("noise of one image σ", f"{digits_text(record.noise_gv)} {record.value_unit}, {source}", None))
    statuses = [f.get("status") for f in result.get("frames", ())]
    if statuses:
        used = sum(_is_used(f) for f in result["frames"])
        wrong = sum(f.get("status") in ("lost", "unexplained") and _is_used(f) for f in result["frames"])
        facts.append(("frames used", f"{used} of {len(statuses)}" + (f", {wrong} of them unexplained" if wrong else ""),
                      not wrong and used >= len(statuses) - statuses.count("excluded")))
    lost = result.get("residual", {}).get("lost_pixels")
    if lost:
        label = ("pixels that left the image" if record.value_unit == "grey values"
                 else "pixels off the image or in gaps")
        share = lost / _all_pixels(result, lost)
        facts.append((label, f"{100.0 * share:.2g} %", None if share <= MAX_LOST_SHARE else False))
    return facts


def _all_pixels(result, lost: int) -> int:
    """Pixels of the frames used, those that left the image included."""
    return lost + sum(f.get("n_pixels") or 0 for f in result.get("frames", ()) if _is_used(f))


def _is_used(frame) -> bool:
    """Whether a frame was compared, or is a reference."""
    return bool(frame.get("reference") or frame.get("used", frame.get("status") == "ok"))


def _parameter_rows(record: RunRecord) -> list[dict]:
    short, hardly = short_names(record.result["parameters"]), hardly_determined(record.result)
    rows = []
    for name, p in record.result["parameters"].items():
        if is_mode(name):
            continue
        std = p.get("std") if p.get("free") else None
        bias = p.get("discretisation_bias")
        ci, status = p.get("ci95"), HARDLY if name in hardly else parameter_status(record, name)
        rows.append(
            {
                "name": short[name],
                "full": name,
                "unit": p.get("unit") or "–",
                "start": number_text(p.get("start")),
                "value": "–" if status == "not determined" else number_text(p.get("value"), std),
                "std": two_digits(std) if std else "–",
                "parts": parts_of_std(p) if std else "–",
                "relative": relative_std(p.get("value"), std),
                "systematic": number_text(p.get("systematic_std"), p.get("systematic_std")),
                "bias": error_text(bias, std, number_text(bias, std)),
                "ci": f"{number_text(ci[0], std)} … {number_text(ci[1], std)}" if ci and std else "–",
                "status": status,
            }
        )
    rows += _virtual_rows(record)
    order = {"identified": 0, "at bound": 0, HARDLY: 0, "derived": 1, "not determined": 2, "locked": 3}
    return sorted(rows + _derived_rows(record), key=lambda row: order[row["status"]])


def _virtual_rows(record: RunRecord) -> list[dict]:
    """One row per virtual boundary and component for all of its modes; parameters.csv has every one."""
    rows = []
    for entry in virtual_boundaries(record.result):
        status = "identified" if entry["determined"] else "not determined" if entry["free"] else "locked"
        rows.append(dict.fromkeys(("start", "value", "parts", "relative", "systematic", "bias", "ci"), "–") | {
            "name": f"{entry['name']}: {entry['text']}", "full": entry["name"], "unit": entry["unit"],
            "std": entry["std"], "status": status})
    return rows


def _derived_rows(record: RunRecord) -> list[dict]:
    """What follows from the parameters, in rows of the same table."""
    names, open_, rows = derived_names(record.result), left_open(record.result), []
    for name, d in record.result.get("derived", {}).items():
        lost = name in open_
        std, ci = (None, None) if lost else (d.get("std"), d.get("ci95"))
        row = {
            "name": names[name],
            "full": name,
            "unit": d.get("unit") or "–",
            "value": "–" if lost else number_text(d["value"], std),
            "std": two_digits(std) if std else "–",
            "parts": parts_of_std(d) if std else "–",
            "relative": relative_std(d["value"], std),
            "ci": f"{number_text(ci[0], std)} … {number_text(ci[1], std)}" if ci and std else "–",
            "systematic": number_text(d.get("systematic_std"), d.get("systematic_std")),
            "status": "not determined" if lost else "derived",
        }
        rows.append(dict.fromkeys(("start", "bias"), "–") | row)
    return rows


def _remedy_rows(record: RunRecord) -> list[tuple[str, str, str]]:
    """What each remedy for light and aliasing does to χ² at the same motion: (setting, before, after)."""
    return [(remedy["setting"], f"{remedy['chi2_before']:.3f}", f"{remedy['chi2_after']:.3f}")
            for remedy in record.result.get("remedies") or ()]


def _frame_rows(record: RunRecord) -> list[dict]:
    rows = []
    for k, f in enumerate(record.result.get("frames", ())):
        rows.append(
            {
                "frame": f.get("frame", k),
                "label": f.get("label", ""),
                "status": "reference" if f.get("reference") else f.get("status", ""),
                "rms": number_text(f.get("rms_gv"), 0.01),
                "chi2": number_text(f.get("chi2_dof"), 0.01),
                "pixels": "–" if f.get("n_pixels") is None else str(f["n_pixels"]),
            }
        )
    return rows


def _cost_rows(record: RunRecord) -> list[tuple[str, str]]:
    """What the identification took: (label, value)."""
    cost, result = record.result.get("cost", {}), record.result
    counts = (("iterations", "iterations"), ("evaluations", "parameter sets tried"), ("forward_runs", "simulations"))
    rows = [(label, str(result[key])) for key, label in counts if result.get(key) is not None]
    labels = (
        ("wall_s", "wall time", "s"),
        ("cpu_s", "processor time", "s"),
        ("forward_s", "of the wall time: simulations", "s"),
        ("image_s", "of the wall time: image passes", "s"),
        ("peak_rss_mb", "peak memory of a process", "MB"),
    )
    return rows + [(label, f"{digits_text(cost[key])} {unit}") for key, label, unit in labels
                   if cost.get(key) is not None]
