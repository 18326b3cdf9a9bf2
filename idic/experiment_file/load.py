"""Reads an experiment folder into an `Experiment`: all files are read, converted and checked; none is written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from idic.experiment_file.experiment_tables import ExperimentTables
from idic.experiment_file.recording import Frames, RecordedFolder
from idic.experiment_file.toml_file import locate, read_toml, validated, with_overrides
from idic.images import Stack
from idic.model import Experiment


def load_experiment(path: str | Path, overrides: Mapping[str, Any] | None = None, *,
                    stack: Stack | None = None) -> Experiment:
    """Read and validate an experiment.

    Parameters
    ----------
    path : str or Path
        The experiment folder, or its TOML file.
    overrides : mapping, optional
        ``--set key=value``: dotted keys (``options.max_iterations``, ``boundary.1.uy``), ``SPECIMEN.E`` for the start
        value of a parameter, the name of a [[dof]] for its value.
    stack : Stack, optional
        Images in the place of those that the file names; the first one is the reference.

    Returns
    -------
    Experiment
        In mm, s, MPa, N; images are read on demand.

    Raises
    ------
    InputError
        At the first error, with file, key, expected value, found value and remedy.
    """
    return read_experiment(path, overrides, stack=stack).experiment()


def read_experiment(path: str | Path, overrides: Mapping[str, Any] | None = None, *,
                    stack: Stack | None = None) -> ExperimentTables:
    """Read the files of an experiment; its model is made of them by `ExperimentTables.experiment`, with edits by
    `ExperimentTables.edited`. Parameters as those of `load_experiment`.

    Raises
    ------
    InputError
        At the first error in the tables, or in a file that they name.
    """
    file = locate(path)
    raw = with_overrides(read_toml(file), overrides)
    arguments = file, file.parent.resolve(), validated(raw, file), raw
    return (ExperimentFolder(*arguments) if stack is None else _RenderedFolder(*arguments, stack)).tables()


@dataclass(frozen=True)
class ExperimentFolder(RecordedFolder):
    """One experiment file and its folder."""

    def tables(self) -> ExperimentTables:
        """The tables on what the files hold."""
        return ExperimentTables.of(self.file, self.raw, self.config, self.recording())

    def experiment(self) -> Experiment:
        """See `ExperimentTables.experiment`."""
        return self.tables().experiment()


@dataclass(frozen=True)
class _RenderedFolder(ExperimentFolder):
    stack: Stack

    def frames(self) -> Frames:
        labels = tuple(f"frame {k}" for k in range(self.stack.n_frames))
        return Frames(self.stack, labels, None, 0, (), (), None, self.mask(self.stack), ())

    def identity(self, frames: Frames, files: Sequence[Path]) -> str:
        return ""
