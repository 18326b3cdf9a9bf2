"""Two cameras among the files of a folder, by a calibration of both: equally many images in two folders, or names in
one folder that differ by a word or number for each camera: ``img_0001_0.tif`` and ``img_0001_1.tif``; or a film of
each: ``left.avi`` and ``right.avi``."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.fe import Mesh
from idic.readers import image_entries, natural_key, patterns_of, read_calibration

CALIBRATION_SUFFIXES = (".json", ".xml", ".yml", ".yaml", ".caldat", ".cal")
MIN_IMAGES = 2  # of a camera: one alone is no test
_PARTS = re.compile(r"\d+|[A-Za-z]+|[^A-Za-z\d]+")  # of a file name
FILL_IN_PLACE = "FILL IN: (column, row) of these points of the mesh in the reference image"


@dataclass(frozen=True)
class CameraPair:
    """A second camera and the calibration of both; images : patterns; names : of the cameras, by their folders"""

    images: str
    calibration: str
    names: tuple[str, str]

    def lines(self, mesh: Mesh | None) -> list[str]:
        """The tables of both cameras."""
        first, second = self.names
        corners = _corners(mesh)
        return ["[[camera]]", f'name = "{first}"', 'model = "pinhole"',
                f"calibration = {json.dumps(self.calibration)}   # of both cameras, relative to the first",
                "# [camera.alignment]            # or rotation and translation_mm, from the mesh frame to the camera's",
                f"# points_mm = {json.dumps(corners)}   # corners and holes that are seen",
                f"# points_px = []                # {FILL_IN_PLACE}", "",
                "[[camera]]", f'name = "{second}"', f"images = {json.dumps(self.images)}   # one per image of {first}",
                'model = "pinhole"', f"calibration = {json.dumps(self.calibration)}", "calibration_camera = 1", ""]


def camera_pair(folder: Path, groups: Iterable[Sequence[Path]],
                files: Sequence[Path]) -> tuple[list[Path], CameraPair] | None:
    """The images of the first camera, and the second one; None where no two folders pair, or nothing calibrates them.

    The first camera is the one whose folder sorts first: left before right, cam0 before cam1.
    """
    by_folder = sorted((list(group) for group in groups), key=lambda group: natural_key(group[0].as_posix()))
    pairs = [halves for group in by_folder if (halves := _halves(group)) is not None
             and image_entries(halves[0][0])[0].shape == image_entries(halves[1][0])[0].shape]
    pairs += [(first, second) for i, first in enumerate(by_folder) for second in by_folder[i + 1:]
             if len(first) == len(second) > 1 and first[0].parent != second[0].parent
             and image_entries(first[0])[0].shape == image_entries(second[0])[0].shape]
    pairs = pairs or _films([path for group in by_folder for path in group])
    calibration = next((path for path in files if path.suffix.lower() in CALIBRATION_SUFFIXES and _has_two(path)), None)
    if not pairs or calibration is None:
        return None
    first, second = max(pairs, key=lambda pair: len(pair[0]))
    pattern, *further_patterns = patterns_of(folder, second)
    if further_patterns:
        return None
    return first, CameraPair(pattern, calibration.relative_to(folder).as_posix(), _names(first, second))


def _films(files: Sequence[Path]) -> list[tuple[list[Path], list[Path]]]:
    """Files of several images each, of one size, whose names differ by one word or number, or that lie in two folders.
    """
    frames = {path: entries for path in files if len(entries := image_entries(path)) >= MIN_IMAGES}
    return [([first], [second]) for first, second in combinations(frames, 2)
            if frames[first][0].shape == frames[second][0].shape and first.suffix == second.suffix
            and (first.parent != second.parent or _n_differing(first.stem, second.stem) == 1)]


def _n_differing(*stems: str) -> int:
    """Parts by which two names differ; all of names with unlike parts."""
    first, second = map(_PARTS.findall, stems)
    return len(first) if len(first) != len(second) else sum(a != b for a, b in zip(first, second, strict=True))


def _halves(group: Sequence[Path]) -> tuple[list[Path], list[Path]] | None:
    """The images of two cameras in one folder; None where no word or number of the names tells them apart.

    That part has two values, and with either of them the other parts are the same. A number counts where it is the last
    one: the first may be that of the frame.
    """
    if len(group) < 2 * MIN_IMAGES or len(group) % 2:
        return None
    parts = [_PARTS.findall(path.stem) for path in group]
    if len({len(names) for names in parts}) != 1:
        return None
    numbers = [k for k, part in enumerate(parts[0]) if part.isdecimal()]
    places = [k for k, part in enumerate(parts[0]) if part.isalpha()] + (numbers[-1:] if len(numbers) > 1 else [])
    for k in places:
        halves: dict[str, dict[tuple[str, ...], Path]] = {}
        for names, path in zip(parts, group, strict=True):
            halves.setdefault(names[k], {})[*names[:k], *names[k + 1:]] = path
        if len(halves) == 2 and len({frozenset(half) for half in halves.values()}) == 1:
            first, second = (halves[value] for value in sorted(halves, key=natural_key))
            return list(first.values()), [second[name] for name in first]
    return None


def _has_two(path: Path) -> bool:
    try:
        return len(read_calibration(path).cameras) >= 2
    except InputError:
        return False


def _names(first: list[Path], second: list[Path]) -> tuple[str, str]:
    """By the folders of the cameras, or by the words in one folder that tell them apart."""
    names = [[group[0].parent.name] for group in (first, second)]
    if first[0].parent == second[0].parent:
        names = [_PARTS.findall(group[0].stem) for group in (first, second)]
    differing = [(a, b) for a, b in zip(*names, strict=True) if a != b]
    words = differing[0] if differing else ("", "")
    first_name, second_name = (re.sub(r"[^A-Za-z0-9_-]", "_", name) for name in words)
    if not (first_name[:1].isalpha() and second_name[:1].isalpha()):
        return "first", "second"
    return first_name, second_name


def _corners(mesh: Mesh | None) -> list[list[float]]:
    """Corners of the mesh, mesh unit; of a solid on the side of the largest z."""
    if mesh is None:
        return []
    low, high = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
    z = [float(high[2])] if mesh.n_dim == 3 else []
    return [[float(np.round(x, 6)), float(np.round(y, 6)), *z]
            for x, y in ((low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1]))]
