"""The tool on a folder without truth: identification of the user's model and its diagnosis.

The functions are those of `idic identify` and `idic diagnose`; images stay in memory, one process does everything. The
noise is what a RUN would count: the stated one, unless the images show more.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from idic.diagnose import Candidate, Diagnosis, diagnose_without_spots, free_parameters
from idic.experiment_file import ExperimentTables, read_experiment, with_overrides
from idic.identification import Identification, identify, measured_noise
from idic.images import ArrayStack, Stack
from idic.model import Experiment, MotionError
from idic.report import diagnosis_content
from idic.run import SerialRunner, cracks_content, run_refits
from idic_studies.trial.ablations import ablations, omnibus
from idic_studies.trial.scenes.recording import IMAGES


@dataclass(frozen=True)
class FolderSource:
    """A folder of a trial with edits: the counterpart of `idic.run.diagnosis.source.Source` for a RUN.

    tables : of the folder, with its images in memory; original : its experiment
    """

    tables: ExperimentTables = field(repr=False)
    original: Experiment = field(repr=False)
    edits: Mapping[str, Any] = field(default_factory=dict)
    motion_error: MotionError | None = field(default=None, repr=False)

    @classmethod
    def of(cls, folder: str | Path, stack: Stack) -> FolderSource:
        """Read a folder."""
        tables = read_experiment(folder, stack=stack)
        return cls(tables, tables.experiment())

    def document(self) -> dict:
        """Tables of experiment.toml with the present edits."""
        return with_overrides(self.tables.raw, self.edits)

    def load(self, edits: Mapping[str, Any] | None = None) -> Experiment:
        """The experiment with further edits."""
        edited = self.tables.edited({**self.edits, **(edits or {})}, self.original).experiment()
        return replace(edited, model=replace(edited.model, motion_error=self.motion_error))

    def with_measured_noise(self) -> FolderSource:
        """With the noise that a RUN of this folder would count (`idic.identification.noise.input_noise`)."""
        return replace(self, original=replace(self.original, recording=replace(self.original.recording,
                                                                               noise=measured_noise(self.original))))

    def with_edits(self, edits: Mapping[str, Any]) -> FolderSource:
        return replace(self, edits={**self.edits, **edits})

    def with_motion_error(self, error: MotionError) -> FolderSource:
        return replace(self, motion_error=error)


@dataclass(frozen=True, eq=False)
class ToolRun:
    """The answer of the tool and its basis.

    content : as diagnosis.json, with ``identified``: status and parameters of the user's model; cost : CPU seconds
    """

    content: dict
    found: Identification
    diagnosis: Diagnosis


def run_tool(folder: Path, library: Sequence[Candidate] | None = None, with_ablations: bool = False) -> ToolRun:
    """Identify and diagnose a folder; with_ablations : ablations and decoys of the first screening, too."""
    began = time.process_time()
    source = FolderSource.of(folder, ArrayStack(np.load(folder / IMAGES, allow_pickle=False))).with_measured_noise()
    identification = identify(source.load())
    identified = time.process_time() - began
    ablated: list[dict] = []

    def watch(*screening) -> None:
        if with_ablations and not ablated:
            ablated.append(ablations(*screening))

    diagnosis = diagnose_without_spots(source, identification, partial(run_refits, SerialRunner(), None),
                                       library=library, watch=watch)
    parameters_before = free_parameters(identification.result)
    content = diagnosis_content(diagnosis, parameters_before, time.process_time() - began, cracks_content(diagnosis))
    content["cost"] = {name: round(seconds, 2) for name, seconds in content["cost"].items()}
    content["cost"] |= {"identify_cpu_s": round(identified, 2), "cpu_s": round(time.process_time() - began, 2)}
    if ablated:
        content["ablations"] = ablated[0] | {"size": omnibus(content["mismatch"].get("tests", ()))}
    content["identified"] = {"status": identification.state.status, "parameters": {
        name: {"value": entry["value"], "std": entry["std"]} for name, entry in parameters_before.items()}}
    return ToolRun(content, identification, diagnosis)
