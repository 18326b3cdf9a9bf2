"""What the folder holds: images, logs, an experiment, runs. The browser chooses names out of this listing, no paths."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.experiment_file import EXPERIMENT_FILE, find_stages
from idic.inside import way_inside
from idic.readers import FileStack, Log, PICTURE_SUFFIXES, natural_key, open_stack, patterns_of, recorded_order

RUNS = "runs"  # FOLDER/runs/NAME: what the page identifies
RUN_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,60}")
LOG_SUFFIXES = (".csv", ".txt", ".dat")
PRESSURE_UNITS = ("MPa", "kPa", "Pa", "bar", "mbar", "psi")
FORCE, TRAVEL = r"force|load|kraft|last", r"disp|grip|stroke|extension|position|cross|weg"
PRESSURE = r"press|druck"


@dataclass(frozen=True)
class Listing:
    """Files of a folder and of the folders in it, by names relative to it.

    Attributes
    ----------
    images : {pattern: its files, the reference first}, the largest group first; several patterns as a list in JSON
    logs : names of files that may be logs
    runs : names of the folders under `RUNS`
    """

    folder: Path
    images: dict[str, tuple[Path, ...]]
    logs: tuple[str, ...]
    runs: tuple[str, ...]
    has_experiment: bool

    @property
    def cameras(self) -> tuple[str, ...]:
        """Patterns of groups that may be those of several cameras at one test: as many images each; () for one
        camera."""
        first = next(iter(self.images.values()))
        groups = tuple(name for name, paths in self.images.items() if len(paths) == len(first) > 1)
        return groups if len(groups) > 1 else ()

    def stack(self, pattern: str) -> FileStack:
        """The images of a group.

        Raises
        ------
        InputError
            No such group.
        """
        if pattern not in self.images:
            raise InputError("no such images in the folder", key="images", expected=", ".join(self.images),
                             found=pattern,
                             remedy="choose from the list")
        return open_stack(list(self.images[pattern]))

    def log(self, name: str) -> Log:
        """A log of the listing, read."""
        if name not in self.logs:
            raise InputError("no such log in the folder", key="loads", expected=", ".join(self.logs) or "none",
                             found=name,
                             remedy="choose from the list")
        return Log.read(self.folder / name)


def list_folder(folder: Path) -> Listing:
    """Look into a folder, one level deep; runs and hidden files are left out.

    Raises
    ------
    InputError
        No such folder, or no images in it.
    """
    if not folder.is_dir():
        raise InputError("no such folder", file=folder, expected="a folder with images", found="nothing there",
                         remedy="check the path")
    files = [path for depth in ("*", "*/*") for path in folder.glob(depth)
             if path.is_file() and not path.name.startswith(".")
             and path.relative_to(folder).parts[0] not in (RUNS, "check")]
    files.sort(key=lambda path: natural_key(path.relative_to(folder).as_posix()))
    groups: dict[tuple[Path, str], list[Path]] = defaultdict(list)
    for path in files:
        if path.suffix.lower() in PICTURE_SUFFIXES and not re.search(r"mask|roi", path.stem, re.IGNORECASE):
            groups[path.parent, path.suffix].append(path)
    if not groups and find_stages(files):
        raise InputError("the folder holds measured fields, and idic draw draws on images", file=folder,
                         expected="TIFF or PNG images", found="stages of another DIC system",
                         remedy=f"idic init {folder} writes experiment.toml with a mesh on the measured points")
    if not groups:
        raise InputError("no images in the folder", file=folder,
                         expected="TIFF or PNG images, in it or in a folder below",
                         found=f"{len(files)} other files", remedy="put the images in a folder images/")
    largest_first = sorted(groups.values(), key=len, reverse=True)
    images = {_name_of(patterns_of(folder, paths)): tuple(recorded_order(paths, folder)) for paths in largest_first}
    logs = tuple(path.relative_to(folder).as_posix() for path in files if path.suffix.lower() in LOG_SUFFIXES)
    return Listing(folder, images, logs, _runs(folder), (folder / EXPERIMENT_FILE).is_file())


def _name_of(patterns: list[str]) -> str:
    return patterns[0] if len(patterns) == 1 else json.dumps(patterns, ensure_ascii=False)


def _runs(folder: Path) -> tuple[str, ...]:
    place = folder / RUNS
    if not place.is_dir() or place.is_symlink():
        return ()
    return tuple(sorted(path.name for path in place.iterdir()
                        if path.is_dir() and not path.is_symlink() and RUN_NAME.fullmatch(path.name)))


def run_folder(folder: Path, name: str) -> Path:
    """The RUN of a name, inside of the folder.

    Raises
    ------
    InputError
        The name is none, or a link leads out of the folder.
    """
    if not RUN_NAME.fullmatch(name):
        raise InputError("not a name of a run", key="run", expected="letters, digits, ., _ and -, inside the folder",
                         found=repr(name), remedy="choose another name")
    return way_inside(folder, f"{RUNS}/{name}")


def log_table(log: Log, n_frames: int) -> dict:
    """The columns of a log, for the page: name, unit, values, and whether there is one row per frame."""
    columns: list[dict] = []
    for name in log.names:
        try:
            values = np.asarray(log.column(name), dtype=float)
        except InputError as error:
            columns.append({"name": name, "unit": log.unit(name), "problem": error.what, "values": []})
            continue
        samples = values[np.linspace(0, len(values) - 1, min(len(values), 400)).astype(int)] if len(values) else values
        columns.append({"name": name, "unit": log.unit(name), "kind": _kind(name, log.unit(name)),
                        "values": [float(v) if np.isfinite(v) else None for v in samples.tolist()]})
    return {"rows": len(log.rows), "frames": n_frames, "matches": len(log.rows) == n_frames, "time": log.time_column,
            "columns": columns}


def _kind(name: str, unit: str | None) -> str:
    """What the page offers a column for."""
    if unit in PRESSURE_UNITS or (unit is None and re.search(PRESSURE, name, re.IGNORECASE)):
        return "pressure"
    if unit in ("N", "kN", "MN", "lbf") or (unit is None and re.search(FORCE, name, re.IGNORECASE)):
        return "force"
    if unit in ("mm", "um", "µm", "m", "in") or re.search(TRAVEL, name, re.IGNORECASE):
        return "travel"
    return ""
