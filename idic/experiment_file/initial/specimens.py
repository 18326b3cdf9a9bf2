"""Several specimens in one folder: a folder of each, with its images, or the stages of its fields, and its log."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from idic.errors import InputError
from idic.experiment_file.initial.fields import find_stages
from idic.experiment_file.initial.found import CHECK, IMAGE_SUFFIXES, LOG_SUFFIXES, files_in
from idic.readers import Log


def specimens_in(folder: Path) -> list[Path]:
    """The folders of several recordings, in natural order; [] where there is one, or none."""
    if not folder.is_dir() or any(_is_image(path) for path in folder.iterdir()):
        return []
    folders = {path.relative_to(folder).parts[0]: None for path in files_in(folder, "*/*", "*/*/*")}
    recordings = [folder / name for name in folders if name != CHECK and _is_recording(files_in(folder / name))]
    return recordings if len(recordings) > 1 else []


def _is_image(path: Path) -> bool:
    return path.is_file() and path.suffix.lower() in IMAGE_SUFFIXES


def _is_recording(files: Sequence[Path]) -> bool:
    """Whether there are images and a log, or measured fields."""
    if any(map(_is_image, files)):
        return any(path.suffix.lower() in LOG_SUFFIXES and _is_log(path) for path in files)
    return bool(find_stages(files))


def _is_log(path: Path) -> bool:
    try:
        return len(Log.read(path).rows) > 1
    except InputError:
        return False
