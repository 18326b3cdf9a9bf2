"""Groups of a RUN for the images and maps of each camera.

    run.zarr/images, dic, final, initial                            the main camera
    run.zarr/cameras/NAME/images, dic, final, initial               a further camera
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, replace

from idic.experiment_file import recorded, with_stabilised_images
from idic.images import Stack
from idic.run.store.slices import SlicedVolumes, Slices
from idic.model import CorrelatedNoise, Experiment, Noise
from idic.run.store.arrays import Damaged
from idic.run.store.image_files import refuse_changed
from idic.run.store.run_store import RunStore
from idic.run.store.stack import GROUP as IMAGES
from idic.run.store.stack import Spread, ZarrStack


def group_of(experiment: Experiment, number: int, name: str) -> str:
    """The group `name` of camera `number` (0: the main one)."""
    return name if number == 0 else f"cameras/{experiment.cameras[number - 1].name}/{name}"


def ingest_all(store: RunStore, experiment: Experiment, progress: Callable[[int, int], None] | None = None,
               spread: Spread = map) -> None:
    """Copy the images of every camera into the RUN, unless they are there already.

    progress : called as progress(count, total) over the images of all cameras; spread : as of
    `idic.run.store.stack.ZarrStack.of`
    """
    views = experiment.views
    stacks = [_as_images(view) for view in views]
    total = sum(stack.n_frames for stack in stacks)
    offset = 0
    for number, stack in enumerate(stacks):
        report = progress and (lambda count, _, offset=offset: progress(offset + count, total))  # type: ignore[misc]
        group = group_of(experiment, number, IMAGES)
        ZarrStack.of(store, stack, report, experiment.recording.identity, group, spread)
        offset += stack.n_frames


def _as_images(view: Experiment) -> Stack:
    """The recorded images of a camera; of volumes their slices."""
    stack = recorded(view.recording.stack)
    return Slices(stack) if view.recording.quantity == "volume" else stack


def refuse_changed_images(store: RunStore, experiment: Experiment) -> None:
    """Check that the files of the experiment hold the images that were ingested.

    Raises
    ------
    InputError
        An image has changed since then.
    """
    for number, view in enumerate(experiment.views):
        group = store.described(group_of(experiment, number, IMAGES))
        if group is not None:
            with suppress(Damaged):  # they are ingested anew
                refuse_changed(_as_images(view), ZarrStack(group).files)


def with_stored_images(store: RunStore, experiment: Experiment) -> Experiment:
    """The experiment with the ingested images of all its cameras."""
    stacks = [ZarrStack(store.group(group_of(experiment, number, IMAGES))) for number in range(len(experiment.views))]
    if experiment.recording.quantity == "volume":
        stacks = [SlicedVolumes(stacks[0], experiment.recording.volumes.shape[0])]
    cameras = tuple(replace(camera, stack=stack) for camera, stack in zip(experiment.cameras, stacks[1:], strict=True))
    return with_stabilised_images(replace(experiment, recording=replace(experiment.recording, stack=stacks[0]),
                                          cameras=cameras))


def noise_entry(noise: Noise) -> dict:
    """A camera's noise as stored in ``RUN/run.json``."""
    entry = {"std_gv": noise.std_gv, "source": noise.source}
    return entry if noise.correlated is None else entry | {"correlated": asdict(noise.correlated)}


def _noise_from(entry: Mapping) -> Noise:
    correlated = entry.get("correlated")
    if correlated is not None:
        rows = tuple(tuple(row) for row in correlated["correlation"])
        correlated = CorrelatedNoise(**{**correlated, "correlation": rows})
    return Noise(entry["std_gv"], entry["source"], correlated=correlated)


def with_stored_noise(experiment: Experiment, settings: Mapping) -> Experiment:
    """The experiment with the camera noise that was determined before the first simulation."""
    noises = [_noise_from(entry) for entry in (settings["noise"], *settings["camera_noises"])]
    cameras = tuple(replace(camera, noise=noise) for camera, noise in zip(experiment.cameras, noises[1:], strict=True))
    return replace(experiment, recording=replace(experiment.recording,
                                                 noise=replace(noises[0],
                                                               stabiliser=experiment.recording.noise.stabiliser)),
                   cameras=cameras)
