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

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numba import njit
from scipy import sparse

from idic.diagnose.residual.grey_value_effects import PixelPart
from idic.parameters import ParameterSet


@dataclass(frozen=True, eq=False)
class Courses:
    """Of K columns, each a motion times a course in time.

    motion : (K,) number of a column's motion, -1 where it moves nothing; amplitude : (T, K) of it in every frame
    """

    motion: np.ndarray
    amplitude: np.ndarray

    def pick(self, indices: Sequence[int]) -> Courses:
        """Of some of the columns, in this order."""
        return Courses(self.motion[indices], self.amplitude[:, indices])


@dataclass(frozen=True, eq=False)
class Columns:
    """Derivatives (or finite differences) of the simulation, as images and channels record them.

    names : K labels; fields : (T, n_seen, P) image motions at the seen dofs (px, or the unit of height images);
    channels : (T, n_channels, K) in the channels' units; pixels : (T, k, K) amplitudes of the pixel columns
    (`idic.diagnose.residual.grey_value_effects`), None where none takes part; courses : which motion is which column's,
    and its course, None where every column is a motion of its own.
    """

    names: tuple[str, ...]
    fields: np.ndarray
    channels: np.ndarray
    pixels: np.ndarray | None = None
    courses: Courses | None = None

    @property
    def n(self) -> int:
        return len(self.names)

    @property
    def timed(self) -> Courses:
        """The courses; 1 in every frame where every column is a motion of its own."""
        return self.courses or Courses(np.arange(self.n), np.ones((len(self.fields), self.n)))

    def amplitudes(self, k: int) -> np.ndarray:
        """Amplitudes of k pixel columns, zero where none takes part  # (T, k, K)"""
        return np.zeros((len(self.fields), k, self.n)) if self.pixels is None else self.pixels

    def expanded(self) -> Columns:
        """The same with a motion for every column."""
        if self.courses is None:
            return self
        motion, amplitude = self.courses.motion, self.courses.amplitude * (self.courses.motion >= 0)
        fields = (np.take(self.fields, np.maximum(motion, 0), axis=2) * amplitude[:, None] if self.fields.shape[2]
                  else np.zeros((*self.fields.shape[:2], self.n)))
        return replace(self, fields=fields, courses=None)

    def pick(self, indices: Sequence[int]) -> Columns:
        """Some of the columns, in this order."""
        indices = list(indices)
        return Columns(tuple(self.names[i] for i in indices),
                       self.fields[..., indices] if self.courses is None else self.fields, self.channels[..., indices],
                       None if self.pixels is None else self.pixels[..., indices],
                       None if self.courses is None else self.courses.pick(indices))


def of_grey_values(names: tuple[str, ...], n_seen: int, n_channels: int, pixels: np.ndarray) -> Columns:
    """Columns that move nothing; pixels : (T, k, K)"""
    n_frames, _, n = pixels.shape
    return Columns(names, np.zeros((n_frames, n_seen, 0)), np.zeros((n_frames, n_channels, n)), pixels,
                   Courses(np.full(n, -1), np.zeros((n_frames, n))))


def joined(*parts: Columns) -> Columns:
    """Columns side by side; of one part itself."""
    if len(parts) == 1:
        return parts[0]
    k = max((part.pixels.shape[1] for part in parts if part.pixels is not None), default=0)
    courses = None
    if any(part.courses is not None for part in parts):
        first = np.cumsum([0, *(part.fields.shape[2] for part in parts)])
        motions = [np.where(part.timed.motion < 0, -1, part.timed.motion + n)
                   for part, n in zip(parts, first, strict=False)]
        courses = Courses(np.concatenate(motions), np.concatenate([part.timed.amplitude for part in parts], axis=1))
    return Columns(sum((part.names for part in parts), ()), np.concatenate([part.fields for part in parts], axis=2),
                   np.concatenate([part.channels for part in parts], axis=2),
                   np.concatenate([part.amplitudes(k) for part in parts], axis=2) if k else None, courses)


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
        plain = columns.expanded()
        pixels = None if plain.pixels is None else self.white_pixels(plain.pixels)
        return replace(plain, fields=self._white_fields(plain.fields), pixels=pixels)

    def white_pixels(self, pixels: np.ndarray) -> np.ndarray:
        """Of amplitudes of pixel columns  # (T, k, K)"""
        kappa = self.kappa[:, None, None]
        return (pixels - self.share * (pixels / kappa).sum(axis=0)) / np.sqrt(kappa)

    @cached_property
    def seen_nodes(self) -> SeenNodes:
        """The nodes of the seen dofs."""
        return SeenNodes(self.seen, self.n_components)

    def _white_fields(self, fields: np.ndarray) -> np.ndarray:
        """Of motions  # (T, n_seen, K)"""
        nodes, motion = self.seen_nodes, np.arange(fields.shape[2])
        backs, white = self.back[:, nodes.numbers], np.empty(fields.shape)
        shared = np.zeros((len(nodes.numbers), self.n_components, len(motion)))
        for back, field, kappa in zip(backs, fields, self.kappa, strict=True):
            add_turned(back, nodes.spread(field), motion, np.full(len(motion), 1.0 / kappa), shared)
        for t, back in enumerate(backs):
            common = np.einsum("nij,njk->nik", inverse_at_nodes(back), shared)
            white[t] = (fields[t] - self.share * nodes.gathered(common)) / np.sqrt(self.kappa[t])
        return white

    def weighed(self, white: Columns) -> Columns:
        """The white columns times the weights, frame-local unknowns projected out."""
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

    def products(self, white: Columns, weighed: Columns) -> np.ndarray:
        """The Gram matrix of two sets of columns  # (K, L)"""
        total = np.tensordot(white.channels, weighed.channels, axes=((0, 1), (0, 1)))
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
            total += white.fields[t].T @ q + white.channels[t].T @ channel_q
            if white.pixels is not None:
                total += white.pixels[t].T @ self.pixel_residual(part)
        return total

    def pixel_residual(self, part: FrameEvidence) -> np.ndarray:
        """`residual` against the pixel columns  # (k,)"""
        return part.pixel.q - part.pixel.border @ (part.inner @ part.inner_q)

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


class SeenNodes:
    """The nodes whose motion pixels see, with all of their components.

    numbers : (n,) of the nodes; dofs : (n_seen,) of the seen dofs among the components of these nodes
    """

    def __init__(self, seen_dofs: np.ndarray, n_components: int):
        node, component = np.divmod(seen_dofs, n_components)
        self.numbers, place = np.unique(node, return_inverse=True)
        self.n_components, self.dofs = n_components, place * n_components + component

    def spread(self, fields: np.ndarray) -> np.ndarray:
        """Fields at the seen dofs at the nodes, zero where nothing is seen  # (n_seen, K) -> (n, c, K)"""
        shape = (len(self.numbers), self.n_components, fields.shape[1])
        if len(self.dofs) == shape[0] * shape[1]:
            return np.ascontiguousarray(fields).reshape(shape)
        nodal = np.zeros((shape[0] * shape[1], shape[2]))
        nodal[self.dofs] = fields
        return nodal.reshape(shape)

    def gathered(self, nodal: np.ndarray) -> np.ndarray:
        """Fields of the nodes at the seen dofs  # (n, c, K) -> (n_seen, K)"""
        return flat(nodal)[self.dofs]


def flat(nodal: np.ndarray) -> np.ndarray:
    """Components of all nodes one after the other  # (n, c, K) -> (n c, K)"""
    return nodal.reshape(nodal.shape[0] * nodal.shape[1], nodal.shape[2])


@njit(cache=True, nogil=True)
def add_turned(matrices, fields, motion, factor, total):
    """Add to total (n, c, K) a matrix per node (n, c, c) times the fields there (n, c, P): to column k the field
    motion[k] times factor[k]."""
    n, c, n_fields = fields.shape
    turned = np.empty(n_fields)
    for node in range(n):
        for i in range(c):
            turned[:] = 0.0
            for j in range(c):
                for p in range(n_fields):
                    turned[p] += matrices[node, i, j] * fields[node, j, p]
            for k in range(len(motion)):
                total[node, i, k] += factor[k] * turned[motion[k]]


class CommonWeights:
    """The sum over frames of a factor times B^-T A B^-1: the weights A of all frames, brought to the reference image.

    It has a block per pair of nodes that share an element; frames whose weights have one pattern share its blocks.
    """

    def __init__(self, nodes: SeenNodes):
        self.nodes = nodes
        self.sums: list[tuple[sparse.csr_array, sparse.bsr_array]] = []

    def add(self, A: sparse.csr_array, inverse: np.ndarray, factor: float) -> None:
        """A frame's weights (n_seen, n_seen); inverse : (n, c, c) B^-1"""
        if not self.sums or not _is_of_pattern(A, self.sums[-1][0]):
            self.sums.append((A, self._blocks(A)))
        total = self.sums[-1][1]
        _add_blocks(A.indptr, A.indices, A.data, self.nodes.dofs, inverse, factor, total.indptr, total.indices,
                    total.data)

    def times(self, fields: np.ndarray) -> np.ndarray:
        """The sum times fields of the nodes  # (n_dofs, K)"""
        return sum((total @ fields for _, total in self.sums), np.zeros(fields.shape))

    def _blocks(self, A: sparse.csr_array) -> sparse.bsr_array:
        """A block of zero for every pair of nodes that weights have entries for."""
        n, c = len(self.nodes.numbers), self.nodes.n_components
        starts, neighbours = _neighbours(A.indptr, A.indices, self.nodes.dofs, n, c)
        return sparse.bsr_array((np.zeros((len(neighbours), c, c)), neighbours, starts), shape=(n * c, n * c))


def _is_of_pattern(first: sparse.csr_array, second: sparse.csr_array) -> bool:
    return first.indices is second.indices or (np.array_equal(first.indptr, second.indptr)
                                               and np.array_equal(first.indices, second.indices))


@njit(cache=True, nogil=True)
def _neighbours(starts, columns, dofs, n_nodes, c):
    """First neighbour of every node, and the neighbours of all nodes; dofs : (n_seen,) of the rows, ascending"""
    first, neighbours, latest = np.zeros(n_nodes + 1, np.int64), np.empty(len(columns), np.int64), np.full(n_nodes, -1)
    count = 0
    for row in range(len(dofs)):
        node = dofs[row] // c
        for entry in range(starts[row], starts[row + 1]):
            neighbour = dofs[columns[entry]] // c
            if latest[neighbour] != node:
                latest[neighbour] = node
                neighbours[count] = neighbour
                count += 1
        first[node + 1] = count
    return first, neighbours[:count].copy()


@njit(cache=True, nogil=True)
def _add_blocks(starts, columns, entries, dofs, inverse, factor, first_block, neighbours, total):
    """Add inverse^T A inverse times a factor to its blocks (n_blocks, c, c); dofs : (n_seen,) of the rows, ascending"""
    n, c, _ = inverse.shape
    block = np.zeros(n, np.int64)  # of every neighbour of the present node
    latest = -1
    for row in range(len(dofs)):
        node, i = divmod(dofs[row], c)
        if node != latest:
            latest = node
            for k in range(first_block[node], first_block[node + 1]):
                block[neighbours[k]] = k
        for entry in range(starts[row], starts[row + 1]):
            neighbour, j = divmod(dofs[columns[entry]], c)
            for a in range(c):
                weight = factor * entries[entry] * inverse[node, i, a]
                for b in range(c):
                    total[block[neighbour], a, b] += weight * inverse[neighbour, j, b]
