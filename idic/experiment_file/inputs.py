"""The files that an experiment is made of, for workers that do not see its folder."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from idic.errors import InputError
from idic.experiment_file.load import ExperimentFolder
from idic.experiment_file.recording import ends_of, laws_of_user
from idic.experiment_file.tables.further_cameras import camera_images
from idic.experiment_file.tables.temperatures import temperature_images
from idic.experiment_file.toml_file import law_files, locate, read_toml, validated, with_overrides
from idic.readers import PICTURE_SUFFIXES, image_entries
from idic.remote_files import ImageFacts, fetched_files


@dataclass(frozen=True)
class Inputs:
    """The files of an experiment.

    folder : where all of them lie; read_files : those whose content a worker needs
    images : of those whose pixels it does not read, as the RUN holds them, what their headers say
    """

    folder: Path
    read_files: tuple[Path, ...]
    images: Mapping[Path, ImageFacts]


def inputs_of(path: str | Path, overrides: Mapping[str, Any]) -> Inputs:
    """Find the files of an experiment; images whose pixels decide how it is read (still frames) count as whole.

    Raises
    ------
    InputError
        As `load_experiment`; a file that lies outside the folder of the experiment.
    """
    file = locate(path)
    raw = with_overrides(read_toml(file), overrides)
    read = ExperimentFolder(file, file.parent.resolve(), validated(raw, file), raw)
    with fetched_files() as fetched:
        tables = read.tables()
        tables.experiment()
    frames = tables.recording.frames
    stack = frames.stack if frames.recorded is None else frames.recorded.stack
    recorded = [*(entry.path for entry in stack.entries), *camera_images(read.config, read.folder)]
    images = {image: _facts(image) for image in dict.fromkeys(recorded)
              if _is_image(image) and str(image) not in fetched}
    own_laws = laws_of_user(read.config.material)  # IDIC_LAWS names them on every worker
    read_files = [read.folder / file.name,
                  *(read.folder / law.relative_to(file.parent) for law in law_files(file) if _below(law, file)),
                  *(source for source in tables.recording.files if source not in own_laws), *read.still_files(frames),
                  *temperature_images(read.config, read.folder, file),
                  *(image for image in recorded if image not in images),
                  *_beside(fetched, recorded)]
    return Inputs(read.folder, tuple(dict.fromkeys(read_files)), images)


def _beside(fetched: set[str], recorded: Iterable[Path]) -> list[Path]:
    """Files that were read beside the images: headers of films, sizes of pixels of a microscope."""
    folders, images = {image.parent for image in recorded}, set(recorded)
    return [path for path in sorted(map(Path, fetched)) if path.parent in folders and path not in images]


def _below(path: Path, file: Path) -> bool:
    if path.is_relative_to(file.parent) and ".." not in path.relative_to(file.parent).parts:
        return True
    raise InputError("a law file outside of the experiment", file=file, key="from",
                     expected="a file in its folder, because workers without a common disk get only this folder",
                     found=str(path), remedy="copy it into the folder")


def _is_image(path: Path) -> bool:
    return path.suffix.lower() in PICTURE_SUFFIXES


def _facts(path: Path) -> ImageFacts:
    entries = tuple((entry.page, entry.shape, entry.dtype, entry.label, entry.orientation)
                    for entry in image_entries(path))
    return ImageFacts(*ends_of(path), entries)
