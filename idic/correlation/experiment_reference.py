"""The reference image of an experiment: its kind, the region of interest, and the camera that sees it."""

from __future__ import annotations

from dataclasses import replace
from hashlib import blake2b
from itertools import pairwise

import numpy as np
import scipy

from idic.correlation.image_equations.comparison import Reference
from idic.correlation.field.reference import FieldReference
from idic.correlation.image_equations.grey import grey_reference
from idic.correlation.height.cross_section import SectionReference, build_section_reference
from idic.correlation.height.gaps import pixels_at_gaps, height_frame
from idic.correlation.pixels.section_map import build_section_map
from idic.correlation.height.surface import build_height_reference
from idic.correlation.pinhole.ray_map import build_ray_map
from idic.correlation.pixels.pixel_map import PixelMap
from idic.correlation.views.kinds import ViewKind
from idic.correlation.views.view import view_of
from idic.correlation.volume.reference import VolumeReference, volume_reference
from idic.correlation.volume.voxel_map import build_voxel_map
from idic.errors import InputError
from idic.images import AnyCamera, CAMERA_PARAMETERS, Camera, DEGREES, PLACEMENT_STEM, PlacedCamera, Scanner
from idic.model import Experiment, Model, is_camera_time
from idic.parameters import ParameterSet

MIN_CRACK_MARGIN_PX = 3  # beside the path of a crack: the taps of a spline beyond reach over the gap
MAX_TRACED = 3  # pixel maps of lenses that a process keeps, 16 bytes per pixel each
_traced: dict[tuple, tuple[PixelMap, np.ndarray | None]] = {}


def camera_at(experiment: Experiment, parameters: ParameterSet) -> AnyCamera:
    """The camera with the camera degrees of freedom of these parameters."""
    model = experiment.model
    stem = experiment.recording.camera_name
    if isinstance(model.camera, PlacedCamera):
        lens = {name.removeprefix(f"{stem}."): at.value for name, at in parameters.items()
                if name.startswith(f"{stem}.") and not is_camera_time(name)}
        common = {name: at.value for name, at in parameters.items() if name.startswith(f"{PLACEMENT_STEM}.")}
        return model.camera.with_parameters(lens | common)
    values = {name: parameters[f"{stem}.{name}"].value for name in CAMERA_PARAMETERS if f"{stem}.{name}" in parameters}
    camera = model.camera.with_parameters(values) if values else model.camera
    if camera.motion is None:
        return camera
    amplitudes = {name: parameters[f"{stem}.{name}"].value for name in camera.motion.names}
    return replace(camera, motion=camera.motion.with_values(amplitudes))


def build_experiment_reference(experiment: Experiment, camera: AnyCamera) -> Reference:
    """The reference image of this camera, attached to the pixels that the mesh covers.

    The kind of view decides which: `GreyReference` for grey images, `HeightReference` for height images of a solid,
    `SectionReference` for cross-sections, `FieldReference` for measured fields.

    Raises
    ------
    InputError
        If no part of the mesh is visible.
    """
    recording = experiment.recording
    if recording.points is not None:
        return FieldReference.of(experiment, camera)
    if isinstance(camera, Scanner):
        return _volume_reference(experiment, camera)  # type: ignore[return-value]
    view = view_of(experiment, camera)
    if view.kind == ViewKind.SECTION:
        return _section_reference(experiment, camera)
    options, stack = experiment.options, recording.stack
    mask = _inside_borders(recording.mask, stack.shape, options.border_px if view.kind == ViewKind.GREY else 0)
    pixel_map, mask = _kept_pixels(experiment, camera, mask)
    if experiment.model.cracks:
        mask = _beside_cracks(experiment.model, camera, mask, stack.shape,
                              max(options.edge_margin_px, MIN_CRACK_MARGIN_PX))
        pixel_map = mapped_pixels(experiment, camera, mask)
    if options.left_out_px:
        mask = _outside_circles(mask, stack.shape, options.left_out_px)
        pixel_map = mapped_pixels(experiment, camera, mask)
    image = stack.frame(experiment.model.reference)
    if view.kind == ViewKind.GREY:
        images = [stack.frame(k) for k in recording.averaged] or image
        return grey_reference(pixel_map, images, experiment)
    degree = DEGREES[options.interpolation]
    gaps = pixels_at_gaps(height_frame(image, 0.0, degree, options.lowpass_px))
    if gaps.any():
        roi = ~gaps if mask is None else mask & ~gaps
        pixel_map = mapped_pixels(experiment, camera, roi)
    return build_height_reference(pixel_map, image, degree, options.lowpass_px)


def _volume_reference(experiment: Experiment, scanner: Scanner) -> VolumeReference:
    """The reference of volumes: the voxels in the solid."""
    model, options = experiment.model, experiment.options
    voxel_map = build_voxel_map(scanner.project(model.mesh.nodes), model.mesh.blocks,
                                experiment.recording.volumes.shape, options.edge_margin_px, options.border_px,
                                experiment.voxel_mask)
    return volume_reference(voxel_map, experiment)


def _kept_pixels(experiment: Experiment, camera: AnyCamera,
                 mask: np.ndarray | None) -> tuple[PixelMap, np.ndarray | None]:
    """The pixels of the surface less those along its edges, and their mask; of a lens kept for the next reference.

    Rays are traced for some microseconds per pixel: the noise, the start, the identification and its judgement each
    attach the same reference image.
    """
    model = experiment.model
    def found() -> tuple[PixelMap, np.ndarray | None]:
        pixel_map, margin = mapped_pixels(experiment, camera, mask), experiment.options.edge_margin_px
        if not margin:
            return pixel_map, mask
        inner = _without_edges(pixel_map, margin)
        return mapped_pixels(experiment, camera, inner), inner

    if not isinstance(camera, PlacedCamera):
        return found()
    mesh, lens = model.mesh, camera.effective
    faces = [] if model.surface is None else mesh.edge_sets[model.surface]
    digest = blake2b()
    for part in (mesh.nodes, *(block.connectivity for block in mesh.blocks), faces, lens.intrinsic, lens.rotation,
                 lens.translation_mm, () if mask is None else mask):
        digest.update(np.ascontiguousarray(part))
        digest.update(str(np.shape(part)).encode())
    key = digest.digest(), experiment.recording.stack.shape, mask is None, experiment.options.edge_margin_px
    entry = _traced.get(key)
    if entry is None:
        entry = _traced[key] = found()
        for oldest in list(_traced)[:-MAX_TRACED]:
            _traced.pop(oldest, None)
    return entry


def mapped_pixels(experiment: Experiment, camera: AnyCamera, mask: np.ndarray | None) -> PixelMap:
    """The pixels of the seen surface within a mask (ny, nx), bool, None: everywhere."""
    model = experiment.model
    mesh, shape = model.mesh, experiment.recording.stack.shape
    cells = mesh.surface_cells(model.surface)
    if isinstance(camera, PlacedCamera):
        return build_ray_map(mesh, cells, camera, shape, mask, model.surface)
    return PixelMap.of(mesh.nodes, cells, camera, shape, mask)


def _section_reference(experiment: Experiment, camera: Camera) -> SectionReference:
    """The reference of a cross-section: its columns instead of its pixels."""
    model = experiment.model
    options, stack = experiment.options, experiment.recording.stack
    section = build_section_map(model.mesh, model.surface, camera, stack.shape, experiment.recording.mask,
                                model.symmetry is not None, options.edge_margin_px)
    return build_section_reference(section, stack.frame(model.reference), DEGREES[options.interpolation],
                                   options.lowpass_px)


def _inside_borders(mask: np.ndarray | None, shape: tuple[int, int], border: int) -> np.ndarray | None:
    """The ROI less `border` pixels along the borders of the image  # (ny, nx) bool, None: everything"""
    if border == 0:
        return mask
    inner = np.zeros(shape, dtype=bool)
    inner[border:-border, border:-border] = True
    return inner if mask is None else mask & inner


def _outside_circles(mask: np.ndarray | None, shape: tuple[int, int],
                     circles: tuple[tuple[float, float, float], ...]) -> np.ndarray:
    """The ROI less circles (column, row, radius), of which some may lie beyond the image  # (ny, nx) bool"""
    roi = np.ones(shape, dtype=bool) if mask is None else mask.copy()
    for column, row, radius in circles:
        first = np.clip(np.floor([row - radius, column - radius]).astype(int), 0, shape)
        end = np.clip(np.ceil([row + radius + 1, column + radius + 1]).astype(int), first, shape)
        y, x = np.mgrid[first[0]:end[0], first[1]:end[1]]
        roi[y, x] &= np.hypot(x - column, y - row) > radius
    return roi


def _beside_cracks(model: Model, camera: AnyCamera, mask: np.ndarray | None, shape: tuple[int, int],
                   margin: float) -> np.ndarray:
    """The ROI less a margin on both sides of the paths of cracks: pixels there see into the gap  # (ny, nx) bool"""
    roi = np.ones(shape, dtype=bool) if mask is None else mask.copy()
    y, x = np.mgrid[:shape[0], :shape[1]]
    pixels = np.stack([x, y], axis=-1).astype(float)
    for crack in model.cracks:
        corners = camera.project(crack.cut.path)
        for start, end in pairwise(corners):
            way = end - start
            part = np.clip((pixels - start) @ way / (way @ way), 0.0, 1.0)
            roi &= np.linalg.norm(pixels - start - part[..., None] * way, axis=-1) > margin
    return roi


def _without_edges(pixel_map: PixelMap, margin: int) -> np.ndarray:
    """The ROI less `margin` pixels along its edges, those of the image itself excepted  # (ny, nx) bool

    Raises
    ------
    InputError
        If next to nothing is left.
    """
    roi = np.isfinite(pixel_map.to_image(np.zeros(pixel_map.n_pixels)))
    inner = scipy.ndimage.binary_erosion(roi, np.ones((3, 3), bool), iterations=margin, border_value=1)
    if inner.sum() < 0.1 * roi.sum():
        raise InputError("the mesh is too thin in the image for its edge margin", file="experiment.toml",
                         key="[options] edge_margin_px", expected="a margin well below half the width of the specimen",
                         found=f"{margin} px, which leaves {inner.sum()} of {roi.sum()} px",
                         remedy="use a smaller margin")
    return inner
