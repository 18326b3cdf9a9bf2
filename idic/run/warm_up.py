"""Compilation in one process while others work: they read the kernels from numba's disk cache."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from importlib import import_module

import numpy as np

from idic.correlation import (
    CorrelationContext, FrameResponse, Weights, build_experiment_reference, camera_at, frame_system,
)
from idic.experiment_file import load_experiment
from idic.laws import compiled_loop
from idic.model import build_forward
from idic.run.store.camera_groups import with_stored_images
from idic.run.store.run_lock import RunBusy, run_lock
from idic.run.store.run_store import RunStore
from idic.run.workers.working_folder import cache_folder

_LONGEST_WAIT_S = 60.0


def compile_image_kernels(job: tuple[str, str, dict]) -> None:
    """Correlate one frame with a specimen at rest and drop the result (a task).

    What another process of this user compiles meanwhile is waited for, and read.

    job : the RUN folder with its images, the experiment, ``--set key=value``
    """
    with _one_at_a_time():
        _correlate_at_rest(job)


def _correlate_at_rest(job: tuple[str, str, dict]) -> None:
    run, path, overrides = job
    experiment = with_stored_images(RunStore(run), load_experiment(path, overrides))
    frames = experiment.correlated_frames(range(experiment.model.n_frames))
    if not frames:
        return
    forward, parameters = build_forward(experiment), experiment.model.parameters
    camera = camera_at(experiment, parameters)
    moving = tuple(name for name in parameters.free if forward.moves(name))
    n_channels, m = len(experiment.model.channels), forward.drives.n_local
    context = CorrelationContext(
        experiment=experiment, parameters=parameters, names=parameters.free, moving=moving, camera=camera,
        reference=build_experiment_reference(experiment, camera),
        weights=Weights(1.0, 1.0, np.ones(n_channels), np.ones(n_channels)),
        local_precision=forward.drives.local_precision)
    at_rest = np.zeros((len(experiment.model.mesh.nodes), experiment.model.n_dim))
    response = FrameResponse(
        frames[0], at_rest, np.zeros(n_channels), np.zeros((*at_rest.shape, len(moving))),
        np.zeros((n_channels, len(moving))), np.zeros((*at_rest.shape, m)), np.zeros((n_channels, m)))
    frame_system(context, response, np.zeros(m))


@contextmanager
def _one_at_a_time() -> Iterator[None]:
    """A lock of this user, on this machine, on compiling the image kernels; after a minute on without it."""
    end = time.monotonic() + _LONGEST_WAIT_S
    with ExitStack() as locks:
        while time.monotonic() < end:
            with suppress(RunBusy):
                with suppress(OSError):  # nowhere to write
                    locks.enter_context(run_lock(cache_folder() / "compiling"))
                break
            time.sleep(0.1)
        yield


def compile_stress_kernel(_: None) -> None:
    """Compile what only the result needs (a task): the last stage would wait for it, with one process at work."""
    compiled_loop("stress")


def import_meanwhile(module: str, after_s: float = 20.0) -> None:
    """Import a module that is needed later, while this process waits for others.

    after_s : delay, since a run begins with imports in every process
    """
    timer = threading.Timer(after_s, import_module, (module,))
    timer.daemon = True
    timer.start()
