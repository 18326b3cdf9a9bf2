"""The page of the gallery: a picture, a sentence, the key numbers and a link to the report of each experiment."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path

from idic.report import derived_names, short_names, with_std
from idic.run import folders_of
from idic_studies.pages.study_page import render_template

MAX_VALUES = 10  # of one experiment; its report lists all
THUMBNAILS = ("frame_*.jpeg", "displacements.png", "residual_maps.png")  # the first that a run has


def render_gallery(entries: Sequence[Mapping], pictures: Mapping[str, bytes]) -> str:
    """The HTML text; the pictures are in it, the reports are linked.

    Parameters
    ----------
    entries : as `idic_studies.cases.gallery` writes them
    pictures : PNG or JPEG by the name of the entry
    """
    values = {"entries": entries, "shown": MAX_VALUES, "seconds": sum(entry["cpu_s"] for entry in entries),
              "pictures": {name: _data_uri(picture) for name, picture in pictures.items()}}
    return render_template("gallery.html.j2", values)


def key_numbers(result: Mapping, truth: Mapping[str, float]) -> list[dict]:
    """Identified values with their true values; ratios where the test determines nothing else."""
    short, rows = short_names(result["parameters"]), []
    for name, entry in result["parameters"].items():
        if entry["free"] and entry["std"] is not None:
            rows.append(_row(short[name], entry["value"], entry["std"], entry["unit"], truth.get(name)))
    names = derived_names(result)
    for name, entry in result["derived"].items():
        first, _, second = name.partition("/")
        stem = first.rpartition(".")[0]
        parts = truth.get(first), truth.get(second if "." in second else f"{stem}.{second}")
        true = parts[0] / parts[1] if second and None not in parts else None
        rows.append(_row(names[name], entry["value"], entry.get("std"), entry.get("unit", ""), true))
    return rows


def _row(name: str, value: float, std: float | None, unit: str, truth: float | None) -> dict:
    off = None if truth is None or not std else round((value - truth) / std, 1) + 0.0  # no -0.0
    return {"name": name, "text": with_std(value, std, unit or ""),
            "truth": "" if truth is None else with_std(truth, None, unit or ""), "off": off}


def thumbnail(run: Path, top: Path) -> str | None:
    """The picture that represents a run on the page, as a path below the gallery `top`."""
    first = next(iter(folders_of(run).values()))
    for pattern in THUMBNAILS:
        pictures = sorted((first / "figures").glob(pattern))
        if pictures:
            return pictures[-1].relative_to(top).as_posix()
    return None


def _data_uri(picture: bytes) -> str:
    kind = "png" if picture.startswith(b"\x89PNG") else "jpeg"
    return f"data:image/{kind};base64," + base64.b64encode(picture).decode("ascii")
