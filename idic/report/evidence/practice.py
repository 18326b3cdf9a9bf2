"""Data to judge a correlation: the facts of the good-practice table, and frames to look at."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from idic.correlation import CELLS
from idic.experiment_file import corners_px, recorded, seen_nodes, seen_region, visible_cells
from idic.images import compressed_at, saturated_share, speckle_size
from idic.model import Experiment, Model, Recording
from idic.report.result.record import FrameView, NoiseFloor, Practice

MAX_FRAME_VIEWS = 10  # frames to look at one by one: a report must stay small enough to be sent by mail


def practice_of(experiment: Experiment, reference, result: Mapping, floor: NoiseFloor,
                sources: Sequence[str]) -> Practice:
    """The facts of the good-practice table, as far as images, mesh and settings tell them.

    reference : of the main camera; sources : where the noise of each channel comes from
    """
    model, recording = experiment.model, experiment.recording
    image = np.asarray(recording.picture(model.reference))
    correlated, n_pixels = _correlated(experiment, reference, image.shape)
    values = image[correlated & np.isfinite(image)].astype(float)
    sides, cell = _elements(model, reference)
    options, stds = experiment.options, result["residual"].get("channel_noise_std", {})
    units = {channel.column: channel.shown_unit for channel in model.channels}
    sigma = (recording.noise.std_gv or 0.0) if recording.noise.stabiliser is None else 0.0
    return Practice(
        version=_version(), setup=dict(experiment.setup), columns=image.shape[1], rows=image.shape[0],
        depth=str(image.dtype), frame_s=_between_frames(model),
        reference=recording.labels[model.reference], n_references=recording.n_references, n_pixels=n_pixels,
        speckle_px=speckle_size(image, correlated, sigma),
        contrast=float(values.std()) if len(values) else 0.0,
        grey_range=(float(values.min()), float(values.max())) if len(values) else (0.0, 0.0),
        saturated=saturated_share(image if recording.points is not None
                                  else recorded(recording.stack).frame(model.reference), correlated),
        lowpass_px=options.lowpass_px, interpolation=options.interpolation, brightness=options.brightness,
        edge_margin_px=options.edge_margin_px, n_elements=len(sides), cell=cell,
        element_px=float(sides.mean()) if len(sides) else 0.0, smallest_px=float(sides.min()) if len(sides) else 0.0,
        kind=model.kind, estimator=str(result.get("estimator", "ordinary")), floor=floor,
        compressed=recording.quantity == "grey" and compressed_at(image) is not None,
        channel_noise=tuple((name, units.get(name, ""), std, source)
                            for (name, std), source in zip(stds.items(), sources, strict=False)))


def frame_views(recording: Recording, frames: Sequence[int], nodes_px: Callable[[int], np.ndarray],
                residual: Callable[[int], np.ndarray | None]) -> tuple[FrameView, ...]:
    """At most `MAX_FRAME_VIEWS` of the frames, spread evenly, the last among them.

    nodes_px : frame -> where the simulation puts the nodes; residual : frame -> its residual
    """
    n_views = min(MAX_FRAME_VIEWS, len(frames))
    picks = np.unique(np.linspace(0, len(frames) - 1, n_views).round().astype(int)) if frames else []
    return tuple(FrameView(k, np.asarray(recording.picture(k)), nodes_px(k), residual(k))
                 for k in (frames[int(i)] for i in picks))


def _correlated(experiment: Experiment, reference, shape: tuple[int, int]) -> tuple[np.ndarray, int]:
    """Pixels that are compared, as an image, and their number."""
    model = experiment.model
    if not reference.is_section:
        pixel_map = reference.pixel_map
        return pixel_map.to_image(np.ones(pixel_map.n_pixels), 0.0) > 0.0, pixel_map.n_pixels
    points, cells = seen_nodes(model.mesh, model.kind, model.surface)
    corners = corners_px(points, cells, model.kind, model.surface, model.camera)
    visible = visible_cells(model.mesh, model.kind, model.surface, model.camera, shape)
    region = seen_region(corners, visible, shape, experiment.recording.mask)
    return region, int(region.sum())


def _elements(model: Model, reference) -> tuple[np.ndarray, str]:
    """Mean side of each element that is seen, px, and their kinds in words  # (n,)"""
    if reference.is_section:
        points, cells = seen_nodes(model.mesh, model.kind, model.surface)
        corners = corners_px(points, cells, model.kind, model.surface, model.camera)
        return np.array([_side(polygon) for polygon in corners]), "edge"
    pixel_map, sides = reference.pixel_map, []
    for kind, conn in zip(pixel_map.kind, pixel_map.conn, strict=True):
        corners = 3 if CELLS[kind].startswith("tri") else 4
        sides.append(_side(pixel_map.nodes_px[conn[:corners]]))
    return np.array(sides), ", ".join(CELLS[kind] for kind in np.unique(pixel_map.kind))


def _side(corners: np.ndarray) -> float:
    ends = corners[1:] if len(corners) == 2 else np.roll(corners, -1, axis=0)
    return float(np.hypot(*(ends - corners[:len(ends)]).T).mean())


def _between_frames(model: Model) -> float | None:
    """Median time between images, s; None where no time is known."""
    if not model.has_times or model.n_frames < 2:
        return None
    return float(np.median(np.diff(model.times)))


def _version() -> str:
    try:
        return version("idic")
    except PackageNotFoundError:
        return "of a source tree"
