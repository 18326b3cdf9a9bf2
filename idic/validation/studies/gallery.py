"""A gallery of finished reports: six experiments, made, identified and shown on one page (`idic gallery`)."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from idic.errors import InputError
from idic.report import words
from idic.run.diagnosis.plain import diagnose_run
from idic.run.joint_run import folders_of, is_joint
from idic.run.plain import identify_experiment
from idic.run.reporting.write import write_report
from idic.validation.pages.gallery_page import render_gallery
from idic.validation.studies.exhibits import Exhibit, exhibits
from idic.workers.processor_time import cpu_seconds

PAGE, ENTRY, RUN, TESTS = "index.html", "entry.json", "run", "tests"
THUMBNAILS = ("frame_*.jpeg", "displacements.png", "residual_maps.png")


def make_gallery(out: Path | str, only: Sequence[str] | None = None, resume: bool = False,
                 say: Callable[[str], None] = lambda text: None,
                 library: Sequence[Exhibit] | None = None) -> Path:
    """Make the experiments, identify them, write their reports and the page that leads to them.

    Parameters
    ----------
    only : names of exhibits; all without it
    resume : finished ones stay as they are, an interrupted identification goes on
    say : gets a line per step
    library : the exhibits to choose from, the six without it

    Returns
    -------
    Path
        ``DIR/index.html``.

    Raises
    ------
    InputError
        A folder that holds something and no `resume`; an unknown name.
    """
    out, chosen = Path(out), _chosen(only, exhibits() if library is None else library)
    if not resume and out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError("the folder of the gallery is not empty", file=out, key="--out",
                         expected="a new folder, or --resume", found="files in it" if out.is_dir() else "a file",
                         remedy="add --resume to go on with an earlier gallery, or choose another folder")
    out.mkdir(parents=True, exist_ok=True)
    for exhibit in chosen:
        if (out / exhibit.name / ENTRY).exists():
            say(f"{exhibit.name}: finished before")
            continue
        entry = _make(out / exhibit.name, exhibit, say)
        (out / exhibit.name / ENTRY).write_text(json.dumps(entry, indent=1) + "\n", encoding="utf-8")
        _write_page(out)
    return _write_page(out)


def _chosen(only: Sequence[str] | None, library: Sequence[Exhibit]) -> list[Exhibit]:
    known = {exhibit.name: exhibit for exhibit in library}
    for name in only or ():
        if name not in known:
            raise InputError("the gallery has no such experiment", key="--only", expected=", ".join(known), found=name)
    return [exhibit for exhibit in library if not only or exhibit.name in only]


def _make(folder: Path, exhibit: Exhibit, say: Callable[[str], None]) -> dict:
    """One exhibit from nothing to its entry; what an earlier attempt has finished is used."""
    before = cpu_seconds()
    paths = _tests(folder, exhibit, say)
    say(f"{exhibit.name}: identifying")
    began = time.perf_counter()
    run = folder / RUN
    result = identify_experiment(paths, run, resume=(run / "run.zarr").exists() or is_joint(run),
                                 overrides=exhibit.overrides)
    ended = result["status"].replace("_", " ")
    say(f"{exhibit.name}: {ended} in {time.perf_counter() - began:.0f} s; writing the report")
    write_report(run)
    pages = {"report": f"{exhibit.name}/{RUN}/report.html"}
    diagnosis = None
    if exhibit.diagnose:
        say(f"{exhibit.name}: diagnosing")
        diagnosis = diagnose_run(run, resume=True)["sentence"]  # refits that are there are kept
        pages["diagnosis"] = f"{exhibit.name}/{RUN}/diagnosis.html"
    level, verdict = words.verdict(result)
    return {"name": exhibit.name, "title": exhibit.title, "sentence": exhibit.sentence, "status": result["status"],
            "level": level, "verdict": verdict, "parameters": _numbers(result, _truth(paths)), "diagnosis": diagnosis,
            "open": words.undetermined(result), "pages": pages, "thumbnail": _thumbnail(run, folder.parent),
            "frames": len(result["frames"]), "cpu_s": cpu_seconds() - before}


def _tests(folder: Path, exhibit: Exhibit, say: Callable[[str], None]) -> list[Path]:
    """The experiment folders; those that were being written when an earlier attempt ended are made anew."""
    done = folder / TESTS / "made.json"
    if done.exists():
        return [folder / TESTS / name for name in json.loads(done.read_text(encoding="utf-8"))]
    say(f"{exhibit.name}: making the virtual test")
    shutil.rmtree(folder / TESTS, ignore_errors=True)
    (folder / TESTS).mkdir(parents=True)
    paths = exhibit.write(folder / TESTS)
    done.write_text(json.dumps([path.name for path in paths]), encoding="utf-8")
    return paths


def _truth(paths: Sequence[Path]) -> dict[str, float]:
    return json.loads((paths[0] / "truth.json").read_text(encoding="utf-8"))["parameters"]


def _numbers(result: Mapping, truth: Mapping[str, float]) -> list[dict]:
    """Identified values beside the truth, and ratios where that is all that is determined."""
    shown, rows = words.short_names(result["parameters"]), []
    for name, entry in result["parameters"].items():
        if entry["free"] and entry["std"] is not None:
            rows.append(_row(shown[name], entry["value"], entry["std"], entry["unit"], truth.get(name)))
    names = words.derived_names(result)
    for name, entry in result["derived"].items():
        first, _, second = name.partition("/")
        stem = first.rpartition(".")[0]
        parts = truth.get(first), truth.get(second if "." in second else f"{stem}.{second}")
        true = parts[0] / parts[1] if second and None not in parts else None
        rows.append(_row(names[name], entry["value"], entry.get("std"), entry.get("unit", ""), true))
    return rows


def _row(name: str, value: float, std: float | None, unit: str, truth: float | None) -> dict:
    off = None if truth is None or not std else (value - truth) / std
    return {"name": name, "text": words.with_std(value, std, unit or ""),
            "truth": "" if truth is None else words.with_std(truth, None, unit or ""), "off": off}


def _thumbnail(run: Path, top: Path) -> str | None:
    """The picture that says most in little space, as a path below the gallery."""
    folders = list(folders_of(run).values()) if is_joint(run) else [run]
    for pattern in THUMBNAILS:
        found = sorted((folders[0] / "figures").glob(pattern))
        if found:
            return found[-1].relative_to(top).as_posix()
    return None


def _write_page(out: Path) -> Path:
    """The page of all finished exhibits, in the order of the gallery."""
    order = {exhibit.name: k for k, exhibit in enumerate(exhibits())}
    entries = [json.loads(file.read_text(encoding="utf-8")) for file in out.glob(f"*/{ENTRY}")]
    entries.sort(key=lambda entry: (order.get(entry["name"], len(order)), entry["name"]))
    pictures = {entry["name"]: (out / entry["thumbnail"]).read_bytes() for entry in entries if entry["thumbnail"]}
    page = out / PAGE
    page.write_text(render_gallery(entries, pictures), encoding="utf-8")
    return page
