"""Status of a measured frame: recognised as a whole, matched element by element, compared with the other frames."""

from __future__ import annotations

import numpy as np

from idic.correlation import N_NODES, ReferenceImage
from idic.measure.dic.frame import DicFrame

MAX_RMS_RATIO = 2.0  # residual to the median of the frames; with more, brightness constancy fails
MAX_MISMATCHED_PART = 0.05  # of the elements; with more, the frame is unexplained
MIN_COMPARED = 3  # frames whose median is typical
MAX_REST_PX = 0.3  # motion of a frame at rest; above, interpolation, light and focus differ from those of the reference
MAX_LIKE = 0.3  # unlikeness of a frame that matches, whatever the residual of others: a correlation of 0.96
MAX_UNLIKENESS = 0.9  # of a recognised frame; a correlation of 0.74
MIN_VISIBLE_PART = 0.3  # of the pixels; with less, the frame is lost
_MAX_RESIDUAL_RATIO = 9.0  # squared residual of an element to the median of the elements
_MAX_CONTRAST_RATIO = 1.0  # and to the variance of f in it: a correlation of a half; unrelated patterns give 2


def unlikeness(reference: ReferenceImage, n_pixels: int, rr: float, brightness: np.ndarray) -> float:
    """Residual / contrast that the reference leaves in the frame: 0 for a copy, inf for unrelated or unseen images.

    rr : GV^2, sum over the `n_pixels` valid pixels after brightness; brightness : (nb,) gain and offset per patch.
    """
    gain = 1.0 + (brightness[::2].mean() if len(brightness) else 0.0)
    if n_pixels < MIN_VISIBLE_PART * reference.pixel_map.n_pixels or not gain > 0 or not np.isfinite(rr):
        return float("inf")
    return float(np.sqrt(max(rr, 0.0) / n_pixels) / (gain * reference.contrast))


def unlikeness_of(reference: ReferenceImage, frame: DicFrame) -> float:
    """`unlikeness` of a measured frame; inf where the iteration ran away."""
    if not np.isfinite(frame.last_step_px):
        return float("inf")
    return unlikeness(reference, frame.n_pixels, frame.rr_gv2, frame.brightness)


def is_recognised(reference: ReferenceImage, frame: DicFrame) -> bool:
    """Whether the frame shows the surface of the reference image at all."""
    return unlikeness_of(reference, frame) < MAX_UNLIKENESS


def mismatched_elements(reference: ReferenceImage, frame: DicFrame) -> np.ndarray:
    """Elements that do not match the frame: wrong minimum, crack, lost paint  # (n_elements,) bool"""
    count = reference.pixel_map.pixels_per_element
    number, first, second = reference.blocks.grey.T
    residual = frame.element_rr / count
    variance = second / number - (first / number) ** 2
    return (residual > _MAX_RESIDUAL_RATIO * np.median(residual)) & (residual > _MAX_CONTRAST_RATIO * variance)


def pixels_of(reference: ReferenceImage, elements: np.ndarray) -> np.ndarray:
    """Numbers of the pixels of these elements  # (n_elements,) bool -> (n,) int"""
    return np.flatnonzero(np.repeat(elements, reference.pixel_map.pixels_per_element))


def nodes_of(reference: ReferenceImage, elements: np.ndarray) -> np.ndarray:
    """Nodes of these elements  # (n_elements,) bool -> (n_nodes,) bool"""
    pixel_map = reference.pixel_map
    touched = np.zeros(pixel_map.n_nodes, dtype=bool)
    conn, n_nodes = pixel_map.conn[elements], N_NODES[pixel_map.kind[elements]]
    touched[conn[np.arange(conn.shape[1]) < n_nodes[:, None]]] = True
    return touched


def with_neighbours(reference: ReferenceImage, elements: np.ndarray) -> np.ndarray:
    """These elements and those that share a node with them  # (n_elements,) bool -> (n_elements,) bool"""
    pixel_map = reference.pixel_map
    touched = nodes_of(reference, elements)[pixel_map.conn]  # (n_elements, 8)
    return (touched & (np.arange(touched.shape[1]) < N_NODES[pixel_map.kind][:, None])).any(axis=1)


def unexplained(rms_gv: np.ndarray, mismatched_part: np.ndarray, motion_px: np.ndarray,
                unlike: np.ndarray) -> np.ndarray:
    """Frames that do not match the reference: a large mismatched region, or a residual far above that of the others.

    A frame at rest shows the same pixels under the same light: its residual says nothing of what a moved frame may
    leave. So a moved frame is compared with moved ones; where these are few, its likeness to the reference decides.

    rms_gv : (n_frames,) GV, nan where not compared; mismatched_part : (n_frames,); motion_px : (n_frames,) rms over the
    nodes; unlike : (n_frames,) `unlikeness`. Returns (n_frames,) bool.
    """
    compared = np.isfinite(rms_gv)
    is_unexplained = compared & (mismatched_part > MAX_MISMATCHED_PART)
    if compared.sum() < MIN_COMPARED:
        return is_unexplained
    moved = compared & (motion_px > MAX_REST_PX)
    for group in (moved, compared & ~moved):
        is_large = group.sum() >= MIN_COMPARED
        raised = group & (rms_gv > MAX_RMS_RATIO * np.median(rms_gv[group if is_large else compared]))
        is_unexplained |= raised if is_large else raised & (unlike > MAX_LIKE)
    return is_unexplained
