"""Images, mesh, log and mask among the files of a folder."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.experiment_file.initial.cameras import CameraPair, camera_pair
from idic.fe import Mesh, Segments
from idic.images import speckle_size
from idic.readers import (
    DIMENSION, FORMATS, Log, image_entries, mesh_suffixes, natural_key, open_stack, patterns_of, read_mesh_file,
    recorded_order,
)

HEIGHT_SUFFIXES = {suffix for entry in FORMATS if entry.kind == "heights" for suffix in entry.suffixes}
IMAGE_SUFFIXES = HEIGHT_SUFFIXES | {suffix for entry in FORMATS if entry.kind == "images" for suffix in entry.suffixes}
_FILM_SUFFIXES = {suffix for entry in FORMATS if entry.is_film for suffix in entry.suffixes}
LOG_SUFFIXES = {suffix for entry in FORMATS if entry.kind == "loads" for suffix in entry.suffixes}
_NOTE_SUFFIXES = LOG_SUFFIXES - {".csv"} - {suffix for entry in FORMATS if entry.kind == "loads" and entry.is_extra
                                            for suffix in entry.suffixes}  # of notes, too
_NO_MESHES = (".dat", ".svg", ".wkt", ".xml")  # formats of meshio whose suffix usually means something else
_MASK = re.compile(r"mask|(?<![a-z])roi(?![a-z])", re.IGNORECASE)  # microimage_001.tif is an image
CHECK = "check"  # where `idic check` draws


@dataclass
class Found:
    """The files in the folder: images, mesh, log, mask."""

    folder: Path
    images: str | list[str]  # patterns
    n_images: int
    image_shape: tuple[int, int]
    reference: str  # label of the first image
    mesh_file: str | None = None
    mesh: Mesh | None = None
    log_file: str | None = None
    log: Log | None = None
    mask: str | None = None
    notes: list[str] = field(default_factory=list)
    outline: list = field(default_factory=list)  # of the speckled area, (column, row) px
    holes: list = field(default_factory=list)  # round ones in it, (column, row, radius) px
    are_heights: bool = False  # in a format of heights, which may state their unit and their pitch
    height_unit: str | None = None
    pitch_mm: tuple[float, float] | None = None
    times_s: np.ndarray | None = None  # (n_images,) that the image files state
    second: CameraPair | None = None
    speckle_px: float | None = None  # width of the speckle in the first image


Area = Callable[[np.ndarray], tuple[list, list]]  # image -> outline and holes of its speckled area, px


def files_in(folder: Path, *depths: str) -> list[Path]:
    """Files of the folder and of the folders in it, in natural order, without the pictures of `idic check`.

    depths : patterns, "*/*" for the files of the folders
    """
    return sorted((path for depth in depths or ("*", "*/*") for path in folder.glob(depth) if path.is_file()
                   and not path.name.startswith(".") and path.parent != folder / CHECK),
                  key=lambda path: natural_key(path.relative_to(folder).as_posix()))


def look_around(folder: Path, files: list[Path], area: Area | None) -> Found:
    """Images, mesh, log and mask among the files.

    Raises
    ------
    InputError
        No images, or images that cannot be read.
    """
    groups: dict[tuple[Path, str], list[Path]] = defaultdict(list)
    masks = []
    for path in files:
        if path.suffix.lower() in IMAGE_SUFFIXES:
            is_mask = _MASK.search(path.stem)
            place = path if path.suffix.lower() in _FILM_SUFFIXES else path.parent  # a film is a series of its own
            (masks if is_mask else groups[place, path.suffix]).append(path)
    if not groups and len(masks) > 1:  # a name of the series: unmasked_001.tif
        for path in masks:
            groups[path.parent, path.suffix].append(path)
        masks = []
    if not groups:
        raise InputError("no images in the folder", file=folder,
                         expected="TIFF or PNG images, a film, height maps, or the exported fields of a DIC system, in "
                                  "it or in a folder below", found=f"{len(files)} other files",
                         remedy="put the images in a folder images/")
    pair = camera_pair(folder, groups.values(), files)
    images = pair[0] if pair is not None else max(
        groups.values(), key=lambda paths: (len(paths) > 1 or paths[0].suffix.lower() in _FILM_SUFFIXES, len(paths)))
    is_film = images[0].suffix.lower() in _FILM_SUFFIXES
    patterns = [images[0].relative_to(folder).as_posix()] if is_film else patterns_of(folder, images)
    are_heights = images[0].suffix.lower() in HEIGHT_SUFFIXES
    stack = open_stack(recorded_order(images, folder), with_gaps=are_heights)
    contents = Found(folder, patterns[0] if len(patterns) == 1 else patterns, stack.n_frames, stack.shape,
                     stack.labels[0], are_heights=are_heights, second=None if pair is None else pair[1])
    if stack.grid is not None:
        contents.height_unit, contents.pitch_mm = stack.grid.height_unit, stack.grid.pitch_mm
    contents.times_s = stack.times_s
    contents.notes += stack.notes()
    second = "" if pair is None else pair[1].images
    films = [path.name for (place, _), (path, *_) in groups.items()
             if place == path and path not in images and path.relative_to(folder).as_posix() != second]
    if films and is_film:
        contents.notes.append(f"other films here: {', '.join(films)}")
    _find_mask(masks, contents)
    holes: list = []
    if area is not None and not are_heights:
        first = np.asarray(stack.frame(0))
        contents.outline, holes = area(first)
        contents.holes = [hole for hole in holes if Segments.is_circle(hole)]
        contents.speckle_px = speckle_size(first, _box(contents.outline, first.shape))
    _find_mesh(files, contents)
    if contents.mesh is None and (n_irregular := len(holes) - len(contents.holes)):
        contents.notes.append(f"{n_irregular} {'hole is' if n_irregular == 1 else 'holes are'} not round and left out: "
                              "the mesh covers them, although they have no pattern; idic draw draws holes of any shape")
    _find_log(files, contents)
    return contents


def _box(outline: list, shape: tuple[int, int]) -> np.ndarray:
    """The pixels in the box around an outline, all without one  # (ny, nx) bool"""
    region = np.zeros(shape, dtype=bool)
    low, high = Segments.of(outline).box() if outline else ((0, 0), (shape[1], shape[0]))
    region[max(int(low[1]), 0):int(high[1]) + 1, max(int(low[0]), 0):int(high[0]) + 1] = True
    return region


def find_model(files: list[Path], contents: Found) -> None:
    """The mesh and the log among the files."""
    _find_mesh(files, contents)
    _find_log(files, contents)


def _find_mask(paths: list[Path], contents: Found) -> None:
    """The first one of the size of the images."""
    for path in paths:
        try:
            shape = image_entries(path)[0].shape
        except InputError as error:
            contents.notes.append(f"{path.name} was not understood: {error.what}")
            continue
        if shape == contents.image_shape:
            contents.mask = path.relative_to(contents.folder).as_posix()
            return
        contents.notes.append(f"{path.name} is no mask: it is {shape[1]} x {shape[0]} px")


def _find_mesh(files: list[Path], contents: Found) -> None:
    formats = set(mesh_suffixes()) - set(_NO_MESHES)
    paths = [path for path in files if path.suffix.lower() in formats]
    for path in paths:
        try:
            raw = read_mesh_file(path)
            n_dim = max(DIMENSION[kind] for kind, cells, _ in raw.cells if len(cells))
            mesh, _ = raw.to_mesh(n_dim, 1.0)
        except (InputError, ValueError) as error:
            contents.notes.append(f"{path.name} was not understood: {str(error).splitlines()[0]}")
            continue
        contents.mesh_file, contents.mesh = path.relative_to(contents.folder).as_posix(), mesh
        other_meshes = [candidate.name for candidate in paths if candidate != path]
        if other_meshes:
            contents.notes.append(f"other meshes here: {', '.join(other_meshes)}")
        return


def _find_log(files: list[Path], contents: Found) -> None:
    """The first log; a text that may be a note is one where it has times, or a row per image."""
    logs = [path for path in files if path.suffix.lower() in LOG_SUFFIXES]
    for path in sorted(logs, key=lambda path: path.suffix.lower() in _NOTE_SUFFIXES):
        may_be_note = path.suffix.lower() in _NOTE_SUFFIXES
        try:
            log = Log.read(path)
            if may_be_note and len(log.rows) != contents.n_images and log.time_column is None:
                continue
        except InputError as error:
            if not may_be_note:
                contents.notes.append(f"{path.name} was not understood: {str(error).splitlines()[0]}")
            continue
        contents.log_file, contents.log = path.relative_to(contents.folder).as_posix(), log
        contents.notes += log.notes
        return
