"""A gallery of finished reports: six experiments, written, identified and shown on one page (`idic gallery`)."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from idic.errors import InputError
from idic.report import result_verdict, undetermined
from idic.run import cpu_seconds, diagnose_run, identify_run, write_report
from idic_studies.pages.gallery_page import key_numbers, render_gallery, thumbnail
from idic_studies.cases.gallery_examples import GalleryExample, gallery_examples

PAGE, ENTRY, RUN, TESTS = "index.html", "entry.json", "run", "tests"


def make_gallery(out: Path | str, only: Sequence[str] | None = None, resume: bool = False,
                 say: Callable[[str], None] = lambda text: None,
                 library: Sequence[GalleryExample] | None = None) -> Path:
    """Write the experiments, identify them, write their reports and the page that links them.

    Parameters
    ----------
    only : names of examples; default all
    resume : finished examples stay, an interrupted identification continues
    say : receives one line per step
    library : the examples to choose from; default the six of the gallery

    Returns
    -------
    Path
        ``DIR/index.html``.

    Raises
    ------
    InputError
        A folder that is not empty and no `resume`; an unknown name.
    """
    out, chosen = Path(out), _chosen(only, gallery_examples() if library is None else library)
    if not resume and out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError("the folder of the gallery is not empty", file=out, key="--out",
                         expected="a new folder, or --resume", found="files in it" if out.is_dir() else "a file",
                         remedy="add --resume to continue an earlier gallery, or choose another folder")
    out.mkdir(parents=True, exist_ok=True)
    for example in chosen:
        if (out / example.name / ENTRY).exists():
            say(f"{example.name}: finished before")
            continue
        entry = _make(out / example.name, example, say)
        (out / example.name / ENTRY).write_text(json.dumps(entry, indent=1) + "\n", encoding="utf-8")
        _write_page(out)
    return _write_page(out)


def _chosen(only: Sequence[str] | None, library: Sequence[GalleryExample]) -> list[GalleryExample]:
    example_by_name = {example.name: example for example in library}
    for name in only or ():
        if name not in example_by_name:
            raise InputError("the gallery has no such experiment", key="--only", expected=", ".join(example_by_name),
                             found=name, remedy="correct the name, or leave --only out to make all of them")
    return [example for example in library if not only or example.name in only]


def _make(folder: Path, example: GalleryExample, say: Callable[[str], None]) -> dict:
    """One example, from its experiment to its entry; finished parts of an interrupted attempt are used."""
    cpu_at_start = cpu_seconds()
    paths = _tests(folder, example, say)
    say(f"{example.name}: identifying")
    began = time.perf_counter()
    run = folder / RUN
    result = identify_run(paths, run, resume=True, overrides=example.overrides)
    ended = result["status"].replace("_", " ")
    say(f"{example.name}: {ended} in {time.perf_counter() - began:.0f} s; writing the report")
    write_report(run)
    pages = {"report": f"{example.name}/{RUN}/report.html"}
    diagnosis = None
    if example.diagnose:
        say(f"{example.name}: diagnosing")
        diagnosis = diagnose_run(run, resume=True)["sentence"]  # finished refits are used
        pages["diagnosis"] = f"{example.name}/{RUN}/diagnosis.html"
    level, verdict = result_verdict(result)
    return {"name": example.name, "title": example.title, "sentence": example.sentence, "status": result["status"],
            "level": level, "verdict": verdict, "parameters": key_numbers(result, _truth(paths)),
            "diagnosis": diagnosis, "open": undetermined(result), "pages": pages,
            "thumbnail": thumbnail(run, folder.parent),
            "frames": len(result["frames"]), "cpu_s": cpu_seconds() - cpu_at_start}


def _tests(folder: Path, example: GalleryExample, say: Callable[[str], None]) -> list[Path]:
    """The experiment folders; half-written ones of an interrupted attempt are written again."""
    record = folder / TESTS / "made.json"
    if record.exists():
        return [folder / TESTS / name for name in json.loads(record.read_text(encoding="utf-8"))]
    say(f"{example.name}: making the virtual test")
    shutil.rmtree(folder / TESTS, ignore_errors=True)
    (folder / TESTS).mkdir(parents=True)
    paths = example.write(folder / TESTS)
    record.write_text(json.dumps([path.name for path in paths]), encoding="utf-8")
    return paths


def _truth(paths: Sequence[Path]) -> dict[str, float]:
    return json.loads((paths[0] / "truth.json").read_text(encoding="utf-8"))["parameters"]


def _write_page(out: Path) -> Path:
    """The page of all finished examples, in the order of the gallery."""
    order = {example.name: k for k, example in enumerate(gallery_examples())}
    entries = [json.loads(file.read_text(encoding="utf-8")) for file in out.glob(f"*/{ENTRY}")]
    entries.sort(key=lambda entry: (order.get(entry["name"], len(order)), entry["name"]))
    pictures = {entry["name"]: (out / entry["thumbnail"]).read_bytes() for entry in entries if entry["thumbnail"]}
    page = out / PAGE
    page.write_text(render_gallery(entries, pictures), encoding="utf-8")
    return page
