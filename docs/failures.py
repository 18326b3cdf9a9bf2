"""The texts of failures.md: makes every broken test, runs the commands, and writes their outputs.

    python docs/failures.py FOLDER [CASE ...]       # some minutes; rewrites failures.md from what it finds in FOLDER

A case that has been run in FOLDER before is not run again.
"""

from __future__ import annotations

import csv
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tifffile

STRIP = ("example", "demo", "--reduced", "--out", "strip")
IDENTIFY = ("identify", "strip", "--out", "run", "--workers", "0")
HEAD = """# Failures and their messages

One error at a time is put into a small test. All cases start from the same virtual test, an open-hole strip of metal
that yields ([tutorial.md](tutorial.md)):

```sh
idic example demo --reduced --out strip
```

Too much noise, no force, parameters with the same effect and the wrong law: [examples](examples/README.md).
Bad input ends with exit code 2 and writes nothing: the message names file and key, what was expected, what was found,
and what to do.

| error | symptom |
|---|---|
"""
ROUTINE = re.compile(  # of every run
    r"(?:frames|mesh|resolution|channels|to identify|cost|note|results|report|model)  |"
    r"Open-hole strip, tension$|The model does not explain the test within")


@dataclass(frozen=True)
class Case:
    """A failure: `spoil` breaks the folder ``strip``, `commands` are run; `sign` and `remedy` are for the reader."""

    name: str
    title: str
    intro: str
    commands: tuple[tuple[str, ...], ...]
    sign: str
    remedy: str
    spoil: Callable[[Path], None] = lambda folder: None
    example: tuple[str, ...] = STRIP


# what is broken ---------------------------------------------------------------------------------------------------
def edit(old: str, new: str) -> Callable[[Path], None]:
    """Replace a piece of experiment.toml, which must be there."""

    def spoil(folder: Path) -> None:
        file = folder / "experiment.toml"
        text = file.read_text(encoding="utf-8")
        if old not in text:
            raise ValueError(f"{old!r} is not in {file}")
        file.write_text(text.replace(old, new, 1), encoding="utf-8")

    return spoil


def black_image(folder: Path) -> None:
    file = folder / "images" / "frame_006.tif"
    tifffile.imwrite(file, np.zeros_like(tifffile.imread(file)))


def column(name: str, change: Callable[[int, float], str]) -> Callable[[Path], None]:
    """Change the values of a column of the log."""

    def spoil(folder: Path) -> None:
        file = folder / "loads.csv"
        with file.open(encoding="utf-8", newline="") as stream:
            rows = list(csv.DictReader(stream))
        for k, row in enumerate(rows):
            row[name] = change(k, float(row[name]))
        with file.open("w", encoding="utf-8", newline="") as stream:
            writer = csv.DictWriter(stream, rows[0], lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)

    return spoil


slipping = column("grip_displacement_mm", lambda k, v: f"{v + 0.01 * max(0, k - 6):.6g}")
without_value = column("force_N", lambda k, v: "" if k == 4 else f"{v:.6g}")

CHECK = ("check", "strip", "--no-picture")
CASES = (
    Case("wrong-scale", "The wrong scale",
         "The pixel size is 10 % too large: the mesh is too small in the image.",
         (IDENTIFY,), "χ² above 1, Poisson's ratio at its bound",
         "Look at `strip/check/mesh.png` (`idic check strip`): edges must lie on edges, the hole on the hole. A scale "
         "error of a percent hardly shows in χ²; make `camera.pixel_size` a [[dof]] or measure it.",
         spoil=edit("pixel_size_mm = 0.16", "pixel_size_mm = 0.176")),
    Case("upside-down", "A mirrored mesh",
         "`axes` lets mesh y point down in the image; it points up.",
         (IDENTIFY,), "none: this specimen is symmetric",
         "The mirror image of a symmetric test is the same test. With any other specimen compare the picture of "
         "`idic check` with the specimen.",
         spoil=edit('axes = ["+col", "-row"]', 'axes = ["+col", "+row"]')),
    Case("lost-frame", "A frame is black", "The lamp failed in one image.",
         (CHECK, IDENTIFY), "warning of `check`; the frame is listed and left out of the verdict",
         "`exclude_frames = [6]` under [experiment] takes it out of the sums, too.", spoil=black_image),
    Case("grip-slips", "A grip slips",
         "From frame 7 on the logged motion grows by 10 µm per frame more than that of the specimen.",
         (IDENTIFY, ("diagnose", "run", "--workers", "0")),
         "χ² above 1; `idic diagnose` names the slip",
         "`corrections = [{ kind = \"slip\", start_s = 6.0 }]` at the boundary, or `ux = \"measured\"`.",
         spoil=slipping),
    Case("no-value", "A gap in the log", "One value of the force is empty.", (IDENTIFY,),
         "exit code 2, file, column and row are named", "",
         spoil=without_value),
    Case("wrong-key", "A misspelt key", "`yeild_stress` in place of `yield_stress`.", (IDENTIFY,),
         "exit code 2, the nearest key is named", "",
         spoil=edit("yield_stress", "yeild_stress")),
)


# running ----------------------------------------------------------------------------------------------------------
def run(case: Case, folder: Path) -> list[dict]:
    """Make the test, break it, run the commands; kept in ``said.json`` next to it."""
    record = folder / "said.json"
    if record.exists():
        return json.loads(record.read_text(encoding="utf-8"))
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    idic(case.example, folder)
    case.spoil(folder / "strip")
    said = [idic(command, folder) for command in case.commands]
    record.write_text(json.dumps(said, indent=1), encoding="utf-8")
    return said


def idic(command: tuple[str, ...], folder: Path) -> dict:
    """What a command says: stdout where it is well, stderr where it is not, and its exit code."""
    done = subprocess.run([sys.executable, "-m", "idic", *command], cwd=folder, capture_output=True, text=True)
    return {"command": list(command), "code": done.returncode, "folder": str(folder.resolve()),
            "said": done.stdout if done.stdout.strip() else done.stderr}


def section(case: Case, said: list[dict]) -> str:
    lines = [f"## {case.title}", "", case.intro, ""]
    if case.example != STRIP:
        lines += ["```sh", "idic " + " ".join(case.example), "```", ""]
    for own in said:
        text = re.sub(r"[ \t]+$", "", own["said"].strip("\n"), flags=re.MULTILINE).replace(own["folder"] + "/", "")
        text = text if own["code"] == 2 else telling(text)
        lines += ["```", "$ idic " + " ".join(own["command"]), text, f"exit code {own['code']}", "```", ""]
    return "\n".join([*lines, *([f"**What to do.** {case.remedy}", ""] if case.remedy else [])])


def telling(text: str) -> str:
    """The lines that say something about the error, without the table of candidates."""
    lines = [line for line in text.splitlines() if not ROUTINE.match(line)]
    head = next((n for n, line in enumerate(lines) if line.startswith(" candidate ")), None)
    return "\n".join(lines[:head])


def main(folder: str, names: list[str]) -> None:
    for case in CASES:
        if not names or case.name in names:
            run(case, Path(folder) / case.name)
    parts, rows = [], []
    for case in CASES:
        if (Path(folder) / case.name / "said.json").exists():
            rows.append(f"| [{case.title.lower()}](#{re.sub('[^a-z0-9 -]', '', case.title.lower()).replace(' ', '-')}) "
                        f"| {case.sign} |")
            parts.append(section(case, run(case, Path(folder) / case.name)))
    page = HEAD + "\n".join(rows) + "\n\n" + "\n".join(parts)
    (Path(__file__).parent / "failures.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
