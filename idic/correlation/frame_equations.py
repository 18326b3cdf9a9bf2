"""From the simulated motion of one frame to its equations in the degrees of freedom.

Nodal throughout: displacement and sensitivities are projected into the image at the nodes, the image kernel returns
nodal sums, and no pixel-sized sensitivity is ever formed (docs/method.md, section 3).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_erosion

from idic.correlation.cameras import joined_equations, unit_weights, with_camera_sums
from idic.correlation.comparison import Reference
from idic.correlation.frame import NodalEquations
from idic.correlation.grey import grey_reference
from idic.correlation.height.cross_section import SectionReference, build_section_reference
from idic.correlation.height.gaps import blind_pixels, height_frame
from idic.correlation.height.section_map import build_section_map
from idic.correlation.height.surface import build_height_reference
from idic.correlation.pixel_map import PixelMap, build_pixel_map
from idic.correlation.system import ChannelEquations, CorrelationSystem, FrameEquations, Weights, eliminate
from idic.correlation.view import GREY, SECTION, view_of
from idic.errors import InputError
from idic.fe.fields import nodal_deformation
from idic.fe.mesh.mesh import surface_cells
from idic.images.camera import PARAMETERS as CAMERA_PARAMETERS
from idic.images.camera import Camera
from idic.images.interpolate import DEGREES
from idic.model.experiment import Experiment
from idic.parameters import ParameterSet


@dataclass(frozen=True)
class FrameResponse:
    """The simulated motion of one frame and its derivatives by the degrees of freedom that move the simulation.

    u : (n_nodes, dim) mm; channels : (n_channels,); du : (n_nodes, dim, n_moving); dchannels : (n_channels, n_moving);
    local_du : (n_nodes, dim, m) influence of the frame-local unknowns; local_dchannels : (n_channels, m).
    """

    frame: int
    u: np.ndarray
    channels: np.ndarray
    du: np.ndarray
    dchannels: np.ndarray
    local_du: np.ndarray
    local_dchannels: np.ndarray


@dataclass(frozen=True)
class CorrelationContext:
    """What all frames share at one set of parameters.

    experiment : with the mesh of these parameters (`Experiment.at_geometry`); names : every free degree of freedom;
    moving : those with columns in `FrameResponse.du`; local_precision : (m, m) prior of the frame-local unknowns
    (logged noise, or smoothness of a measured edge), whose mean is zero; others : the same for the further cameras;
    local_scatter : (m, m) the logged noise alone, None where that is all of it.
    """

    experiment: Experiment
    parameters: ParameterSet
    names: tuple[str, ...]
    moving: tuple[str, ...]
    camera: Camera
    reference: Reference
    weights: Weights
    local_precision: np.ndarray
    others: tuple[CorrelationContext, ...] = ()
    local_scatter: np.ndarray | None = None

    @property
    def cameras(self) -> tuple[CorrelationContext, ...]:
        """One context per camera, the main camera first."""
        return (self, *self.others)


def camera_at(experiment: Experiment, parameters: ParameterSet) -> Camera:
    """The camera with the camera degrees of freedom of these parameters."""
    stem = experiment.camera_name
    values = {name: parameters[f"{stem}.{name}"].value for name in CAMERA_PARAMETERS if f"{stem}.{name}" in parameters}
    camera = experiment.camera.with_parameters(values) if values else experiment.camera
    if camera.motion is None:
        return camera
    amplitudes = {name: parameters[f"{stem}.{name}"].value for name in camera.motion.names}
    return replace(camera, motion=camera.motion.with_values(amplitudes))


def with_all_cameras(context: CorrelationContext,
                     attach: Callable[[Experiment, Camera], Reference] | None = None) -> CorrelationContext:
    """The context of the main camera with those of the further ones; attach : `build_reference`, or a cache of it."""
    others = []
    for number, experiment in enumerate(context.experiment.views[1:]):
        camera = camera_at(experiment, context.parameters)
        others.append(replace(context, experiment=experiment, camera=camera, weights=context.weights.of_camera(number),
                              reference=(attach or build_reference)(experiment, camera)))
    return replace(context, others=tuple(others))


def build_reference(experiment: Experiment, camera: Camera) -> Reference:
    """The reference image attached to the pixels that the mesh covers, as this camera sees it.

    The kind of view decides which: `GreyReference` for grey images, `HeightReference` for height images of a solid,
    `SectionReference` for cross-sections.

    Raises
    ------
    InputError
        If no part of the mesh is visible.
    """
    view = view_of(experiment, camera)
    if view.kind == SECTION:
        return _section_reference(experiment, camera)
    options, stack = experiment.options, experiment.stack
    cells = surface_cells(experiment.mesh, experiment.surface)
    mask = _inside_borders(experiment.mask, stack.shape, options.border_px if view.kind == GREY else 0)
    pixel_map = build_pixel_map(experiment.mesh.nodes, cells, camera, stack.shape, mask)
    if options.edge_margin_px:
        mask = _without_edges(pixel_map, options.edge_margin_px)
        pixel_map = build_pixel_map(experiment.mesh.nodes, cells, camera, stack.shape, mask)
    image = stack.frame(experiment.reference)
    if view.kind == GREY:
        images = [stack.frame(k) for k in experiment.averaged] or image
        return grey_reference(pixel_map, images, experiment)
    degree = DEGREES[options.interpolation]
    blind = blind_pixels(height_frame(image, 0.0, degree, options.lowpass_px))
    if blind.any():
        seen = ~blind if mask is None else mask & ~blind
        pixel_map = build_pixel_map(experiment.mesh.nodes, cells, camera, stack.shape, seen)
    return build_height_reference(pixel_map, image, degree, options.lowpass_px)


def _section_reference(experiment: Experiment, camera: Camera) -> SectionReference:
    """The reference of a cross-section: its columns instead of its pixels."""
    options, stack = experiment.options, experiment.stack
    section = build_section_map(experiment.mesh, experiment.surface, camera, stack.shape, experiment.mask,
                                experiment.symmetry is not None, options.edge_margin_px)
    return build_section_reference(section, stack.frame(experiment.reference), DEGREES[options.interpolation],
                                   options.lowpass_px)


def _inside_borders(mask: np.ndarray | None, shape: tuple[int, int], border: int) -> np.ndarray | None:
    """The ROI less `border` pixels along the borders of the image  # (ny, nx) bool, None: everything"""
    if border == 0:
        return mask
    inner = np.zeros(shape, dtype=bool)
    inner[border:-border, border:-border] = True
    return inner if mask is None else mask & inner


def _without_edges(pixel_map: PixelMap, margin: int) -> np.ndarray:
    """The ROI less `margin` pixels along its edges, those of the image itself excepted  # (ny, nx) bool

    Raises
    ------
    InputError
        If next to nothing is left.
    """
    whole = np.isfinite(pixel_map.to_image(np.zeros(pixel_map.n_pixels)))
    inner = binary_erosion(whole, np.ones((3, 3), bool), iterations=margin, border_value=1)
    if inner.sum() < 0.1 * whole.sum():
        raise InputError("the mesh is too thin in the image for its edge margin", file="experiment.toml",
                         key="[options] edge_margin_px", expected="a margin well below half the width of the specimen",
                         found=f"{margin} px, which leaves {inner.sum()} of {whole.sum()} px",
                         remedy="use a smaller margin")
    return inner


def frame_system(context: CorrelationContext, response: FrameResponse, local: np.ndarray) -> CorrelationSystem:
    """M, b and the functional of one frame, its local unknowns eliminated.

    local : (m,) present values of the frame-local unknowns.
    """
    per_camera = [frame_equations(camera, response, local) for camera in context.cameras]
    pixels = [(nodal.n_valid, nodal.n_lost) for nodal, _ in per_camera]
    if len(per_camera) == 1:
        return eliminate(response.frame, context.names, per_camera[0][1], context.weights, *pixels[0])
    weights = [camera.weights for camera in context.cameras]
    joined, parts = joined_equations([equations for _, equations in per_camera], weights, pixels)
    n_pixels, n_lost = np.sum(pixels, axis=0).tolist()
    system = eliminate(response.frame, context.names, joined, unit_weights(context.weights), n_pixels, n_lost)
    return with_camera_sums(system, parts, weights)


def frame_equations(context: CorrelationContext, response: FrameResponse,
                    local: np.ndarray) -> tuple[NodalEquations, FrameEquations]:
    """The equations of one frame in one camera: at the nodes, and in all unknowns before the local ones are eliminated.

    A frame without contrast has no pixel in any sum.
    """
    experiment, camera, reference = context.experiment, context.camera, context.reference
    response = _turned(experiment, response)
    nodes = experiment.mesh.nodes
    view = view_of(experiment, camera).at(response.frame)
    motion = view.motion(nodes, response.u)
    nodal = reference.compare(experiment, response.frame, motion)
    columns = np.hstack([global_columns(context, response),
                         view.columns(nodes, response.u, response.local_du)])
    if reference.shows_nothing(nodal):
        nodal = _without_pixels(reference, nodal)
    projected = nodal.gram(columns)
    noise = reference.noise_terms(nodal, response.frame, motion, columns, projected)
    return nodal, FrameEquations(
        gram=projected.matrix, rhs=projected.rhs, rr=nodal.rr, shared=noise.shared, kappa=nodal.kappa,
        channels=channel_equations(context, response), local_precision=context.local_precision, local_gap=-local,
        noise_gram=noise.gram, basis=noise.basis, scatter=context.local_scatter)


def _turned(experiment: Experiment, response: FrameResponse) -> FrameResponse:
    """The motion in the axes that this camera sees."""
    if not experiment.axis_order:
        return response
    return replace(response, u=experiment.turned(response.u), du=experiment.turned(response.du),
                   local_du=experiment.turned(response.local_du))


def _without_pixels(reference: Reference, nodal: NodalEquations) -> NodalEquations:
    """The equations of a frame that shows nothing: no pixel in any sum."""
    n_pixels = nodal.n_valid + nodal.n_lost
    return replace(nodal, q=0.0 * nodal.q, H=0.0 * nodal.H, hb=0.0 * nodal.hb, bb=0.0 * nodal.bb, rb=0.0 * nodal.rb,
                   rr=0.0, n_valid=0, n_lost=n_pixels, lost=reference.pixel_map.pixels_per_element.astype(np.int64),
                   lost_pixels=np.arange(n_pixels), element_rr=0.0 * nodal.element_rr)


def global_columns(context: CorrelationContext, response: FrameResponse,
                   gradient: np.ndarray | None = None) -> np.ndarray:
    """Image columns of all free degrees of freedom  # (n_components n_nodes, n)

    gradient : `nodal_gradient` of the motion, where it is known already
    """
    nodes = context.experiment.mesh.nodes
    view = view_of(context.experiment, context.camera).at(response.frame)
    moved = view.columns(nodes, response.u, at_fixed_pixels(context.experiment, response.u, response.du,
                                                            context.moving))
    columns = np.zeros((view.n_components * len(nodes), len(context.names)))
    stem = f"{context.experiment.camera_name}."
    for i, name in enumerate(context.names):
        if name in context.moving:
            columns[:, i] = moved[:, context.moving.index(name)]
        elif name.startswith(stem):
            if gradient is None:
                gradient = nodal_gradient(context.experiment, response.u)
            columns[:, i] = view.camera_column(nodes, response.u, gradient, name.removeprefix(stem))
    return columns


def at_fixed_pixels(experiment: Experiment, u: np.ndarray, du: np.ndarray, moving: Sequence[str]) -> np.ndarray:
    """Sensitivities at fixed points of the undeformed body instead of at nodes that move  # (n_nodes, dim, n_moving)

    Where a degree of freedom moves the nodes by V = dX/dlam: phi = dU/dlam - (grad u) V (docs/method.md, equation 5.5).
    """
    velocity = {morph.name: morph.velocity for morph in experiment.morphs}
    if velocity.keys().isdisjoint(moving):
        return du
    du, gradient = du.copy(), nodal_gradient(experiment, u)
    for i, name in enumerate(moving):
        if name in velocity:
            v = experiment.turned(velocity[name])
            du[:, :, i] -= np.einsum("nij,nj->ni", gradient, v) - v
    return du


def nodal_gradient(experiment: Experiment, u: np.ndarray) -> np.ndarray:
    """Deformation gradient at the nodes  # (n_nodes, dim, dim)"""
    gradient = nodal_deformation(experiment.mesh, u)
    return np.where(np.isnan(gradient), np.eye(gradient.shape[1]), gradient)  # nodes of no element do not matter


def channel_values(experiment: Experiment, parameters: ParameterSet, simulated: np.ndarray, frame: int) -> np.ndarray:
    """What the channels would show for these simulated forces: scale, offset and drift included  # (n_channels,)"""
    values = np.array(simulated, float)
    for c, channel in enumerate(experiment.channels):
        stem = f"channel.{channel.column}"
        values[c] *= _value(parameters, f"{stem}.scale", 1.0)
        values[c] += _value(parameters, f"{stem}.offset", 0.0)
        values[c] += _value(parameters, f"{stem}.drift", 0.0) * _elapsed(experiment, frame)
    return values


def channel_equations(context: CorrelationContext, response: FrameResponse) -> ChannelEquations:
    """Residual of every channel and its derivative: scale, offset, drift and the time offset included."""
    experiment, parameters = context.experiment, context.parameters
    n_channels, n = len(experiment.channels), len(context.names)
    shown = channel_values(experiment, parameters, response.channels, response.frame)
    residual, d_global = np.zeros(n_channels), np.zeros((n_channels, n))
    scales = np.ones(n_channels)
    shift = _value(parameters, "time.offset", 0.0)
    for c, channel in enumerate(experiment.channels):
        stem = f"channel.{channel.column}"
        scales[c] = _value(parameters, f"{stem}.scale", 1.0)
        rate = 0.0 if channel.rates is None else channel.rates[response.frame]
        residual[c] = channel.values[response.frame] + shift * rate - shown[c]
        own = {f"{stem}.scale": response.channels[c], f"{stem}.offset": 1.0,
               f"{stem}.drift": _elapsed(experiment, response.frame), "time.offset": -rate}
        for i, name in enumerate(context.names):
            d_global[c, i] = own.get(name, 0.0)
            if name in context.moving:
                d_global[c, i] += scales[c] * response.dchannels[c, context.moving.index(name)]
    return ChannelEquations(residual, d_global, scales[:, None] * response.local_dchannels)


def _value(parameters: ParameterSet, name: str, default: float) -> float:
    return parameters[name].value if name in parameters else default


def _elapsed(experiment: Experiment, frame: int) -> float:
    return float(experiment.times[frame] - experiment.times[experiment.reference])


def correlated_frames(experiment: Experiment, frames: Sequence[int]) -> list[int]:
    """Frames that enter the sums: later than the reference and not excluded."""
    return [int(k) for k in frames if k > experiment.reference and k not in experiment.excluded]
