"""Effects that act on grey values and not on motion: light that changes from place to place, focus that is lost.

Their columns are images of fixed shape E_k(x) times a course in time: a hat of light times the grey values (gain), a
hat alone (offset), and minus half the Laplacian of the reference image, which a blur of variance w (px²) adds w times.
They join the evidence beside the motions: products with motions are sums of N^T grad f E_k at the nodes.

A sum of noise against E_k is as large as the low-pass of the images leaves it; w_k brings that to the noise that sums
against the gradient see. The Laplacian contains the noise of the reference image, and so does every residual: their
expected product is taken off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from idic.correlation import CorrelationContext, GreyReference, blur_bias
from idic.images import ArrayStack, lowpass, sum_gain

GAIN, OFFSET, BLUR = "gain", "offset", "blur"
LIGHT = "light"  # a factor of the grey values: gain about their mean, and the mean times as much offset
HAT_CELLS = 3  # hats along the longer side of the visible region, less one


@dataclass(frozen=True, eq=False)
class PixelPart:
    """What one white frame knows of the pixel columns, weighed by 1/sigma^2.

    coupling : (n_seen, k) with motions; gram : (k, k); q : (k,) with the residual; border : (k, m) with the frame's own
    unknowns; among : (k, m) the same in products of these columns with each other, whose weights are square roots.
    """

    coupling: np.ndarray
    gram: np.ndarray
    q: np.ndarray
    border: np.ndarray
    among: np.ndarray


@dataclass(frozen=True, eq=False)
class PixelBasis:
    """names : ("gain", 0), …, kind and number of the hat; images : (n_pixels, k); weight, bias : (k,) see the
    module."""

    names: tuple[tuple[str, int], ...]
    images: np.ndarray
    weight: np.ndarray
    bias: np.ndarray


def grey_image(context: CorrelationContext) -> GreyReference:
    """The reference image of a camera whose grey values are compared.

    Raises
    ------
    TypeError
        If heights or measured fields are: what reads grey values asks before.
    """
    if not isinstance(context.reference, GreyReference):
        raise TypeError(f"{context.experiment.recording.camera_name} has no reference image of grey values")
    return context.reference


def pixel_basis(context: CorrelationContext) -> PixelBasis:
    """Hats of gain and offset, and the blur, of the pixels that the mesh covers."""
    reference = grey_image(context)
    std, f = context.experiment.options.lowpass_px, reference.f.astype(float)
    hats = _hats(reference.pixel_map.points())
    pm = reference.pixel_map
    columns = [-(f - f.mean())[:, None] * hats, -hats, reference.blur_column.astype(float)[:, None]]
    n = hats.shape[1]
    names = (*((GAIN, i) for i in range(n)), *((OFFSET, i) for i in range(n)), (BLUR, 0))
    images = np.hstack(columns)
    noise, correlated = context.experiment.recording.noise.std_gv**2, context.experiment.recording.noise.correlated
    correlation = None if correlated is None else np.array(correlated.correlation)
    recorded = noise if correlated is None else correlated.recorded_gv**2
    share = np.array([_noise_left(pm, column, std, correlation) for column in images.T])
    kinds, power = np.array([kind for kind, _ in names]), (images**2).sum(axis=0)
    for kind in (GAIN, OFFSET, BLUR):  # alike in all places: the sum of a kind's hats is an unknown of every frame
        share[kinds == kind] = np.average(share[kinds == kind], weights=power[kinds == kind])
    weight = context.weights.image_noise**2 / (recorded * share)
    bias = np.zeros(len(names))
    bias[-1] = blur_bias(context.experiment.recording.noise, reference) * len(f)
    return PixelBasis(names, images, weight, bias)


def pixel_parts(context: CorrelationContext, basis: PixelBasis, maps: Sequence[tuple[np.ndarray, np.ndarray]],
                kappa: np.ndarray, shared: np.ndarray, c: float, back: np.ndarray, dofs: np.ndarray,
                local_columns: Sequence[np.ndarray]) -> list[PixelPart]:
    """The pixel columns' products in every frame.

    Parameters
    ----------
    maps : per frame the residual and the validity of every pixel; shared : (n_pixels,) R; c : `noise_share`; back : (T,
    n_nodes, 2, 2);
    local_columns : per frame (2 n_nodes, m)
    """
    n_nodes, inverse = len(context.experiment.model.mesh.nodes), 1.0 / context.weights.image_noise**2
    sums = [sums_against(context, image) for image in basis.images.T]
    still = np.array([q for q, _ in sums]).T  # (2 n_nodes, k)
    bright = np.array([rb for _, rb in sums]).reshape(len(sums), -1)  # (k, nb)
    root_weight = np.sqrt(basis.weight)
    gram = basis.images.T @ basis.images * inverse * np.outer(root_weight, root_weight)
    reference_share = 1.0 - c * float(np.sum(1.0 / kappa))  # share of the reference's noise in a white frame
    parts = []
    for t in range(len(maps)):
        r, valid = maps[t]
        pushed = np.einsum("nij,nik->njk", back[t], still.reshape(n_nodes, 2, -1)).reshape(2 * n_nodes, -1)
        white = np.where(valid, r.astype(float) - c * shared, 0.0) / np.sqrt(kappa[t])
        q = (basis.images.T @ white - basis.bias * reference_share / np.sqrt(kappa[t])) * inverse * basis.weight
        frame_columns = local_columns[t]
        border = np.hstack([pushed.T @ frame_columns, bright]) * inverse
        parts.append(PixelPart(pushed[dofs] * inverse * basis.weight, gram, q, border * basis.weight[:, None],
                               border * root_weight[:, None]))
    return parts


def joined_pixels(bases: Sequence[PixelBasis], parts: Sequence[Sequence[PixelPart]],
                  n_local: int) -> tuple[tuple[tuple[str, int], ...], list[PixelPart]]:
    """The pixel columns of several cameras as one set; hats are numbered on from camera to camera.

    parts : per camera and frame; n_local : frame-local unknowns of the simulation, which the cameras have in common
    """
    if len(bases) == 1:
        return bases[0].names, list(parts[0])
    names, joined = [], []
    for basis in bases:
        first = 1 + max((number for _, number in names), default=-1)
        names += [(kind, first + number) for kind, number in basis.names]
    for of_cameras in zip(*parts, strict=True):
        border, among = (np.hstack([np.vstack([block[:, :n_local] for block in owns]),
                                    block_diag(*(block[:, n_local:] for block in owns))])
                         for owns in ([part.border for part in of_cameras], [part.among for part in of_cameras]))
        joined.append(PixelPart(block_diag(*(part.coupling for part in of_cameras)),
                                block_diag(*(part.gram for part in of_cameras)),
                                np.concatenate([part.q for part in of_cameras]), border, among))
    return tuple(names), joined


def columns_of_kind(names: Sequence[tuple[str, int]], kind: str, mean: float) -> np.ndarray:
    """Amplitudes of the pixel columns of every hat of a kind  # (k, n_hats)

    mean : of the grey values of the reference image; of several cameras, of all of them
    """
    parts = {GAIN: 1.0, OFFSET: mean} if kind == LIGHT else {kind: 1.0}
    places = sorted({number for name, number in names if name in parts})
    amplitudes = np.zeros((len(names), len(places)))
    for i, (name, number) in enumerate(names):
        if name in parts:
            amplitudes[i, places.index(number)] = parts[name]
    return amplitudes


def sums_against(context: CorrelationContext, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sums of an image (n_pixels,) against the reference's gradient at the nodes, and its brightness columns.

    Of the image as it is: no product of noise is taken off its sum against a blur, as from that of a recorded frame.
    """
    experiment = context.experiment
    picture, reference = context.reference.synthetic_image(image)
    bare_experiment = replace(experiment, recording=replace(experiment.recording, stack=ArrayStack(picture[None]),
                                                            noise=replace(experiment.recording.noise, std_gv=None)),
                              options=replace(experiment.options, lowpass_px=0.0))
    still = reference.compare(bare_experiment, 0, np.zeros((len(experiment.model.mesh.nodes), reference.n_components)))
    return still.q, still.rb


def _hats(points: np.ndarray) -> np.ndarray:
    """Bilinear hats over the pixels that are seen; their sum is one  # (n_pixels, n)"""
    low, extent = points.min(axis=0), np.maximum(np.ptp(points, axis=0), 1.0)
    cells = np.maximum(1, np.rint(HAT_CELLS * extent / extent.max())).astype(int)
    at = (points - low) / extent * cells
    sides = [np.maximum(1.0 - np.abs(at[:, [i]] - np.arange(cells[i] + 1)), 0.0) for i in (0, 1)]
    hats = (sides[0][:, :, None] * sides[1][:, None, :]).reshape(len(points), -1)
    return hats[:, hats.sum(axis=0) > 0.05 * len(points) / hats.shape[1]]


def _noise_left(pixel_map, column: np.ndarray, std_px: float, correlation: np.ndarray | None) -> float:
    """Variance of a sum of low-passed noise against an image, over that of the noise of single pixels."""
    blurred = lowpass(np.nan_to_num(pixel_map.to_image(column)).astype(np.float32), std_px)
    gain = 1.0 if correlation is None else sum_gain(blurred, correlation)
    return gain * float((blurred.astype(float) ** 2).sum() / max((column**2).sum(), 1e-300))
