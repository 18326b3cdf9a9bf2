"""Whether a frame was understood: recognised at all, element by element, and compared with the other frames."""

from __future__ import annotations

import numpy as np

from idic.correlation.pixels.cells import N_NODES
from idic.correlation.reference import ReferenceImage
from idic.dic.frame import DicFrame

UNEXPLAINED_RATIO = 2.0  # residual against the median of the frames: brightness constancy fails
MISMATCHED_PART = 0.05  # of the elements: more of them and the frame is unexplained
LOST_RATIO = 0.9  # unlikeness of a frame in which nothing was found; this is a correlation of 0.74
LEAST_VISIBLE = 0.3  # part of the pixels below which a frame is lost
_MISMATCH = 9.0  # squared residual against the median over the elements: 3 times the usual residual
_OWN_CONTRAST = 1.0  # and against the variance of f in the element: a correlation below a half; nothing in common: 2


def unlikeness(reference: ReferenceImage, n_pixels: int, rr: float, brightness: np.ndarray) -> float:
    """Residual / contrast that the reference leaves in the frame: 0 for a copy, inf for unrelated or unseen images.

    rr : GV^2, sum over the `n_pixels` valid pixels after brightness; brightness : (nb,) gain and offset per patch.
    """
    gain = 1.0 + (brightness[::2].mean() if len(brightness) else 0.0)
    if n_pixels < LEAST_VISIBLE * reference.pixel_map.n_pixels or not gain > 0 or not np.isfinite(rr):
        return float("inf")
    return float(np.sqrt(max(rr, 0.0) / n_pixels) / (gain * reference.contrast))


def unlikeness_of(reference: ReferenceImage, frame: DicFrame) -> float:
    """`unlikeness` of a measured frame; inf where the iteration ran away."""
    if not np.isfinite(frame.last_step_px):
        return float("inf")
    return unlikeness(reference, frame.n_pixels, frame.rr_gv2, frame.brightness)


def is_recognised(reference: ReferenceImage, frame: DicFrame) -> bool:
    """Whether the frame shows the surface of the reference image at all."""
    return unlikeness_of(reference, frame) < LOST_RATIO


def mismatched_elements(reference: ReferenceImage, frame: DicFrame) -> np.ndarray:
    """Elements where something else seems to lie: wrong minimum, crack, paint gone  # (n_elements,) bool"""
    count = reference.pixel_map.pixels_per_element
    number, first, second = reference.blocks.grey.T
    left = frame.element_rr / count
    variance = second / number - (first / number) ** 2
    return (left > _MISMATCH * np.median(left)) & (left > _OWN_CONTRAST * variance)


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


def unexplained(rms_gv: np.ndarray, mismatched_part: np.ndarray) -> np.ndarray:
    """Frames whose residual is far above that of the others, or with a large mismatched region.

    rms_gv : (n_frames,) GV, nan where not compared; mismatched_part : (n_frames,). Returns (n_frames,) bool.
    """
    known = np.isfinite(rms_gv)
    far = known & (mismatched_part > MISMATCHED_PART)
    if known.sum() >= 3:
        far |= known & (rms_gv > UNEXPLAINED_RATIO * np.median(rms_gv[known]))
    return far
