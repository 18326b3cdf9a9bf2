"""An experiment from Python objects: the tables of experiment.toml, with arrays and records in place of files.

The tables are validated by the models that read the file (`idic.experiment_file.schema`); they name the files that
`Experiment.save` (`idic.notebook`) would write.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idic.experiment_file.load import ExperimentFolder
from idic.experiment_file.tables.further_cameras import camera_files, camera_images
from idic.experiment_file.tables.solver import solver_files
from idic.experiment_file.tables.temperatures import temperature_images
from idic.experiment_file.toml_file import check_values, validated, with_overrides
from idic.model import Experiment
from idic.readers import ArrayFrames, FileStack, Log, RawMesh, matching_files

ORIGIN = Path("idic.Experiment")  # in messages, where that of a folder names the file


@dataclass(frozen=True, eq=False)
class Objects:
    """What takes the place of the files that the tables name; None: the tables have no such key."""

    images: ArrayFrames | FileStack
    mesh: RawMesh | None = None
    loads: Log | None = None
    mask: np.ndarray | None = None


def from_objects(tables: Mapping, objects: Objects, folder: Path) -> Experiment:
    """The experiment of these tables and objects; what else they name (further cameras) lies in `folder`.

    Without a material it is the recording on its mesh (`ExperimentTables.recorded`).

    Raises
    ------
    InputError
        At the first error, as `idic.experiment_file.load.load_experiment`.
    """
    read = _folder(tables, objects, folder).tables()
    return read.experiment() if read.config.material else read.recorded()


def further_files(tables: Mapping, objects: Objects, folder: Path) -> list[Path]:
    """The files in `folder` that the tables name besides the objects."""
    source = _folder(tables, objects, folder)
    table, still = source.config.experiment, []
    if isinstance(table.still_frames, str):
        still = matching_files(folder, [table.still_frames], file=ORIGIN, key="experiment.still_frames")
    times = [folder / table.image_times] if table.image_times is not None else []
    return [*still, *times, *camera_files(source.config, folder), *camera_images(source.config, folder),
            *solver_files(source.config.solver, folder), *temperature_images(source.config, folder, ORIGIN)]


def _folder(tables: Mapping, objects: Objects, folder: Path) -> _ObjectFolder:
    check_values(tables, ORIGIN)
    raw = with_overrides(tables, None)  # the terms of a composed law become parameters
    return _ObjectFolder(ORIGIN, folder.resolve(), validated(raw, ORIGIN), raw, objects)


@dataclass(frozen=True)
class _ObjectFolder(ExperimentFolder):
    """`ExperimentFolder` with the recordings in memory."""

    objects: Objects

    @property
    def stated_order(self) -> str:
        """Objects are in the order in which they were given."""
        return "given"

    def opened_images(self) -> ArrayFrames | FileStack:
        return self.objects.images

    def meshed(self, name: str) -> RawMesh:
        return self.objects.mesh

    def recorded_log(self, name: str) -> Log:
        return self.objects.loads

    def painted(self, name: str) -> np.ndarray:
        return self.objects.mask

    def small_files(self) -> list[Path]:
        return []

    def identity(self, frames, files) -> str:
        return ""
