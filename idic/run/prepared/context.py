"""A RUN folder as a worker sees it: the experiment with its stored images, ready to simulate and to correlate."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from idic.correlation import CorrelationContext, Reference, VolumeReference, Weights, build_experiment_reference
from idic.errors import InputError
from idic.experiment_file import ExperimentTables, read_experiment
from idic.identification import measured_reference, point_context, seen_in
from idic.images import Camera
from idic.inside import read_inside, refuse_outside_of_data
from idic.measure import BoundaryStart, with_boundary_start
from idic.model import Experiment, ForwardModel, Stage, build_forward
from idic.parameters import ParameterSet
from idic.path_names import path_name
from idic.remote_files import here
from idic.run.store.arrays import read_array
from idic.run.store.camera_groups import group_of, with_stored_images, with_stored_noise
from idic.run.store.checkpoint import from_hex, load_checkpoint
from idic.run.store.layout import DESCRIPTION, DESCRIPTION_SCHEMA, EXPERIMENTS, FROM_PYTHON
from idic.run.store.result_file import RESULT_FILE
from idic.run.store.run_store import RunStore
from idic.run.store.slices import SlicedVolumes
from idic.run.workers.probe import ExperimentToSee


@dataclass(frozen=True)
class RunContext:
    """A RUN as a worker sees it: the experiment with its ingested images, ready to simulate.

    tables : of the experiment as it was read, which an edited model is made from
    """

    store: RunStore
    tables: ExperimentTables
    experiment: Experiment
    forward: ForwardModel
    settings: Mapping

    def at_stage(self, stage: Stage | None) -> RunContext:
        """The same with the images of a stage of the schedule."""
        return self if stage is None else replace(self, experiment=seen_in(self.experiment, stage))

    @property
    def names(self) -> tuple[str, ...]:
        """Every free degree of freedom."""
        return self.experiment.model.parameters.free

    @property
    def moving(self) -> tuple[str, ...]:
        """Those that change the simulation."""
        return tuple(name for name in self.names if self.forward.moves(name))

    @property
    def external(self) -> bool:
        """Whether an external program simulates."""
        return self.experiment.model.solver is not None

    @property
    def weights(self) -> Weights:
        w = self.settings["weights"]
        return Weights(w["image"], w["image_noise"], np.array(w["channels"], float),
                       np.array(w["channel_noise"], float), tuple(w["cameras"]), tuple(w["camera_noise"]))


def open_run(run: str) -> RunContext:
    """The context of a RUN; kept in the worker until its description changes."""
    try:
        content = read_inside(run, DESCRIPTION)
    except (FileNotFoundError, NotADirectoryError):
        raise _no_run(run) from None
    return _open_run(str(run), content)


def _no_run(run: str) -> InputError:
    if (Path(run) / RESULT_FILE).exists():
        return InputError("this folder holds the results of a run alone", file=run, expected=f"its {DESCRIPTION} too",
                          found="none: idic clean --results-only removes images, motions and state",
                          remedy="identify the experiment again into a new RUN")
    return InputError("there is no run", file=run, expected=f"a RUN folder with {DESCRIPTION}", found="none",
                      remedy="name a folder that idic identify wrote")


@lru_cache(maxsize=8)  # several experiments may be at work in turn
def _open_run(run: str, content: bytes) -> RunContext:
    store = RunStore(run)
    store.refuse_special_files()
    store.refuse_other_version()
    settings = load_checkpoint(Path(run) / DESCRIPTION, DESCRIPTION_SCHEMA)
    settings = settings | {"experiment": _experiment_of(run, settings)}
    tables = read_experiment(settings["experiment"], settings["overrides"])
    experiment = tables.experiment()
    if experiment.recording.identity != settings["identity"]:
        raise InputError("the experiment has changed since this run began", file=settings["experiment"],
                         expected=f"identity {settings['identity'][:16]}",
                         found=f"identity {experiment.recording.identity[:16]}",
                         remedy="restore its files, or identify it again into a new RUN")
    _refuse_other_lengths(settings, experiment, Path(run) / DESCRIPTION)
    experiment = with_stored_noise(with_stored_images(store, experiment), settings)
    experiment = replace(experiment, recording=replace(experiment.recording, excluded=tuple(settings["excluded"])))
    experiment = with_boundary_start(experiment, stored_start(store, settings))
    return RunContext(store, tables, experiment, build_forward(experiment), settings)


def _refuse_other_lengths(settings: Mapping, experiment: Experiment, file: Path) -> None:
    """`InputError` where a description has other numbers of cameras, channels or frames than its experiment."""
    n_cameras, n_channels, weights = len(experiment.cameras), len(experiment.model.channels), settings["weights"]
    lengths = {"camera_noises": (settings["camera_noises"], n_cameras), "cameras": (weights["cameras"], n_cameras),
               "camera_noise": (weights["camera_noise"], n_cameras), "channels": (weights["channels"], n_channels),
               "channel_noise": (weights["channel_noise"], n_channels),
               "channel_noise_source": (settings["channel_noise_source"], n_channels)}
    wrong = [f"{len(entries)} of {key}" for key, (entries, n) in lengths.items() if len(entries) != n]
    wrong += [f"frame {k}" for k in settings["excluded"] if k >= experiment.model.n_frames]
    if wrong:
        raise InputError("the description of the run is that of another experiment", file=file,
                         expected=f"{n_cameras} further cameras, {n_channels} channels, {experiment.model.n_frames} "
                                  "frames", found=", ".join(wrong[:3]),
                         remedy="do not use this folder; identify the experiment again into another --out")


def experiments_of(run: str | Path) -> tuple[ExperimentToSee, ...]:
    """The experiment of a prepared RUN, as its workers read it."""
    settings = load_checkpoint(Path(run) / DESCRIPTION, DESCRIPTION_SCHEMA)
    return (ExperimentToSee(_experiment_of(run, settings), settings["overrides"], settings["identity"]),)


def _experiment_of(run: str | Path, settings: Mapping) -> str:
    """Where the experiment of a RUN lies; one that was saved in the RUN moves with it."""
    path, saved = here(settings["experiment"]), Path(run) / FROM_PYTHON
    if os.path.exists(path):
        refuse_outside_of_data(path, f"experiment of {run}")
        return path
    if saved.is_dir():
        return str(saved.resolve())
    raise InputError("the experiment of this run is no longer where it was", file=run, expected=path, found="nothing",
                     remedy="tell the run where it is now:  idic identify EXPERIMENT --out RUN --resume")


def stored_start(store: RunStore, settings: Mapping) -> BoundaryStart:
    """Starting values and modes of virtual boundaries from `prepare`."""
    stored = settings["boundary"]
    read = lambda name: read_array(store.group("prepared"), path_name(name))  # noqa: E731
    return BoundaryStart({name: from_hex(value) for name, value in stored["values"].items()},  # type: ignore[misc]
                         {name: (read(f"{name}.shapes"), read(f"{name}.courses")) for name in stored["modes"]},
                         tuple(stored["notes"]))


def correlation_context(context: RunContext, parameters: ParameterSet,
                        weights: Weights | None = None) -> CorrelationContext:
    """The record that all frames share at these parameters; a moved camera or mesh gets a new reference image."""
    shape = tuple(parameters[name].value for name in context.forward.morphs)

    def attach(view: Experiment, camera: Camera) -> Reference:
        key = (str(context.store.run), context.experiment.recording.identity, shape, camera.key,
               view.options.lowpass_px)
        place = (key[0], view.recording.camera_name)
        stored_key, reference = _references.get(place, (None, None))
        if stored_key != key:
            for stale in [stale for stale in list(_references) if _family(stale[0]) != _family(place[0])]:
                _references.pop(stale, None)  # threads of one worker share them
            reference = _with_motion(context, view, build_experiment_reference(view, camera))
            _references[place] = (key, reference)
        return reference

    return point_context(context.experiment, parameters, context.forward, context.moving, weights or context.weights,
                         attach)


def release_voxels(context: RunContext) -> None:
    """Give back the voxels of large scans that this process keeps between two passes, up to 650 MB: the factor of a
    solid takes the memory in between, and a process that makes no passes needs none."""
    for _, reference in list(_references.values()):
        if isinstance(reference, VolumeReference):
            reference.release()
    volumes = context.experiment.recording.volumes
    if isinstance(volumes, SlicedVolumes):
        volumes.release()


def _with_motion(context: RunContext, view: Experiment, image: Reference) -> Reference:
    """The reference of the comparison: the images, or with two steps the motion that the first one measured."""
    if not context.experiment.options.is_two_step:
        return image
    number = [camera_view.recording.camera_name
              for camera_view in context.experiment.views].index(view.recording.camera_name)
    folder = context.store.group(group_of(context.experiment, number, "dic"))
    return measured_reference(view, image, read_array(folder, "u_px"))  # type: ignore[return-value]


def _family(run: str) -> Path:
    """The folder that the experiments of a joint run share, or a single run."""
    folder = Path(run).parent
    return folder if folder.name == EXPERIMENTS else Path(run)


_references: dict = {}  # the attached reference image of the last mesh, per run and camera at work in this process
