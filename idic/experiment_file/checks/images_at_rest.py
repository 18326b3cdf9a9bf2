"""Images at rest, which give the noise or are averaged to the reference: whether they are what they are taken for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from idic.errors import InputError
from idic.experiment_file.checks.model import corners_px, seen_nodes, seen_region, visible_cells
from idic.images import MIN_TOLD_SHIFT_PX, Stack, shifts
from idic.model import Experiment

MIN_CONTRAST_SHARE = 0.1  # of the largest among them: less is a closed shutter, or a specimen out of view
MAX_CHANGE_SHARE = 0.5  # of the contrast: a difference that large is a motion of speckles, beyond any measured shift


def check_depth(still: Stack, test: Stack, file, key: str) -> None:
    """InputError where separate images at rest count grey values otherwise than those of the test."""
    dtype, expected = still.frame(0).dtype, test.frame(0).dtype
    if dtype != expected and {dtype.kind, expected.kind} == {"u"}:
        raise InputError("the still frames differ in depth from the images", file=file, key=key,
                         expected=f"{expected}, as the images of the test", found=f"{dtype}",
                         remedy="store them alike: the noise is measured in grey values, of which one depth has "
                                "256 to one of the other")


def check_exposures(images: Sequence[np.ndarray], labels: Sequence[str], region: np.ndarray, file, key: str) -> None:
    """InputError where the difference of consecutive still frames is not that of two exposures of the specimen.

    region : (ny, nx) bool, True on the specimen
    """
    check_pattern(images, labels, region, file, key)
    for (first, image), (second, next_image) in pairwise(zip(labels, images, strict=True)):
        if np.shape(image) == np.shape(next_image) and np.array_equal(image[region], next_image[region],
                                                                      equal_nan=image.dtype.kind == "f"):
            raise InputError("two still frames are the same image", file=file, key=key,
                             expected="images that were taken one after the other", found=f"{second} repeats {first}",
                             remedy="leave one of them out: their difference holds no noise; of images without any, "
                                    "give noise_std_gv")


def check_pattern(images: Sequence[np.ndarray], labels: Sequence[str], region: np.ndarray, file, key: str) -> None:
    """InputError where one of the images has hardly any of the others' contrast on the specimen."""
    if len({np.shape(image) for image in images}) > 1:
        return  # told elsewhere
    contrasts = np.array([np.nanstd(np.asarray(image, dtype=float)[region]) for image in images])
    worst = int(np.argmin(contrasts))
    if contrasts[worst] < MIN_CONTRAST_SHARE * contrasts.max():
        raise InputError("an image at rest shows no pattern", file=file, key=key,
                         expected="the specimen in every one of them", remedy="leave it out",
                         found=f"{labels[worst]}, with {contrasts[worst]:.2g} of the {contrasts.max():.3g} grey values "
                               "of contrast that others have")


def with_notes_on_references(experiment: Experiment, file) -> Experiment:
    """The experiment with a note for every camera whose averaged reference images are not at rest.

    Raises
    ------
    InputError
        One of them shows no pattern.
    """
    recording = experiment.recording
    if len(recording.averaged) < 2 or recording.quantity != "grey" or recording.stack is None:
        return experiment
    notes = []
    for view in experiment.views:
        points, cells = seen_nodes(view.model.mesh, view.model.kind, view.model.surface)
        shape = view.recording.image_shape
        region = seen_region(corners_px(points, cells, view.model.kind, view.model.surface, view.model.camera),
                             visible_cells(view.model.mesh, view.model.kind, view.model.surface, view.model.camera,
                                           shape), shape, view.recording.mask)
        images = [np.asarray(view.recording.stack.frame(k)) for k in view.recording.averaged]
        labels = [view.recording.labels[k] for k in view.recording.averaged]
        check_pattern(images, labels, region, file, "experiment.reference")
        if note := _motion_note(images, labels, region):
            notes.append(note if view is experiment else f"{view.recording.camera_name}: {note}")
    return replace(experiment, notes=(*experiment.notes, *notes))


def _motion_note(images: Sequence[np.ndarray], labels: Sequence[str], region: np.ndarray) -> str:
    size = np.hypot(*shifts(images, region).T)
    worst, first = int(np.argmax(size)), np.asarray(images[0], dtype=float)[region]
    changes = np.array([np.std(np.asarray(image, dtype=float)[region] - first) for image in images])
    if changes.max() > MAX_CHANGE_SHARE * first.std():
        worst, moved = int(np.argmax(changes)), "by a speckle or more"
    elif size[worst] >= MIN_TOLD_SHIFT_PX:
        moved = f"by {size[worst]:.2g} px"
    else:
        return ""
    return (f"the reference images are not at rest: {labels[worst]} has moved {moved} against {labels[0]}. Their mean "
            "is blurred, and all motion counts from a place in between: average images at rest only")
