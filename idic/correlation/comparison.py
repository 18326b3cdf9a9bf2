"""One frame against the reference, whatever the images show: each kind of view has its own image pass.

`idic.correlation.view` says what kind it is, `idic.correlation.frame_equations.build_reference` makes the reference record, and
that record chooses the pass here. A pass returns a `FrameShare` whose degrees of freedom are ``n_components * node +
component``: q (n_components n_nodes,), H of that size squared, brightness blocks hb, bb, rb (empty without).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.correlation.blur import with_blur
from idic.correlation.cells import N_NODES
from idic.correlation.frame import FrameShare, ResidualMap, frame_share, residual_map
from idic.correlation.height.cross_section import (
    SectionReference,
    section_pixels,
    section_pull_back,
    section_share,
    shared_section_columns,
)
from idic.correlation.height.gaps import height_frame
from idic.correlation.height.section_pass import from_blocks
from idic.correlation.height.surface import HeightReference, convected, height_residual_map, height_share
from idic.correlation.measured import MeasuredReference, MeasuredShare, measured_share
from idic.correlation.pixel_map import PixelMap, element_coefficients
from idic.correlation.reference import ReferenceImage
from idic.images.interpolate import Spline, prefilter
from idic.model.experiment import Experiment

DEGREE = {"cubic": 3, "quintic": 5}
Reference = ReferenceImage | HeightReference | SectionReference | MeasuredReference


def frame_spline(experiment: Experiment, frame: int) -> Spline:
    """The spline of one grey frame, with the experiment's low-pass and interpolation."""
    options = experiment.options
    return prefilter(experiment.stack.frame(frame), DEGREE[options.interpolation], options.lowpass_px)


def image_of(reference: Reference) -> Reference:
    """The reference image, also where simulations are compared with a motion that was measured against it."""
    return reference.image if isinstance(reference, MeasuredReference) else reference


def compare(experiment: Experiment, reference: Reference, frame: int,
            u_image: np.ndarray) -> FrameShare | MeasuredShare:
    """One frame against the reference under a nodal motion as `View.motion` gives it."""
    brightness = experiment.options.brightness
    if isinstance(reference, MeasuredReference):
        if frame == experiment.reference:
            return compare(experiment, reference.image, frame, u_image)
        return measured_share(reference, frame, u_image, lambda v: compare(experiment, reference.image, frame, v))
    if isinstance(reference, SectionReference):
        return section_share(reference, experiment.stack.frame(frame), u_image, brightness)
    if isinstance(reference, HeightReference):
        return height_share(reference, _heights(experiment, reference, frame), u_image, brightness)
    spline = frame_spline(experiment, frame)
    share = frame_share(reference, spline, u_image, brightness)
    if experiment.options.defocus == "none":
        return share
    back = _at_nodes(reference.pixel_map, np.linalg.inv(reference.pixel_map.deformation_gradient(u_image)))
    return with_blur(reference, share, spline, u_image, brightness, back, experiment.noise.std_gv)


def compare_pixels(experiment: Experiment, reference: Reference, frame: int, u_image: np.ndarray,
                   coefficients: np.ndarray) -> ResidualMap:
    """The same pixel by pixel, in the order of ``reference.pixel_map``, brightness `coefficients` (nb,) removed."""
    brightness = experiment.options.brightness
    if isinstance(reference, MeasuredReference):
        return compare_pixels(experiment, reference.image, frame, u_image, coefficients)
    if isinstance(reference, SectionReference):
        return section_pixels(reference, experiment.stack.frame(frame), u_image, brightness, coefficients)
    if isinstance(reference, HeightReference):
        frame_heights = _heights(experiment, reference, frame)
        return height_residual_map(reference, frame_heights, u_image, brightness, coefficients)
    blurred = experiment.options.defocus != "none" and len(coefficients) > 0
    own = coefficients[:-1] if blurred else coefficients
    found = residual_map(reference, frame_spline(experiment, frame), u_image, brightness, own)
    if not blurred:
        return found
    return replace(found, r=found.r - np.where(found.valid, np.float32(coefficients[-1]) * reference.blur_column, 0))


def _heights(experiment, reference, frame):
    return height_frame(experiment.stack.frame(frame), reference.level, reference.degree, reference.lowpass_px)


def shared_columns(reference: Reference, u_image: np.ndarray, columns: np.ndarray, nb: int) -> np.ndarray:
    """The columns in the reference frame's nodal and brightness basis  # (c n_nodes + nb, m + nb)

    (F^-T grad f) . phi = grad f . (F^-1 phi), and for heights d . G phi (`idic.correlation.height.surface_blocks`), with F^-1
    or G averaged over the elements around each node.

    nb : number of brightness columns, the same in every frame.
    """
    if isinstance(reference, SectionReference):
        return shared_section_columns(reference, u_image, columns, nb)
    mean, size = pull_back(reference, u_image), u_image.shape[1]
    fields = np.einsum("nij,njm->nim", mean, columns.reshape(len(mean), size, -1)).reshape(len(columns), -1)
    whole = np.zeros((len(columns) + nb, columns.shape[1] + nb))
    whole[:len(columns), :columns.shape[1]] = fields
    whole[len(columns):, columns.shape[1]:] = np.eye(nb)
    return whole


def leaving(reference: Reference, r: np.ndarray) -> tuple[np.ndarray, Reference]:
    """An image that leaves the residual r (n_pixels,) without any motion, and the reference to `compare` it with.

    Nothing is blurred on that way: the low-pass is in r already.
    """
    if isinstance(reference, ReferenceImage):
        return np.nan_to_num(reference.pixel_map.to_image(reference.f - r)).astype(np.float32), reference
    pm, f = reference.pixel_map, reference.f
    if isinstance(reference, SectionReference):
        f = from_blocks(f, pm.shape[0])[pm.valid]
    shown = pm.to_image(f - r)
    return np.where(np.isnan(shown), 0.0, shown) + reference.level, replace(reference, lowpass_px=0.0)


def visible_share(reference: ReferenceImage | HeightReference, share: FrameShare) -> np.ndarray:
    """How much of the pixels around a node the frame shows, 0 … 1  # (n_nodes,)"""
    pm = reference.pixel_map
    shown = 1.0 - share.lost / np.maximum(pm.pixels_per_element, 1)
    return _at_nodes(pm, shown[:, None, None])[:, 0, 0]


def against_basis(reference: ReferenceImage | HeightReference, u_image: np.ndarray, nodal: np.ndarray) -> np.ndarray:
    """Sums of (N^T grad f) times something, from the same sums with the convected gradient.

    The convected gradient is undone by the mean at the nodes that `shared_columns` uses.

    nodal : (c n_nodes, ...)
    """
    undone = np.linalg.inv(pull_back(reference, u_image))  # (n_nodes, c, c)
    return np.einsum("nji,njk->nik", undone, nodal.reshape(*undone.shape[:2], -1)).reshape(nodal.shape)


def pull_back(reference: Reference, u_image: np.ndarray) -> np.ndarray:
    """F^-1, or G for heights, at the nodes: takes a frame's nodal field to the reference  # (n_nodes, c, c)"""
    if isinstance(reference, SectionReference):
        return section_pull_back(reference, u_image)
    pm = reference.pixel_map
    if isinstance(reference, HeightReference):
        return _at_nodes(pm, convected(reference, element_coefficients(pm, u_image))[0])  # of (n_elements, 3, 3)
    return _at_nodes(pm, np.linalg.inv(pm.deformation_gradient(u_image)))  # of (n_elements, 2, 2)


def _at_nodes(pixel_map: PixelMap, matrices: np.ndarray) -> np.ndarray:
    """Mean over the elements around each node, the identity where there is none  # (nel, c, c) -> (n_nodes, c, c)"""
    used = np.arange(pixel_map.conn.shape[1]) < N_NODES[pixel_map.kind][:, None]
    nodes, owner = pixel_map.conn[used], np.nonzero(used)[0]
    size = matrices.shape[1]
    total = np.zeros((pixel_map.n_nodes, size, size))
    np.add.at(total, nodes, matrices[owner])
    count = np.bincount(nodes, minlength=pixel_map.n_nodes)
    return np.where(count[:, None, None] > 0, total / np.maximum(count, 1)[:, None, None], np.eye(size))
