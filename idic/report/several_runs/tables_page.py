"""Pages of tables: several runs side by side (`idic compare`), several experiments identified together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from idic.model import is_mode
from idic.report.figures.matrices import correlation
from idic.report.figures.picture import Picture
from idic.report.html import filled_in
from idic.report.result.fit_words import MAX_P_OF_EQUAL_SPECIMENS, in_words_of
from idic.report.result.record import RunRecord
from idic.report.result.stress_scale import in_ratios
from idic.report.result.words import (
    between_specimens, result_cautions, result_headline, result_verdict, two_digits, with_std,
)
from idic.report.several_runs.batch_page import draw_batch

MIN_BOLD_DIFFERENCE_STD = 3.0  # standard deviations of a difference, beyond which it is set in bold
NONE = "–"


@dataclass(frozen=True)
class Cell:
    """Text of a table cell; link : where it leads; far : set in bold."""

    text: str
    link: str = ""
    is_bold: bool = False


@dataclass(frozen=True)
class Table:
    """A titled table of the page."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    lead: str = ""


def render_tables(title: str, first: Sequence[str], tables: Sequence[Table], pictures: Sequence[Picture] = (),
                  verdict: tuple[str, str] | None = None) -> str:
    """The HTML text of a page; figures are in it, linked pages are not.

    verdict : level ("good" | "look" | "bad") and words above the sentences; the first is bold where it is good
    """
    return filled_in("tables.html.j2", title=title, first=first, sections=tables,
                     pictures=pictures, verdict=verdict)


# runs side by side ----------------------------------------------------------------------------------------------
def comparison_page(content: Mapping) -> str:
    """The HTML text of the page of ``compare.json``."""
    picture = _comparison_picture(content)
    return render_tables("Comparison of runs", comparison_headlines(content), comparison_tables(content),
                         [picture] if picture else [])


def comparison_headlines(content: Mapping) -> list[str]:
    """Whether the runs agree, in a sentence or two."""
    runs = content["runs"]
    largest = max(((abs(d), entry["name"], runs[k]["name"]) for entry in content["parameters"]
                   for k, d in enumerate(entry["differences"]) if d is not None), default=None)
    if largest is None:
        text = "No parameter was determined in the first run and in another one."
    else:
        text = (f"The largest difference to {runs[0]['name']}: {largest[1]} of {largest[2]}, {largest[0]:.1f} standard "
                "deviations.")
    fits = [(run["image_chi2_dof"], run["name"]) for run in runs if run["image_chi2_dof"] is not None]
    if len(fits) > 1 and all(run["same_data"] for run in runs):
        best, worst = min(fits), max(fits)
        data, unit = ("fields", "component") if _of_fields(runs) else ("images", "pixel")
        text += f" On the same {data}, χ² per {unit} is {best[0]:.4g} for {best[1]} and {worst[0]:.4g} for {worst[1]}."
    return [text]


def comparison_tables(content: Mapping) -> list[Table]:
    """Parameters, and fit and model, of the runs of ``compare.json``."""
    runs = content["runs"]
    header = ("parameter", *(run["name"] for run in runs), *(f"{run['name']} − {runs[0]['name']}" for run in runs[1:]))
    rows = []
    for entry in content["parameters"]:
        values = [Cell(NONE if estimate is None else _value(estimate, estimate["unit"]))
                  for estimate in entry["values"]]
        steps = [Cell(NONE) if d is None else Cell(f"{d:+.1f} std", is_bold=abs(d) > MIN_BOLD_DIFFERENCE_STD)
                 for d in entry["differences"][1:]]
        rows.append((Cell(entry["name"]), *values, *steps))
    lead = ("Differences in standard deviations of the difference, taken as independent: runs on the same "
            f"{_data_words(runs)[2]} share their noise and should agree better. "
            f"Bold: more than {MIN_BOLD_DIFFERENCE_STD:g}.")
    return [Table("Parameters", header, tuple(rows), lead), _fits(runs)]


def _comparison_picture(content: Mapping) -> Picture | None:
    """Value and standard deviation of every parameter in every run, in one unit."""
    rows = [run | {"experiment": run["name"],
                   "parameters": {entry["name"]: estimate for entry in content["parameters"]
                                  if (estimate := entry["values"][k]) and estimate["free"]
                                  and estimate["unit"] == entry["unit"]}}
            for k, run in enumerate(content["runs"])]
    return draw_batch({"runs": rows})


def _of_fields(runs: Sequence[Mapping]) -> bool:
    """Whether all runs are of measured fields."""
    return all(run.get("quantity") == "displacement" for run in runs)


def _data_words(runs: Sequence[Mapping]) -> tuple[str, str, str]:
    """Names of the rows of χ², of the rms residual and of the data: of images, of fields, or of either."""
    if _of_fields(runs):
        return "fields: χ² per component", "fields: rms residual", "fields"
    if any(run.get("quantity") == "displacement" for run in runs):
        return "χ² per pixel, of fields per component", "rms residual of images or fields", "images or fields"
    return "images: χ² per pixel", "images: rms residual", "images"


def _fits(runs: Sequence[Mapping]) -> Table:
    chi2, rms, data = _data_words(runs)
    kinds = {"grey": "images", "displacement": "fields", "height": "height images"}
    mixed = {"measured": [kinds.get(run.get("quantity", "grey"), "images") for run in runs]} if (
        len({run.get("quantity", "grey") for run in runs}) > 1) else {}
    lines = mixed | {
        "status": [run["status"].replace("_", " ") for run in runs],
        "model": [", ".join(f"{name}: {law}" for name, law in run["models"].items()) or NONE for run in runs],
        "method": [run.get("method", "integrated").replace("_", " ") for run in runs],
        "free parameters": [str(run["n_free"]) for run in runs],
        chi2: [_plain(run["image_chi2_dof"]) for run in runs],
        rms: [_plain(run["image_rms"], run["image_unit"]) for run in runs],
    }
    for column in dict.fromkeys(column for run in runs for column in run["channel_chi2_dof"]):
        lines[f"{column}: χ² per value"] = [_plain(run["channel_chi2_dof"].get(column)) for run in runs]
    lines |= {"iterations": [str(run["iterations"]) for run in runs], "wall time": [_plain(run["wall_s"], "s")
                                                                                   for run in runs],
              data: ["as the first" if run["same_data"] else "others" for run in runs]}
    rows = tuple((Cell(name), *(Cell(text) for text in texts)) for name, texts in lines.items())
    return Table("Model and fit", ("", *(run["name"] for run in runs)), rows)


def _value(entry: Mapping, unit: str) -> str:
    if entry["std"] is None:
        return "not determined" if entry["free"] else f"{entry['value']:.6g} (given)"
    return with_std(entry["value"], entry["std"], unit)


def _plain(value: float | None, unit: str = "") -> str:
    return NONE if value is None else f"{value:.4g} {unit}".strip()


# experiments identified together --------------------------------------------------------------------------------
def joint_page(result: Mapping) -> str:
    """The page of a result of several experiments, with links to the report of each."""
    in_shown_units = in_ratios(result)
    parameters = tuple(
        (Cell(name), Cell(_value(entry, "") if entry["std"] is not None else "not determined"),
         Cell(entry["unit"] or NONE), Cell(f"{entry['start']:.6g}"))
        for name, entry in in_shown_units["parameters"].items() if entry["free"] and not is_mode(_own(name, result)))
    rows = []
    for name, part in result["experiments"].items():
        frames = [frame for frame in result["frames"] if frame["experiment"] == name]
        good = sum(frame["status"] == "ok" for frame in frames)
        channels = ", ".join(f"{c}: {v:.2f}" for c, v in part["residual"]["channel_chi2_dof"].items())
        rows.append((Cell(name, part["report"]), Cell(part["title"]), Cell(f"{good} of {len(frames)}"),
                     Cell(_plain(part["residual"]["image_chi2_dof"])), Cell(channels or NONE),
                     Cell(_plain(part["noise"]["std_gv"], part["noise"]["unit"]))))
    tables = [
        Table("Parameters", ("parameter", "value", "unit", "start"), parameters,
              "Material parameters are shared by all experiments. A name that begins with an experiment belongs to "
              "that one alone."),
        Table("Experiments", ("experiment", "title", "frames explained", "χ² per pixel", "χ² of the channels",
                              "image noise"), tuple(rows), "The report of each shows its images, fields and channels."),
    ]
    tables[1:1] = specimen_tables(in_shown_units)
    first = [*result_headline(result), *between_specimens(in_shown_units), *result_cautions(in_shown_units)]
    picture = correlation(RunRecord(result["title"], in_shown_units))
    page = render_tables(result["title"], [line for line in first if line], tables, [picture] if picture else [],
                         verdict=result_verdict(result))
    fields = all(part["noise"]["unit"] == result["noise"]["unit"] for part in result["experiments"].values())
    return in_words_of(result, page) if fields else page


def specimen_tables(result: Mapping) -> list[Table]:
    """Shared parameters from each specimen alone, and the scatter between specimens; [] without one."""
    content = result.get("specimens") or {}
    names = list(result["experiments"])
    rows = []
    for name, entry in content.items():
        values = entry["values"]
        cells = [Cell(with_std(values[experiment]["value"], values[experiment]["std"])
                      if experiment in values else "not determined") for experiment in names]
        has_scatter = entry["between_std"] is not None
        low, high = entry["between_ci95"] or (None, None)
        rows.append((Cell(name), Cell(entry["unit"] or NONE), *cells,
                     Cell(two_digits(entry["between_std"]) if has_scatter else NONE),
                     Cell(f"{two_digits(low)} … {two_digits(high)}" if has_scatter else NONE),
                     Cell(with_std(entry["mean"], entry["mean_std"]) if has_scatter else NONE),
                     Cell(f"{entry['p_value']:.2g}" if has_scatter else NONE,
                          is_bold=has_scatter and entry["p_value"] < MAX_P_OF_EQUAL_SPECIMENS)))
    if not rows:
        return []
    lead = ("The values of each specimen alone, to first order from the joint ones, with its own alignment and "
            "thickness; the "
            "standard deviation between specimens and its 95 % interval; the mean of the material that the specimens "
            "are drawn from; and the probability of such a scatter among equal specimens (bold: below "
            f"{100 * MAX_P_OF_EQUAL_SPECIMENS:g} %). The joint values assume equal specimens.")
    return [Table("Specimen by specimen",
                  ("parameter", "unit", *names, "std between", "95 %", "mean of the material", "p"),
                  tuple(rows), lead)]


def _own(name: str, result: Mapping) -> str:
    """A parameter's name without that of its experiment."""
    head, _, local_name = name.partition(".")
    return local_name if head in result["experiments"] else name
