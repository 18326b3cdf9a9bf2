"""Figures of planned tests: standard deviations per parameter and plan, their growth over the frames, sensitivities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.ticker import MaxNLocator

from idic.report.design.words import MAX_STD_FAIR, MAX_STD_WELL, MODE, in_words, named
from idic.report.figures import maps, matrices
from idic.report.figures.picture import CYCLE, Colour, Picture
from idic.report.figures.style import MARKERS, look, new_figure, to_picture
from idic.report.result.record import RunRecord, Sensitivities
from idic.report.result.words import short_names

MAPS_PER_ROW = 5
MAX_MATRIX_ROWS = 30  # a matrix of more rows is no longer read
SHOWN_CHANGE = 0.01  # the change of a parameter that a sensitivity map shows: 1 % of its value
UNDETERMINED_STD = 3.0  # where undetermined parameters are drawn: a factor e has the relative standard deviation 1


@dataclass(frozen=True)
class PlanPictures:
    """Data of the figures of one plan that are not in design.json.

    reference : (ny, nx), None where the pattern is made up; nodes_px : (n_nodes, 2); cells : (name, connectivity),
    empty where no map can be drawn; fields : (parameter, frame, phi (n_nodes, 2) px per own value, step as shown).
    """

    reference: np.ndarray | None
    nodes_px: np.ndarray
    cells: tuple[tuple[str, np.ndarray], ...]
    fields: tuple[tuple[str, int, np.ndarray, float], ...]


def expected(content: Mapping) -> Picture:
    """Relative standard deviation of every parameter, one mark per plan and one for all of them together."""
    series = [(plan["name"], named(plan["parameters"])) for plan in content["plans"]]
    if content["joint"] is not None:
        series.append(("all together", {name: entry for name, entry in content["joint"]["parameters"].items()
                                        if any(name in parameters for _, parameters in series)}))
    elif content["plans"][0]["channels"]:
        series = [(in_words(content["plans"][0], "images and channels"), series[0][1]),
                  (in_words(content["plans"][0], "images only"), _images_only(series[0][1]))]
    names = list(dict.fromkeys(name for _, parameters in series for name in parameters))
    short = short_names(names)
    with look():
        figure = new_figure(8.0, 0.34 * len(names) + (1.3 if len(series) > 1 else 1.0))
        axis = figure.subplots()
        anything_open = False
        spread = np.linspace(-0.22, 0.22, len(series)) if len(series) > 1 else [0.0]
        for k, ((plan, parameters), shift) in enumerate(zip(series, spread, strict=True)):
            style = {"color": CYCLE[k % len(CYCLE)], "marker": MARKERS[k % len(MARKERS)], "ls": "none", "ms": 6}
            rows = [(i, parameters[name]["relative_std"]) for i, name in enumerate(names) if name in parameters]
            determined = [(i, std) for i, std in rows if std is not None]
            axis.plot([std for _, std in determined], [i + shift for i, _ in determined], label=plan, **style)
            open_places = [i + shift for i, std in rows if std is None]
            axis.plot([UNDETERMINED_STD] * len(open_places), open_places, **(style | {"mfc": "none"}))
            anything_open = anything_open or bool(open_places)
        axis.axvline(MAX_STD_WELL, color=Colour.GREY, lw=0.8, ls=":")
        axis.axvline(MAX_STD_FAIR, color=Colour.GREY, lw=0.8, ls=":")
        if anything_open:
            # and farther: all marks are seen
            axis.axvspan(1.0, 2.0 * UNDETERMINED_STD, color=Colour.FAINT, alpha=0.5, lw=0)
        axis.set(xscale="log", xlabel="expected standard deviation / value [–]", yticks=range(len(names)),
                 ylim=(len(names) - 0.5, -0.5))
        axis.set_yticks(range(len(names)), [short[name] for name in names])
        axis.set_xlim(right=max(2.0 * (UNDETERMINED_STD if anything_open else MAX_STD_FAIR), axis.get_xlim()[1]))
        if len(series) > 1:
            figure.legend(loc="outside upper left", ncols=4)
        return to_picture(figure, "expected_std", "Expected standard deviations",
                      "Dotted: 1 % and 10 %." + (" Open marks on the shaded side: not determined." if anything_open
                                                 else ""))


def _images_only(parameters: Mapping) -> dict:
    """The same entries with the standard deviations that the images alone give."""
    entries = {}
    for name, entry in parameters.items():
        std = entry["std_images_only"]
        unit = abs(entry["value"]) or (entry["std"] or 1.0) / (entry["relative_std"] or 1.0)
        entries[name] = {"relative_std": None if std is None else std / unit}
    return entries


def growth(plan: Mapping) -> Picture | None:
    """Relative standard deviation against the number of frames used."""
    frames = plan["growth"]["frames"]
    if len(frames) < 2:
        return None
    parameters = named(plan["parameters"])
    short = short_names(parameters)
    with look():
        figure = new_figure(8.0, 3.2)
        axis = figure.subplots()
        for k, (name, value) in enumerate(parameters.items()):
            stds = plan["growth"]["std"][name]
            unit = abs(value["value"]) or (value["std"] or 1.0) / (value["relative_std"] or 1.0)
            relative = np.array([np.nan if std is None else std for std in stds], dtype=float) / unit
            if np.isfinite(relative).any():
                axis.semilogy(frames, relative, color=CYCLE[k % len(CYCLE)], ls=("-", "--", ":")[k // len(CYCLE) % 3],
                              marker=MARKERS[k % len(MARKERS)], ms=3, label=short[name])
        if not axis.lines:
            return None
        axis.axhline(MAX_STD_WELL, color=Colour.GREY, lw=0.8, ls=":")
        axis.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))  # no half frames
        axis.set(xlabel="last frame used", ylabel="expected std / value [–]")
        figure.legend(loc="outside right upper")
        return to_picture(figure, f"growth_{_file(plan['name'])}", "Standard deviations over the frames used",
                      "Standard deviations of a test that ends earlier. A curve begins where the parameter becomes "
                      "determined; further frames do not improve a level curve. Dotted: 1 %.")


def spectrum(plan: Mapping) -> Picture | None:
    """M, D and Q of one plan."""
    if len(plan["M"]["names"]) > MAX_MATRIX_ROWS:
        return None
    picture = matrices.spectrum(_record(plan))
    caption = ("M counts information per unit change of ln(value) (positive parameters) or of value/scale. The last "
               "columns of Q are the combinations that this test determines worst; 1/√D is their standard deviation "
               "for independent frames: the table below includes the shared noise of the reference image.")
    return picture and replace(picture, name=f"spectrum_{_file(plan['name'])}", caption=caption)


def correlation(plan: Mapping) -> Picture | None:
    table = plan["correlation"]
    positions = [i for i, name in enumerate(table["names"]) if not MODE.fullmatch(name)]
    matrix = np.array(table["matrix"], dtype=float).reshape(2 * (len(table["names"]),))
    table = {"names": [table["names"][i] for i in positions], "matrix": matrix[np.ix_(positions, positions)]}
    picture = matrices.correlation(_record(plan | {"correlation": table}))
    return picture and replace(picture, name=f"correlation_{_file(plan['name'])}",
                               title="Correlation of the values to be identified")


def sensitivities(plan: Mapping, pictures: PlanPictures) -> list[Picture]:
    """Sensitivity fields, each in the frame in which it is largest; as many figures as the parameters need."""
    if not pictures.cells:
        return []
    drawn, fields = [], [field for field in pictures.fields if not MODE.fullmatch(field[0])]
    for first in range(0, len(fields), MAPS_PER_ROW):
        part = fields[first:first + MAPS_PER_ROW]
        data = Sensitivities(tuple(name for name, *_ in part), part[0][1],
                             np.array([SHOWN_CHANGE * phi for _, _, phi, _ in part]),
                             tuple(f"{_step(plan, name, step)}, frame {frame}" for name, frame, _, step in part))
        record = replace(_record(plan), reference=pictures.reference, nodes_px=pictures.nodes_px, cells=pictures.cells,
                         sensitivities=data)
        picture = maps.sensitivities(record)
        number = f"_{first // MAPS_PER_ROW + 1}" if len(fields) > MAPS_PER_ROW else ""
        drawn.append(replace(
            picture, name=f"sensitivities_{_file(plan['name'])}{number}", title="Sensitivity fields",
            caption="How far the pattern moves when one parameter changes by the step above its map, in the frame in "
                    "which that is largest. The test does not separate maps of the same shape in all frames."))
    return drawn


def _step(plan: Mapping, name: str, step: float) -> str:
    entry = plan["parameters"][name]
    return f"{100 * SHOWN_CHANGE:g} %" if entry["value"] else f"{SHOWN_CHANGE * step:.3g} {entry['unit']}".strip()


def _record(plan: Mapping) -> RunRecord:
    """The plan as the figures of a run know one."""
    result = {"parameters": plan["parameters"], "correlation": plan["correlation"],
              "not_identifiable": plan["not_identifiable"]}
    pitch = None
    if len(plan["image_px"]) == 3:
        result["quantity"] = "volume"
    if plan["points"] is not None and plan["points"]["unit"] == "mm":
        result["quantity"], pitch = "displacement", plan["points"]["pitch"]
    return RunRecord(plan["title"], result, pixel_size_mm=pitch, names=tuple(plan["M"]["names"]),
                     M=np.array(plan["M"]["matrix"]))


def _file(name: str) -> str:
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in name)


def plan_pictures(plan: Mapping, pictures: PlanPictures) -> Sequence[Picture]:
    """All figures of one plan, in the order of a reader's questions."""
    pictures_or_none = (*sensitivities(plan, pictures), growth(plan), correlation(plan), spectrum(plan))
    return tuple(picture for picture in pictures_or_none if picture is not None)
