"""The residual of a finished identification, made white and brought to the nodes: the input of every test.

The noise of the reference image is in every frame. With r_t = f - g_t(x + u_t), per pixel,

    V = sigma^2 (diag(kappa_t) + 1 1^T / N),  V^-1/2 r = (r_t - c R) / sqrt(kappa_t),   R = sum_s r_s / kappa_s,
    c = (1 - 1/sqrt(1 + k/N)) / k,            k = sum_s 1 / kappa_s

for a reference that is the mean of N images, and the same for every column of the problem. Afterwards frames are
independent and the noise is sigma^2 everywhere; unknowns of one frame alone (gain, offset, a logged grip's noise, a
measured edge) are eliminated there. A column is a nodal field per frame; ``(F^-T grad f) . phi = grad f . (F^-1 phi)``
takes it to the reference image, with F^-1 averaged at the nodes.

Without this step a slow misfit of the reference's noise looks like a persistent error of the model, with onset at
frame 1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numba import njit
from scipy import sparse

from idic.diagnose.residual.grey_value_effects import PixelPart
from idic.parameters import ParameterSet


@dataclass(frozen=True, eq=False)
class Columns:
    """Derivatives (or finite differences) of the simulation, as images and channels record them.

    fields : (T, n_seen, K) image motion at the seen dofs (px, or the unit of height images), (T, 0, K) of columns that
    move nothing (`apart`); channels : (T, n_channels, K) in the channels' units; names : K labels; pixels : (T, k, K)
    amplitudes of the pixel columns (`idic.diagnose.residual.grey_value_effects`), None where none takes part.
    """

    names: tuple[str, ...]
    fields: np.ndarray
    channels: np.ndarray
    pixels: np.ndarray | None = None

    @property
    def n(self) -> int:
        return len(self.names)

    def amplitudes(self, k: int) -> np.ndarray:
        """Amplitudes of k pixel columns, zero where none takes part  # (T, k, K)"""
        return np.zeros((len(self.fields), k, self.n)) if self.pixels is None else self.pixels

    @property
    def moves(self) -> bool:
        """Whether there are fields of motion."""
        return self.fields.shape[1] > 0

    def apart(self) -> tuple[Columns, ...]:
        """These columns as one part, or as two where the last ones are of grey values alone: those without fields."""
        first = self._first_still
        if first is None:
            return (self,)
        moving, still = (Columns(self.names[members], self.fields[..., members], self.channels[..., members],
                                 self.pixels[..., members])
                         for members in (slice(first), slice(first, None)))
        still = replace(still, fields=np.zeros((len(self.fields), 0, still.n)))
        if not moving.pixels.any():
            moving = replace(moving, pixels=None)
        return (moving, still) if first else (still,)

    @cached_property
    def _first_still(self) -> int | None:
        """Where columns of grey values alone begin; None where there are none, or where they have no fields anyway."""
        if self.pixels is None or not self.moves:
            return None
        of_pixels = np.atleast_1d(self.pixels.any(axis=(0, 1)))
        first = self.n - int(np.argmin(of_pixels[::-1])) if not of_pixels.all() else 0
        return None if first == self.n or self.fields[..., first:].any() else first

    def frame(self, t: int) -> Columns:
        """These columns in one frame alone."""
        return Columns(self.names, self.fields[t:t + 1], self.channels[t:t + 1],
                       None if self.pixels is None else self.pixels[t:t + 1])

    def pick(self, indices: Sequence[int]) -> Columns:
        """Some of the columns, in this order."""
        indices = list(indices)
        return Columns(tuple(self.names[i] for i in indices), self.fields[..., indices], self.channels[..., indices],
                       None if self.pixels is None else self.pixels[..., indices])


def joined(*parts: Columns) -> Columns:
    """Columns side by side; of one part itself."""
    if len(parts) == 1:
        return parts[0]
    k = max((part.pixels.shape[1] for part in parts if part.pixels is not None), default=0)
    return Columns(sum((part.names for part in parts), ()), np.concatenate([part.fields for part in parts], axis=2),
                   np.concatenate([part.channels for part in parts], axis=2),
                   np.concatenate([part.amplitudes(k) for part in parts], axis=2) if k else None)


@dataclass(frozen=True, eq=False)
class FrameEvidence:
    """One white frame: ``A`` weighs motion (1/sigma^2), unknowns of this frame alone are ready to be eliminated.

    weights : (n_seen, n_seen) sum of gradients' products / sigma^2, or what makes it at each use: those of all scans of
    a test would fill the memory; q : (n_seen,) and channel_q : (n_channels,) right-hand
    sides, weighted; border : (n_seen + n_channels, m) A times the frame's own columns; inner : (m, m) their block with
    priors, inverted; inner_q : (m,) their right-hand side; light : drop of chi-square by the frame's own gain, offset
    and blur, less what noise gives.
    """

    weights: sparse.csr_array | Callable[[], sparse.csr_array]
    q: np.ndarray
    channel_q: np.ndarray
    border: np.ndarray
    inner: np.ndarray
    inner_q: np.ndarray
    pixel: PixelPart | None = None
    light: float = 0.0

    @property
    def A(self) -> sparse.csr_array:
        return self.weights() if callable(self.weights) else self.weights

    def weights_at(self, places: np.ndarray) -> sparse.csr_array | Callable[[], sparse.csr_array]:
        """Of some of the seen dofs."""
        if callable(self.weights):
            return lambda: self.A[places][:, places]
        return self.weights[places][:, places]


@dataclass(frozen=True, eq=False)
class Evidence:
    """All frames.

    frames : (T,) frame numbers; seen : (n_seen,) image dofs (``n_components * node + component``) that pixels see;
    kappa : (T,); back : (T, n_nodes, c, c) takes a frame's nodal field to the reference image; channel_weight :
    (n_channels,) 1/variance; chi2 : r^T V^-1 r of the images before anything is eliminated; n_pixels : pixels in it,
    all frames; pixel_names : kind and number of the pixel columns; n_images : averaged to the reference; parameters :
    at the values of the residual: their priors count like data; n_axes : of an image, 3 of a volume.
    """

    frames: np.ndarray
    seen: np.ndarray
    kappa: np.ndarray
    back: np.ndarray
    channel_weight: np.ndarray
    chi2: float
    n_pixels: int
    parts: tuple[FrameEvidence, ...]
    pixel_names: tuple[tuple[str, int], ...] = ()
    n_images: int = 1
    parameters: ParameterSet | None = None
    n_axes: int = 2

    @property
    def share(self) -> float:
        """See `noise_share`."""
        return noise_share(self.kappa, self.n_images)

    @property
    def share_back(self) -> float:
        """c (1 + k/N)^1/2: the factor from white frames to recorded ones (`idic.diagnose.locate.noise_draws`)."""
        return self.share * float(np.sqrt(1.0 + np.sum(1.0 / self.kappa) / self.n_images))

    @property
    def n_components(self) -> int:
        return self.back.shape[-1]

    def at(self, dofs: np.ndarray) -> Evidence:
        """The same for fields that vanish outside some of the seen dofs, without pixel columns; dofs : sorted."""
        places = np.searchsorted(self.seen, dofs)
        rows = np.concatenate([places, len(self.seen) + np.arange(len(self.channel_weight))])
        parts = tuple(replace(part, weights=part.weights_at(places), q=part.q[places], border=part.border[rows],
                              pixel=None)
                      for part in self.parts)
        return replace(self, seen=np.asarray(dofs), parts=parts, pixel_names=())

    def whiten(self, columns: Columns) -> Columns:
        """V^-1/2 applied to columns; channels are independent from frame to frame already."""
        fields, pixels = np.empty(columns.fields.shape), None if columns.pixels is None else np.empty_like(
            columns.pixels)
        for t, white in enumerate(self.white_frames(columns)):
            fields[t] = white.fields[0]
            if pixels is not None:
                pixels[t] = white.pixels[0]
        return Columns(columns.names, fields, columns.channels, pixels)

    def white_frames(self, columns: Columns) -> Iterator[Columns]:
        """The frames of `whiten` one after the other, each as columns of one frame."""
        pixels = columns.pixels
        if pixels is not None:
            kappa = self.kappa[:, None, None]
            pixels = (pixels - self.share * (pixels / kappa).sum(axis=0)) / np.sqrt(kappa)
        fields = self._white_fields(columns.fields) if columns.moves else iter(columns.fields)
        for t, white in enumerate(fields):
            yield Columns(columns.names, white[None], columns.channels[t:t + 1],
                          None if pixels is None else pixels[t:t + 1])

    def frame(self, t: int) -> Evidence:
        """One white frame alone, for products of its columns (`white_frames`)."""
        return replace(self, parts=(self.parts[t],))

    def _white_fields(self, fields: np.ndarray) -> Iterator[np.ndarray]:
        """The motions of `white_frames`  # T times (n_seen, K)"""
        c, n = self.n_components, fields.shape[2]
        nodes = np.unique(self.seen // c)
        is_complete = len(nodes) * c == len(self.seen)  # of every node all components are seen, or none
        spread = (fields.reshape(len(fields), len(nodes), c, n) if is_complete
                  else _spread_out(fields, self.seen, self.back.shape[1], c))
        backs = self.back[:, nodes] if is_complete else self.back
        shared = np.zeros(spread.shape[1:])
        for t, back in enumerate(backs):
            _add_turned(back, np.ascontiguousarray(spread[t]), 1.0 / self.kappa[t], shared)
        for t, back in enumerate(backs):
            white = np.empty(shared.shape)
            _without_common(np.ascontiguousarray(inverse_at_nodes(back)), np.ascontiguousarray(spread[t]), shared,
                            self.share, 1.0 / np.sqrt(self.kappa[t]), white)
            white = white.reshape(len(white) * c, n)
            yield white if is_complete else white[self.seen]

    def weighed(self, white: Columns) -> Columns:
        """The white columns times the weights, frame-local unknowns projected out; of columns without fields the part
        in channels and grey values, which is all that `products` asks for."""
        if not white.moves:
            return self._weighed_still(white)
        fields, channels = np.empty(white.fields.shape), np.empty_like(white.channels)
        k = len(self.pixel_names)
        pixels = np.zeros((len(fields), k, white.n)) if k else None
        for t, part in enumerate(self.parts):
            n, pixel, amplitudes = len(part.q), part.pixel, None if white.pixels is None else white.pixels[t]
            motion, rows = white.fields[t], white.channels[t]
            bordered = part.border[:n].T @ motion + part.border[n:].T @ rows
            local = part.inner @ (bordered if amplitudes is None or pixel is None
                                  else bordered + pixel.border.T @ amplitudes)
            np.subtract(part.A @ motion, part.border[:n] @ local, out=fields[t])
            channels[t] = self.channel_weight[:, None] * rows - part.border[n:] @ local
            if pixel is None:
                continue
            pixels[t] = pixel.coupling.T @ motion - pixel.border @ (part.inner @ bordered)
            if amplitudes is not None:
                fields[t] += pixel.coupling @ amplitudes
                pixels[t] += (pixel.gram @ amplitudes
                              - pixel.among @ (part.inner @ (pixel.among.T @ amplitudes)))
        return Columns(white.names, fields, channels, pixels)

    def _weighed_still(self, white: Columns) -> Columns:
        """`weighed` of columns without fields."""
        channels = np.empty_like(white.channels)
        k = len(self.pixel_names)
        pixels = np.zeros((len(channels), k, white.n)) if k else None
        for t, part in enumerate(self.parts):
            n, rows = len(part.q), white.channels[t]
            bordered = part.border[n:].T @ rows
            if part.pixel is not None:
                pixel, amplitudes = part.pixel, white.amplitudes(k)[t]
                pixels[t] = (pixel.gram @ amplitudes - pixel.border @ (part.inner @ bordered)
                             - pixel.among @ (part.inner @ (pixel.among.T @ amplitudes)))
                bordered = bordered + pixel.border.T @ amplitudes
            channels[t] = self.channel_weight[:, None] * rows - part.border[n:] @ (part.inner @ bordered)
        return Columns(white.names, white.fields, channels, pixels)

    def products(self, white: Columns, weighed: Columns) -> np.ndarray:
        """The Gram matrix of two sets of columns  # (K, L); weighed : with fields, unless neither has them"""
        if white.moves and not weighed.moves:
            raise ValueError("columns without fields, weighed, against columns with fields")
        total = np.tensordot(white.channels, weighed.channels, axes=((0, 1), (0, 1)))
        if white.moves:
            for fields, heavy in zip(white.fields, weighed.fields, strict=True):  # a product of all frames is copied
                total += fields.T @ heavy
        if white.pixels is not None and weighed.pixels is not None:
            total += np.tensordot(white.pixels, weighed.pixels, axes=((0, 1), (0, 1)))
        return total

    def scores(self, white: Columns) -> np.ndarray:
        """Columns times the weighted residual  # (K,)"""
        total = np.zeros(white.n)
        for t, part in enumerate(self.parts):
            q, channel_q = self.residual(part)
            total += white.channels[t].T @ channel_q
            if white.moves:
                total += white.fields[t].T @ q
            if white.pixels is not None:
                total += white.pixels[t].T @ (part.pixel.q - part.pixel.border @ (part.inner @ part.inner_q))
        return total

    def residual(self, part: FrameEvidence) -> tuple[np.ndarray, np.ndarray]:
        """Weighted residual of a frame at the seen dofs and in the channels, its own unknowns projected out."""
        n, local = len(part.q), part.inner @ part.inner_q
        return part.q - part.border[:n] @ local, part.channel_q - part.border[n:] @ local


def noise_share(kappa: np.ndarray, n_images: int) -> float:
    """c of the module; kappa : (T,) of the frames, n_images : averaged to the reference"""
    k = float(np.sum(1.0 / kappa))
    return (1.0 - 1.0 / np.sqrt(1.0 + k / n_images)) / k


def inverse_at_nodes(matrices: np.ndarray) -> np.ndarray:
    """Inverses of a matrix per node  # (n, c, c)"""
    if matrices.shape[1] != 2:
        return np.linalg.inv(matrices)
    (a, b), (c, d) = matrices.transpose(1, 2, 0)
    return (np.array([[d, -b], [-c, a]]) / (a * d - b * c)).transpose(2, 0, 1)


@njit(cache=True, nogil=True)
def _add_turned(back, fields, factor, total):
    """total (n, c, K) and a matrix per node (n, c, c) times the fields there (n, c, K) and a factor, in place."""
    n, c, n_fields = fields.shape
    for node in range(n):
        for i in range(c):
            for j in range(c):
                weight = factor * back[node, i, j]
                for k in range(n_fields):
                    total[node, i, k] += weight * fields[node, j, k]


@njit(cache=True, nogil=True)
def _without_common(inverse, fields, shared, share, factor, out):
    """(fields - share inverse shared) factor, node by node  # (n, c, c), (n, c, K) -> out (n, c, K)"""
    n, c, n_fields = fields.shape
    for node in range(n):
        for i in range(c):
            for k in range(n_fields):
                out[node, i, k] = fields[node, i, k]
            for j in range(c):
                weight = share * inverse[node, i, j]
                for k in range(n_fields):
                    out[node, i, k] -= weight * shared[node, j, k]
            for k in range(n_fields):
                out[node, i, k] *= factor


def _spread_out(fields: np.ndarray, dofs: np.ndarray, n_nodes: int, c: int) -> np.ndarray:
    """Seen dofs to all nodes  # (T, n_seen, K) -> (T, n_nodes, c, K)"""
    nodal = np.zeros((len(fields), n_nodes * c, fields.shape[2]))
    nodal[:, dofs] = fields
    return nodal.reshape(len(fields), n_nodes, c, fields.shape[2])
