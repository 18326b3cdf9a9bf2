"""`idic check`: every image decoded, the mesh drawn on the reference image, the noise estimated; no simulation,
except where values of cameras with a lens are free."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from idic.identification import check_volume_axes, planned_increments, repeated_readings
from idic.experiment_file import corners_px, recorded, seen_nodes, seen_region, visible_cells
from idic.images import largest_value, saturated_share, speckle_size
from idic.measure import FrameSequence
from idic.model import Experiment, Measured, Model, Noise, Options, Recording, Remedies, in_words
from idic.parameters import digits_text
from idic.readers import check_stages, mean_strain
from idic.report.evidence.causes.before_run import causes_in_motion, sampled_frames
from idic.report.evidence.causes.course import increments_by_load
from idic.report.evidence.causes.lines import excluded_frames
from idic.report.evidence.cost import Cost, expected_cost
from idic.report.evidence.placement import mirrored_axes, misplaced_still_frames
from idic.report.evidence.plausible import (
    MAX_PLAIN_SHARE, NO_PATTERN, implausible_scale, implausible_thickness, implausible_values, loaded_reference,
    pattern_warnings, separate_pieces, start_values, sums_of_all_reactions, without_pattern,
)
from idic.report.evidence.rig import rig_warnings
from idic.report.figures.mesh.overlay import mesh_on_points, mesh_overlay
from idic.report.figures.picture import Picture
from idic.windows import away_from_edges

_MIN_ELEMENT_PX = 60.0  # pixels per element: with fewer, a free displacement scatters by more than 0.05 px at 1 % noise
_MAX_SATURATED_SHARE = 0.01  # share of the ROI
_MAX_GAP_SHARE = 0.02  # share of the ROI: more isolated gaps take half of the pixels with them
_MIN_CONTRAST = 4.0  # standard deviation of the pattern over that of the noise
MIN_POINTS_PER_ELEMENT = 4.0  # of measured fields
MIN_SEEN_PART = 0.5  # of the points of the reference stage
_MAX_BRIGHTNESS_CHANGE = 0.2  # relative change of the mean grey value from the reference


@dataclass(frozen=True)
class CheckReport:
    """Facts on an experiment before its identification, with warnings."""

    title: str
    n_frames: int
    reference: str
    excluded: tuple[str, ...]
    image_size: tuple[int, int]  # (columns, rows)
    depth: str
    n_nodes: int
    n_elements: int
    n_seen: int
    n_visible: int
    px_per_element: float  # mean area of a visible element
    smallest_element_px: float
    length_unit: str
    free_parameters: tuple[str, ...]
    channels: tuple[str, ...]
    noise: Noise
    contrast_gv: float  # standard deviation of the pattern in the ROI
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    overlay: Picture | None = field(repr=False)
    name: str = "camera"
    cameras: tuple[CheckReport, ...] = ()  # the same of the further cameras
    value_unit: str = "grey values"  # of noise and pattern
    cost: Cost | None = None  # of the identification; None for a further camera
    points: str = ""  # of measured fields, in words
    volume: str = ""  # size and voxels of scans, in words
    starts: tuple[str, ...] = ()  # of `free_parameters`: with their start values
    noise_keys: str = "noise_std_gv"  # that state the noise

    def lines(self) -> list[str]:
        """The report as text, one fact per line."""
        noise = "not known yet: the identification takes it from the residual of a free FE-DIC"
        if self.value_unit != "grey values":
            noise = f"not known: give {self.noise_keys}"
        if self.noise.std_gv is not None:
            noise = f"{digits_text(self.noise.std_gv)} ({self.noise.source})"
        excluded = f", excluded {', '.join(self.excluded)}" if self.excluded else ""
        if self.points:
            return self._lines_of_fields(noise, excluded)
        if self.volume:
            return self._lines_of_volumes(noise, excluded)
        return [
            f"{self.title}",
            f"frames       {self.n_frames}, {self.image_size[0]} x {self.image_size[1]} px, {self.depth}; "
            f"reference {self.reference}{excluded}",
            f"mesh         {self.n_nodes} nodes, {self.n_elements} elements; {self.n_visible} of {self.n_seen} seen",
            f"resolution   {self.px_per_element:.0f} px per element{self._smallest()}, lengths in {self.length_unit}",
            f"pattern      {digits_text(self.contrast_gv)} {self.value_unit} (standard deviation in the ROI); "
            f"noise {noise}",
            f"channels     {', '.join(self.channels) or 'none'}",
            f"to identify  {self._to_identify()}",
            *([f"cost         {self.cost.line()}"] if self.cost is not None else []),
            *(f"note         {text}" for text in self.notes),
            *(f"warning      {text}" for text in self.warnings),
            *(line for camera in self.cameras for line in camera.short_lines()),
        ]

    def _smallest(self) -> str:
        """The smallest element, where it is another one than the mean."""
        smallest = f"{self.smallest_element_px:.0f}"
        return "" if smallest == f"{self.px_per_element:.0f}" else f" (smallest {smallest})"

    def _lines_of_fields(self, noise: str, excluded: str) -> list[str]:
        """The same of measured fields."""
        return [
            f"{self.title}",
            f"stages       {self.n_frames}; reference {self.reference}{excluded}",
            f"points       {self.points}",
            f"mesh         {self.n_nodes} nodes, {self.n_elements} elements; lengths in {self.length_unit}",
            f"noise        {noise} {self.value_unit} per component of a point",
            f"channels     {', '.join(self.channels) or 'none'}",
            f"to identify  {self._to_identify()}",
            *([f"cost         {self.cost.line()}"] if self.cost is not None else []),
            *(f"note         {text}" for text in self.notes),
            *(f"warning      {text}" for text in self.warnings),
        ]

    def _lines_of_volumes(self, noise: str, excluded: str) -> list[str]:
        """The same of volumes."""
        return [
            f"{self.title}",
            f"scans        {self.n_frames}, {self.volume}; reference {self.reference}{excluded}",
            f"mesh         {self.n_nodes} nodes, {self.n_elements} elements; {self.n_visible} of {self.n_seen} in the "
            "volume",
            f"resolution   {self.px_per_element:.0f} voxels per element{self._smallest()}",
            f"texture      {digits_text(self.contrast_gv)} {self.value_unit} (standard deviation in the middle); "
            f"noise {noise}",
            f"channels     {', '.join(self.channels) or 'none'}",
            f"to identify  {self._to_identify()}",
            *([f"cost         {self.cost.line()}"] if self.cost is not None else []),
            *(f"note         {text}" for text in self.notes),
            *(f"warning      {text}" for text in self.warnings),
        ]

    def _to_identify(self) -> str:
        """The free parameters with their start values; modes counted."""
        start = dict(zip(self.free_parameters, self.starts, strict=True)) if self.starts else {}
        names = in_words(self.free_parameters, self.free_parameters)
        return ", ".join(f"{name}{start.get(name, '')}" for name in names) or "nothing"

    def short_lines(self) -> list[str]:
        """The facts that differ between the cameras of one experiment."""
        noise = ("unknown yet" if self.noise.std_gv is None else
                 f"{digits_text(self.noise.std_gv)} ({self.noise.source})")
        return [f"camera       {self.name}: {self.image_size[0]} x {self.image_size[1]} px, {self.depth}; "
                f"{self.n_visible} of {self.n_seen} elements seen, {self.px_per_element:.0f} px each; pattern "
                f"{digits_text(self.contrast_gv)}, noise {noise}",
                *(f"warning      {self.name}: {text}" for text in self.warnings)]


def _margin_note(options: Options) -> tuple[str, ...]:
    margin = options.edge_margin_px
    return (f"{margin} px along the edges of the mesh are not compared (edge_margin_px under [options])",
            ) if margin else ()


def check(experiment: Experiment, overlay_to: str | Path | None = None, draw: bool = True) -> CheckReport:
    """Decode every image, look at mesh, pattern and noise, and draw the mesh on the reference image.

    Parameters
    ----------
    overlay_to : path, optional
        A PNG file for the drawing; nothing is written otherwise.
    draw : bool
        False: no drawing, which is most of the time that this takes.

    Raises
    ------
    InputError
        An image that cannot be decoded.
    """
    placed = experiment.at_geometry(experiment.model.parameters)
    inspected = [_check_camera(view, draw, is_main=view is placed) for view in placed.views]
    main, *further_cameras = [report for report, _ in inspected]
    if overlay_to is not None and main.overlay is not None:
        Path(overlay_to).write_bytes(main.overlay.png)
    cost = expected_cost(experiment)
    return replace(main, cameras=tuple(further_cameras), cost=cost,
                   warnings=(*main.warnings, *_late_cameras([sequence for _, sequence in inspected]),
                             *_model_warnings(experiment), *rig_warnings(placed, cost.time_s),
                             *cost.warnings()))


def _late_cameras(sequences: Sequence[FrameSequence | None]) -> Iterator[str]:
    """Cameras that take their images at other times than the main one."""
    main, *further_cameras = sequences
    for sequence in further_cameras:
        if main is not None and sequence is not None:
            yield from sequence.late_against(main)


def _check_camera(experiment: Experiment, draw: bool, is_main: bool) -> tuple[CheckReport, FrameSequence | None]:
    """The facts on one camera, and its images as a sequence; experiment : its view; is_main : its motion is compared
    with the log."""
    model, recording = experiment.model, experiment.recording
    if recording.quantity == "volume":
        return _check_volume(experiment, draw), None
    stack, shape = recording.stack, recording.image_shape
    reference = recording.picture(model.reference)
    points, cells = seen_nodes(model.mesh, model.kind, model.surface)
    visible = visible_cells(model.mesh, model.kind, model.surface, model.camera, shape)
    corners = corners_px(points, cells, model.kind, model.surface, model.camera)
    areas = np.array([_area(cell) for cell in corners])[visible]
    roi = seen_region(corners, visible, shape, recording.mask)
    noise = recording.noise
    picture = overlay(experiment) if draw else None
    field_notes, field_warnings = _of_fields(experiment, corners, visible) if recording.points is not None else ((), ())
    labels = recording.labels
    scale = () if recording.points is not None else tuple(_scale_warnings(experiment, corners, visible))
    plain, width = NO_PATTERN, None
    if recording.quantity == "grey" and not scale:
        width = speckle_size(reference, roi, noise.std_gv or 0.0)
        plain = without_pattern(reference, roi, noise.std_gv, width)
    is_placed = not scale and float(plain.mean()) <= MAX_PLAIN_SHARE
    images = _Decoded() if recording.points is not None else _decoded(experiment, reference, roi, is_main)
    if images.sequence is not None:
        images.sequence.check_order()
    end, motion_warnings = causes_in_motion(experiment, reference if is_placed else None,
                                            images.picture(experiment)) if is_main else ((), ())
    warnings = field_warnings if images.sequence is None else (
        *scale, *(() if scale else _place_warnings(experiment, reference, roi, areas, width, plain)),
        *_reference_warnings(experiment, reference, roi), *images.sequence.order_warnings(),
        *images.sequence.repeated(images.equal), *images.sequence.lost(),
        *_other_light(experiment, [k for k in images.other_light if k not in end]))
    return CheckReport(
        experiment.title, stack.n_frames, labels[model.reference], tuple(labels[k] for k in recording.excluded),
        (shape[1], shape[0]), str(reference.dtype), model.mesh.n_nodes, model.mesh.n_elements,
        len(cells), int(visible.sum()),
        float(areas.mean()), float(areas.min()), model.length_unit, model.parameters.free,
        tuple(channel.column for channel in model.channels), noise, float(np.nanstd(reference[roi])),
        (*experiment.notes, *field_notes, *_margin_note(experiment.options), *planned_increments(experiment)),
        (*warnings, *motion_warnings), picture,
        recording.camera_name,
        value_unit=recording.value_unit, points=_points_line(recording), starts=start_values(model),
        noise_keys=Remedies(experiment).possible("noise_std_gv", "still_frames", "fields_noise_um")), images.sequence


def _check_volume(experiment: Experiment, draw: bool) -> CheckReport:
    """The facts on volumes."""
    from idic.report.evidence.volumes.facts import volume_facts

    model, recording = experiment.model, experiment.recording
    facts, labels = volume_facts(experiment), recording.labels
    check_volume_axes(experiment)
    nz, ny, nx = recording.volumes.shape
    voxel = " x ".join(f"{side:.6g}" for side in dict.fromkeys(model.camera.voxel_mm.tolist()))
    return CheckReport(
        experiment.title, recording.stack.n_frames, labels[model.reference],
        tuple(labels[k] for k in recording.excluded), (nx, ny), facts.dtype, model.mesh.n_nodes, model.mesh.n_elements,
        model.mesh.n_elements, facts.n_seen, facts.element_voxels, facts.smallest_voxels, model.length_unit,
        model.parameters.free, tuple(channel.column for channel in model.channels), recording.noise, facts.contrast_gv,
        (*experiment.notes, *_margin_note(experiment.options), *planned_increments(experiment)), facts.warnings,
        overlay(experiment) if draw else None, recording.camera_name, starts=start_values(model),
        volume=f"{nx} x {ny} x {nz} voxels of {voxel} mm (columns, rows, slices), {facts.dtype}")


def overlay(experiment: Experiment) -> Picture:
    """The mesh of a view, drawn on its reference image, on the measured points or on sections of a volume."""
    model, recording = experiment.model, experiment.recording
    if recording.quantity == "volume":
        from idic.report.evidence.volumes.facts import volume_overlay

        return volume_overlay(experiment)
    points, cells = seen_nodes(model.mesh, model.kind, model.surface)
    camera, shape = model.camera, recording.image_shape
    corners = corners_px(points, cells, model.kind, model.surface, camera)
    sets = _sets_px(model, points)
    if recording.points is not None:
        return mesh_on_points(camera.inverse(recording.points.positions_px),
                              [camera.inverse(cell) for cell in corners],
                              {name: camera.inverse(at) for name, at in sets.items()})
    visible = visible_cells(model.mesh, model.kind, model.surface, camera, shape)
    return mesh_overlay(recording.stack.frame(model.reference), corners, visible, sets, recording.mask)


def _area(cell: np.ndarray) -> float:
    following = np.roll(cell, -1, axis=0)
    area = 0.5 * abs(float((cell[:, 0] * following[:, 1] - following[:, 0] * cell[:, 1]).sum()))
    return area if len(cell) > 2 else float(np.hypot(*(cell[1] - cell[0])))


def _sets_px(model: Model, points: np.ndarray) -> dict[str, np.ndarray]:
    used = [entry.nodes for entry in model.prescribed]
    used += [name for c in model.channels if c.kind != "pressure" for name in (c.nodes, c.minus) if name]
    names = dict.fromkeys(used)
    return {name: model.camera.project(points[model.mesh.node_sets[name]]) for name in names}


def _place_warnings(experiment: Experiment, reference: np.ndarray, roi: np.ndarray, areas: np.ndarray,
                    width: float | None, plain: np.ndarray) -> Iterator[str]:
    """Warnings of the pattern below a mesh of the right scale; width : of the speckle, px; plain : pixels of the ROI
    without pattern."""
    noise = experiment.recording.noise
    if areas.mean() < _MIN_ELEMENT_PX and experiment.model.surface is None:
        yield (f"only {areas.mean():.0f} px per element: enough for the identification, too few for the free FE-DIC of "
               "the report; larger elements would do for both")
    if experiment.recording.quantity == "grey":
        yield from pattern_warnings(experiment, reference, roi, float(areas.mean()), width, plain)
        yield from mirrored_axes(experiment, reference, float(plain.mean()), width)
    contrast = float(np.nanstd(reference[roi]))
    if contrast == 0.0:
        yield ("the ROI has no pattern, so nothing can be correlated: check the reference image and the place of the "
               f"mesh in it ({Remedies(experiment).place})")
    elif noise.std_gv is not None and contrast < _MIN_CONTRAST * noise.std_gv:
        yield (f"the pattern ({digits_text(contrast)}) is less than {_MIN_CONTRAST:g} times the noise "
               f"({digits_text(noise.std_gv)}): expect large error bars; improve contrast or lighting")


def _reference_warnings(experiment: Experiment, reference: np.ndarray, roi: np.ndarray) -> Iterator[str]:
    """Warnings of the reference image and of those at rest."""
    recording = experiment.recording
    image = recorded(recording.stack).frame(experiment.model.reference)
    share = saturated_share(image, roi) or 0.0
    if share > _MAX_SATURATED_SHARE:
        yield (f"{100 * share:.1f} % of the pixels in the ROI are saturated (grey value {largest_value(image)}): "
               "the pattern is cut there. A shorter exposure next time"
               + Remedies(experiment).possible("; now a mask without them"))
    if recording.quantity == "grey":
        yield from misplaced_still_frames(experiment, roi)
    inner = away_from_edges(roi, 2)  # outside the specimen there is no height
    gaps = float(np.isnan(reference[inner]).mean()) if reference.dtype.kind == "f" and inner.any() else 0.0
    if gaps > _MAX_GAP_SHARE:
        remedy = Remedies(experiment).possible("fill the gaps", "leave them out with a mask")
        yield (f"{100 * gaps:.0f} % of the reference image in the ROI has no value, and interpolation also loses the "
               f"neighbours of each gap: {remedy}")


@dataclass(frozen=True)
class _Decoded:
    """What one pass over the images shows.

    sequence : their motion from one to the next; equal : frames that repeat the one before to the last grey value;
    other_light : frames whose mean grey value is another; kept : some frames
    """

    sequence: FrameSequence | None = None
    equal: tuple[int, ...] = ()
    other_light: tuple[int, ...] = ()
    pictures: dict[int, np.ndarray] = field(default_factory=dict)

    def picture(self, experiment: Experiment) -> Callable[[int], np.ndarray]:
        """Frame -> its image, without decoding it again where it is kept."""
        return lambda k: self.pictures[k] if k in self.pictures else experiment.recording.picture(k)


def _decoded(experiment: Experiment, reference: np.ndarray, roi: np.ndarray, is_main: bool) -> _Decoded:
    """Decode every image, so that damaged ones are found here."""
    recording = experiment.recording
    mean, previous, previous_values = float(reference[roi].mean()), -1, np.zeros(0)
    sampled = set(sampled_frames(experiment)) if is_main and recording.quantity == "grey" else set()
    thumbnails, to_thumbnail = [], FrameSequence.maker(roi)
    equal, other_light, pictures = [], [], {}
    for k in range(recording.stack.n_frames):
        image = recording.stack.frame(k)
        values = image[roi]
        if k in sampled:
            pictures[k] = np.asarray(image)
        if k in recording.excluded:
            continue
        if previous >= 0 and np.array_equal(values, previous_values, equal_nan=values.dtype.kind == "f"):
            equal.append(k)
        thumbnails.append(to_thumbnail(image))
        previous, previous_values = k, values
        jump = abs(float(values.mean()) - mean) > _MAX_BRIGHTNESS_CHANGE * abs(mean)
        if jump and recording.quantity == "grey":
            other_light.append(k)
    sequence = FrameSequence.of_thumbnails(experiment, thumbnails)
    return _Decoded(sequence, tuple(equal), tuple(other_light), pictures)


def _other_light(experiment: Experiment, frames: Sequence[int]) -> Iterator[str]:
    if not frames:
        return
    more = f" and {len(frames) - 1} more" if len(frames) > 1 else ""
    yield (f"{experiment.recording.labels[frames[0]]}{more}: the mean grey value differs by more than "
           f"{100 * _MAX_BRIGHTNESS_CHANGE:g} % from the reference: check lighting and exposure, or exclude them"
           + "".join(f": {line.text()}" for line in excluded_frames(experiment, frames)))


def _scale_warnings(experiment: Experiment, corners: list[np.ndarray], visible: np.ndarray) -> Iterator[str]:
    every = np.vstack(corners)
    part = any(isinstance(condition.drive, Measured) for condition in experiment.model.prescribed)
    return implausible_scale(experiment, np.ptp(every, axis=0), float(visible.mean()), part)


def _points_line(recording: Recording) -> str:
    if recording.points is None:
        return ""
    at, grid = recording.points, recording.image_shape
    return f"{len(at.positions_px)} over {grid[1]} x {grid[0]} places of a grid, {at.pitch_mm:.3g} mm apart"


def _of_fields(experiment: Experiment, corners: list[np.ndarray],
               visible: np.ndarray) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Notes and warnings of measured fields; every stage is read."""
    stack = experiment.recording.stack
    assert stack is not None
    counted = [k for k in range(experiment.model.n_frames) if k not in experiment.recording.excluded]
    failed = check_stages(stack, counted)
    notes = () if not failed else (
        f"fields: {sum(failed.values())} points of {len(counted)} stages were not measured and are gaps, by the flags "
        "of the files: " + "; ".join(f"{n} {reason}" for reason, n in failed.items()),)
    return notes, tuple(_field_warnings(experiment, corners, visible))


def _field_warnings(experiment: Experiment, corners: list[np.ndarray], visible: np.ndarray) -> Iterator[str]:
    recording = experiment.recording
    points = recording.points
    assert points is not None and recording.stack is not None
    sizes = np.array([_area(cell) for cell, is_visible in zip(corners, visible, strict=True) if is_visible])
    if sizes.mean() < MIN_POINTS_PER_ELEMENT:
        yield (f"only {sizes.mean():.1f} points per element: larger elements would make the motion of the free fit "
               f"less "
               "noisy")
    counted = [k for k in range(experiment.model.n_frames) if k not in recording.excluded]
    strains = []
    for k in counted:
        moved = np.asarray(recording.stack.frame(k))
        strains.append(mean_strain(points.positions_px * [1.0, -1.0], moved[:, :2] * [1.0, -1.0]))
        part = float(np.isfinite(moved).all(axis=1).mean())
        if part < MIN_SEEN_PART:
            yield f"{recording.labels[k]}: only {100 * part:.0f} % of the points of the reference stage are measured"
    cause = increments_by_load(experiment, counted, np.array(strains)) if counted[0] == experiment.model.reference \
        else None
    if cause is not None:
        yield cause.sentence()


def _model_warnings(experiment: Experiment):
    model = experiment.model
    yield from implausible_values(model)
    yield from separate_pieces(model.mesh, model.length_unit)
    yield from implausible_thickness(model)
    yield from sums_of_all_reactions(model)
    yield from repeated_readings(experiment)
    yield from loaded_reference(experiment)
    if not model.parameters.free:
        yield "no parameter is to be identified: write identify = true for at least one"
    if all(c.kind == "displacement" for c in model.channels) and not model.loads:
        force = "the force of the log" if experiment.recording.column_units else "a recorded force"
        yield (f"to identify a stiffness or strength in MPa, compare {force} in a [[channel]] "
               "(idic init writes its lines behind #)")
