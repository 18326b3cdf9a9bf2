"""One scan -> its equations at the nodes of a solid: M and b for any nodal displacement.

    r = f - g(x + u),      L = (F^-T grad f) . phi,      brightness columns L = (-f_centred, -1) per patch

docs/method.md, equations 1.2, 1.3, 3.2, 3.3 and 4.3 in three dimensions: dof = 3 node + component, F of each element in
voxels. No scan is held whole: block by block its voxels are read with a halo, filtered and summed. Grey values and
gradients of the reference scan at the voxels are kept where they fit into `KEPT_BYTES`, else made anew in each pass;
the sums are the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from numba import njit
from scipy import sparse

from idic.correlation.image_equations.comparison import NodalBasis
from idic.correlation.image_equations.frame import NodalEquations, brightness_blocks, squares_about_mean
from idic.correlation.image_equations.grey import MIN_CONTRAST_RATIO, contrast_ratio
from idic.correlation.image_equations.reference import Brightness
from idic.correlation.image_equations.residual import ResidualMap
from idic.correlation.pixels.blocks import Pattern, block_pattern
from idic.correlation.volume.eight_taps import LANES
from idic.correlation.volume.eight_voxels import copy_eight, fetch_early
from idic.correlation.volume.element_sums import element_sums, scatter, scatter_matrix
from idic.correlation.volume.solid_cells import N_SOLID_NODES, TRANSFORMS, coefficients_of
from idic.correlation.volume.volume_kernel import sums_of_values, volume_pass
from idic.correlation.volume.voxel_map import VoxelMap
from idic.errors import InputError
from idic.images import DEGREES, VolumeStack, lowpass_weights, noise_gain
from idic.correlation.volume.block_filter import REACH, filtered, mirrored_block
from idic.correlation.volume.spline_block import coefficients_in, slopes_in
from idic.model import Experiment

KEPT_BYTES = 400_000_000  # of one process
_TAPS_BEYOND = 64  # entries after the last coefficient that a vector of taps may read


@dataclass(frozen=True, eq=False)
class VolumeMotion:
    """The motion of one scan, element by element; made once per scan.

    coefficients : (n_elements, 3, n_max) voxels; inverse : (n_elements, 3, 3) F^-1; det : (n_elements,) det F
    """

    voxel_map: VoxelMap
    coefficients: np.ndarray
    inverse: np.ndarray
    det: np.ndarray

    @cached_property
    def pull_back(self) -> np.ndarray:
        """F^-1 at the nodes  # (n_nodes, 3, 3)"""
        return self.voxel_map.at_nodes(self.inverse)


@dataclass(frozen=True, eq=False)
class Voxels:
    """Grey value and gradient of the reference at the voxels of a block  # (n,) float32 each"""

    f: np.ndarray
    gx: np.ndarray
    gy: np.ndarray
    gz: np.ndarray

    @property
    def nbytes(self) -> int:
        return 4 * self.f.nbytes


@dataclass(frozen=True, eq=False)
class VolumeReference(NodalBasis):
    """The reference scan on the voxels of the mesh.

    Attributes
    ----------
    scans : stack of the reference scans; frames : those that are averaged
    degree : {3, 5}; lowpass_px : standard deviation of the Gaussian, voxels
    border_px : voxels along the borders of the volume that count as outside
    level : mean grey value on the mesh
    hessian : array (n_elements, n_pairs, 6); coupling : array (n_elements, n_max, 3, 2); grey : array (n_elements, 3)
        Sums over the voxels of each element (`idic.correlation.volume.element_sums`).
    """

    pixel_map: VoxelMap  # type: ignore[assignment]
    scans: VolumeStack
    frames: tuple[int, ...]
    degree: int
    lowpass_px: float
    border_px: int
    level: float
    hessian: np.ndarray
    coupling: np.ndarray
    grey: np.ndarray
    pattern: Pattern
    layouts: Mapping[str, Brightness]
    gradient_noise: float = 0.0
    stored: dict[int, Voxels] = field(default_factory=dict)
    n_components = 3

    @property
    def n_images(self) -> int:
        """Scans averaged to the reference."""
        return len(self.frames)

    @property
    def contrast(self) -> float:
        """Standard deviation of f on the mesh."""
        n, first, second = self.grey.sum(axis=0)
        return float(np.sqrt(max(second / n - (first / n) ** 2, 0.0)))

    def layout(self, brightness: str) -> Brightness:
        if brightness not in self.layouts:
            raise InputError("no such brightness correction", key="brightness", found=brightness,
                             expected=", ".join(self.layouts), remedy="write one of these names")
        return self.layouts[brightness]

    def seen_by(self, experiment: Experiment) -> VolumeReference:
        """The same voxels with the options of another experiment, such as its low-pass."""
        return volume_reference(self.pixel_map, experiment)

    def compare(self, experiment: Experiment, frame: int, motion: np.ndarray) -> NodalEquations:
        """Nodal equations of one scan under a nodal motion (n_nodes, 3), voxels."""
        return self.equations(experiment.recording.volumes, frame, motion, experiment.options.brightness)

    def equations(self, stack: VolumeStack, frame: int, u_px: np.ndarray, brightness: str = "frame") -> NodalEquations:
        """The same of a scan of any stack."""
        pm, layout = self.pixel_map, self.layout(brightness)
        motion = self.motion(u_px)
        hessian, coupling, grey = self.hessian, self.coupling, self.grey.copy()
        sums, lost = np.empty((pm.n_elements, 3 * pm.conn.shape[1] + 3)), np.zeros(pm.n_elements, dtype=np.int64)
        lost_pixels = []
        for number in range(len(pm.blocks) - 1):
            voxels = self.voxels(number)
            valid = np.ones(len(voxels.f), dtype=np.uint8)
            self._pass(stack, frame, motion, layout, number, voxels, valid, sums, lost)
            span = slice(*pm.blocks[number:number + 2])
            concerned = span.start + np.flatnonzero(lost[span])
            if len(concerned):
                if hessian is self.hessian:
                    hessian, coupling = hessian.copy(), coupling.copy()
                self._sums(number, concerned, voxels, valid, hessian, coupling, grey)
                lost_pixels.append(pm.start[span.start] + np.flatnonzero(valid == 0))
        return self._nodal(layout, motion, sums, lost, lost_pixels, hessian, coupling, grey)

    def equations_of_values(self, values: Callable[[int], np.ndarray], brightness: str) -> NodalEquations:
        """Nodal equations of the reference at rest with given residuals of its voxels.

        values : those of a block by its number, called once for each in their order  # -> (n,) GV
        """
        pm, layout = self.pixel_map, self.layout(brightness)
        motion = self.motion(np.zeros((pm.n_nodes, 3)))
        sums, lost = np.empty((pm.n_elements, 3 * pm.conn.shape[1] + 3)), np.zeros(pm.n_elements, dtype=np.int64)
        mean = (layout.mean[layout.patch] - np.float32(self.level)).astype(np.float32)
        for number in range(len(pm.blocks) - 1):
            elements, voxels = np.arange(*pm.blocks[number:number + 2]), self.voxels(number)
            sums_of_values(elements, pm.kind, N_SOLID_NODES, pm.run_start, pm.run, pm.start, pm.affine, pm.middle,
                           pm.places, pm.table_start, pm.table, values(number).astype(np.float32), voxels.f, voxels.gx,
                           voxels.gy, voxels.gz, mean, sums)
        return self._nodal(layout, motion, sums, lost, [], self.hessian, self.coupling, self.grey.copy())

    def lasting_residual(self, stack: VolumeStack, frames: Sequence[int], motions: Sequence[VolumeMotion],
                         kappa: np.ndarray, brightness: str) -> tuple[float, np.ndarray, np.ndarray]:
        """What the residuals of all scans have in common, block by block: no voxel of it is kept.

        R = sum_t r_t / kappa_t, zero where a scan does not show a voxel. Returns sum_t r_t^2 / kappa_t less what the
        noise of the reference adds, R^2 / (N + sum_t 1 / kappa_t), and the sums of R at the nodes and against gain and
        offset  # kappa (T,) -> GV^2, (3 n_nodes,), (n_brightness,)
        """
        weight, chi2 = self.n_images + float(np.sum(1.0 / kappa)), []

        def common(number: int) -> np.ndarray:
            n = len(self.voxels(number).f)
            total, squares, is_shown = np.zeros(n), 0.0, np.ones(n, dtype=bool)
            for frame, motion, k in zip(frames, motions, kappa, strict=True):
                r, valid = self.block_residual(stack, frame, motion, number, brightness)
                squares += float((r.astype(float) ** 2).sum()) / k
                total += r / float(k)
                is_shown &= valid
            total[~is_shown] = 0.0
            chi2.append(squares - float((total**2).sum()) / weight)
            return total

        sums = self.equations_of_values(common, brightness)
        return float(np.sum(chi2)), sums.q, sums.rb

    def block_residual(self, stack: VolumeStack, frame: int, motion: VolumeMotion, number: int, brightness: str
                       ) -> tuple[np.ndarray, np.ndarray]:
        """Residual of the voxels of a block, brightness not removed, and their validity  # (n,) float32 GV, (n,)
        bool"""
        pm, voxels = self.pixel_map, self.voxels(number)
        n = len(voxels.f)
        r, valid, fractions = np.empty(n, np.float32), np.ones(n, np.uint8), np.empty((3, n), np.float32)
        sums, lost = np.empty((pm.n_elements, 3 * pm.conn.shape[1] + 3)), np.zeros(pm.n_elements, np.int64)
        self._pass(stack, frame, motion, self.layout(brightness), number, voxels, valid, sums, lost, r, fractions)
        return r, valid.astype(bool)

    def motion(self, u_px: np.ndarray) -> VolumeMotion:
        """The motion of one scan; u_px : (n_nodes, 3) voxels"""
        pm = self.pixel_map
        if np.shape(u_px) != (pm.n_nodes, 3):
            raise ValueError(f"a nodal motion must be ({pm.n_nodes}, 3), got {np.shape(u_px)}")
        if not np.isfinite(u_px).all():
            raise ValueError("the nodal motion is not finite")
        coefficients = coefficients_of(pm.conn, pm.kind, np.asarray(u_px, float))
        F = pm.gradients(coefficients)
        det = np.linalg.det(F)
        inverse = np.zeros_like(F)
        inverse[det != 0.0] = np.linalg.inv(F[det != 0.0])  # a flattened element takes no part
        return VolumeMotion(pm, coefficients, inverse, det)

    def voxels(self, number: int) -> Voxels:
        """Grey value above `level` and gradient of the voxels of a block."""
        voxels = self.stored.get(number)
        if voxels is None:
            voxels = _voxels(self.pixel_map, number, self.scans, self.frames, self.degree, self.lowpass_px, self.level)
            if voxels.nbytes + sum(block.nbytes for block in list(self.stored.values())) <= KEPT_BYTES:
                self.stored[number] = voxels
        return voxels

    def release(self) -> None:
        """Give back the voxels that are kept of a scan too large to be kept whole; the next pass makes them anew."""
        if len(self.stored) < len(self.pixel_map.blocks) - 1:
            self.stored.clear()

    def _pass(self, stack: VolumeStack, frame: int, motion: VolumeMotion, layout: Brightness, number: int,
              voxels: Voxels, valid: np.ndarray, sums: np.ndarray, lost: np.ndarray,
              residual: np.ndarray | None = None, fractions: np.ndarray | None = None) -> None:
        """One block of a scan through the kernel."""
        pm = self.pixel_map
        elements = np.arange(*pm.blocks[number:number + 2])
        coefficients, box, low, high = _coefficients(pm, number, stack, frame, motion.coefficients, self.degree,
                                                     self.lowpass_px, self.border_px, self.level)
        keep = residual is not None
        volume_pass(elements, pm.kind, N_SOLID_NODES, pm.run_start, pm.run, pm.start, pm.affine, pm.middle, pm.places,
                    pm.table_start, pm.table, voxels.f, voxels.gx, voxels.gy, voxels.gz,
                    (layout.mean[layout.patch] - np.float32(self.level)).astype(np.float32), motion.coefficients,
                    coefficients, self.degree, box, low, high, valid, keep,
                    residual if keep else _NOTHING, fractions if keep else _NO_FRACTIONS, sums, lost)

    def _sums(self, number: int, elements: np.ndarray, voxels: Voxels, valid: np.ndarray, hessian: np.ndarray,
              coupling: np.ndarray, grey: np.ndarray) -> None:
        _sums_of(self.pixel_map, elements, self.pixel_map.start[self.pixel_map.blocks[number]], voxels, valid, hessian,
                 coupling, grey)

    def _nodal(self, layout: Brightness, motion: VolumeMotion, sums: np.ndarray, lost: np.ndarray,
               lost_pixels: Sequence[np.ndarray], hessian: np.ndarray, coupling: np.ndarray,
               grey: np.ndarray) -> NodalEquations:
        """The sums of the elements carried to the nodes."""
        pm, n_max = self.pixel_map, self.pixel_map.conn.shape[1]
        n_dof = 3 * pm.n_nodes
        q, pairs = np.zeros(n_dof), np.zeros(len(layout.pattern.indices))
        centre = layout.mean.astype(float)[layout.patch] - self.level
        scatter(pm.conn, pm.kind, N_SOLID_NODES, TRANSFORMS, motion.inverse, sums, coupling, centre,
                layout.pattern.place, layout.pattern.stride, q, pairs)
        changed = np.flatnonzero(lost) if hessian is not self.hessian else np.zeros(0, dtype=np.int64)
        matrix = partial(self.matrix, motion.inverse, changed, hessian[changed])
        nb = layout.n_columns
        hb = sparse.csr_array((pairs, layout.pattern.indices, layout.pattern.indptr),
                              shape=(n_dof, nb)) if nb else sparse.csr_array((n_dof, 0))
        bb, rb = brightness_blocks(layout, grey, centre, sums[:, 3 * n_max + 1], sums[:, 3 * n_max + 2])
        rr, n_lost = float(sums[:, 3 * n_max].sum()), int(lost.sum())
        n_valid = pm.n_pixels - n_lost
        kappa = float((grey[:, 0] / np.maximum(np.abs(motion.det), 1e-3)).sum() / max(n_valid, 1))
        return NodalEquations(
            q, matrix(), hb, bb[:nb, :nb], rb[:nb], rr, n_valid, n_lost, lost,
            lost_pixels=np.concatenate(lost_pixels) if lost_pixels else np.zeros(0, dtype=np.int64),
            element_rr=sums[:, 3 * n_max].copy(), kappa=kappa, squares=squares_about_mean(bb, rb, rr), motion=motion,
            matrix=matrix)

    def matrix(self, inverse: np.ndarray, changed: np.ndarray, blocks: np.ndarray) -> sparse.csr_array:
        """H of a scan; inverse : (n_elements, 3, 3) F^-1; changed : elements that lost voxels, blocks : theirs"""
        pm, hessian = self.pixel_map, self.hessian
        if len(changed):
            hessian = hessian.copy()
            hessian[changed] = blocks
        data = np.zeros(len(self.pattern.indices))
        scatter_matrix(pm.conn, pm.kind, N_SOLID_NODES, inverse, hessian, self.pattern.place, self.pattern.stride, data)
        return sparse.csr_array((data, self.pattern.indices, self.pattern.indptr), shape=(3 * pm.n_nodes,) * 2)

    @cached_property
    def sections(self) -> VolumeReference:
        """The reference on the voxels of three sections alone."""
        pm = self.pixel_map.sections
        place = np.full(int(self.pixel_map.element.max()) + 1, -1)
        place[self.pixel_map.element] = np.arange(self.pixel_map.n_elements)
        used = place[pm.element]
        layouts = {name: replace(layout, patch=layout.patch[used]) for name, layout in self.layouts.items()}
        return replace(self, pixel_map=pm, layouts=layouts, stored={}, hessian=self.hessian[:0],
                       coupling=self.coupling[:0], grey=self.grey[used])

    def compare_pixels(self, experiment: Experiment, frame: int, motion: np.ndarray,
                       coefficients: np.ndarray) -> ResidualMap:
        """Residual of the voxels of the `sections`; coefficients : (nb,) gains and offsets."""
        return self.sections.residual(experiment.recording.volumes, frame, motion, experiment.options.brightness,
                                      coefficients)

    def residual(self, stack: VolumeStack, frame: int, u_px: np.ndarray, brightness: str = "none",
                 coefficients: np.ndarray | None = None) -> ResidualMap:
        """Residual of every voxel of the map, brightness removed."""
        r, valid, fractions = self.voxel_residuals(stack, frame, u_px, brightness, coefficients)
        gain = noise_gain(*fractions, degree=self.degree, lowpass_px=self.lowpass_px)
        return ResidualMap(r, valid, gain, volume_still_gain(self.lowpass_px), self.n_images)

    def voxel_residuals(self, stack: VolumeStack, frame: int, u_px: np.ndarray, brightness: str = "none",
                        coefficients: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Residual of every voxel of the map, brightness removed, its validity, and the fractions of its place in the
        scan  # (n,) float32 GV, (n,) bool, (3, n) float32"""
        pm, layout, motion = self.pixel_map, self.layout(brightness), self.motion(u_px)
        r, valid = np.empty(pm.n_pixels, np.float32), np.ones(pm.n_pixels, np.uint8)
        fractions = np.empty((3, pm.n_pixels), np.float32)
        sums, lost = np.empty((pm.n_elements, 3 * pm.conn.shape[1] + 3)), np.zeros(pm.n_elements, np.int64)
        for number in range(len(pm.blocks) - 1):
            span = slice(*pm.start[pm.blocks[number:number + 2]])
            voxels = self.voxels(number)
            self._pass(stack, frame, motion, layout, number, voxels, valid[span], sums, lost, r[span],
                       fractions[:, span])
            if coefficients is not None and len(coefficients):
                elements = slice(*pm.blocks[number:number + 2])
                patch = np.repeat(layout.patch[elements], pm.pixels_per_element[elements])
                gain, offset = np.asarray(coefficients, dtype=np.float32).reshape(-1, 2).T
                centred = voxels.f - (layout.mean[patch] - np.float32(self.level))
                r[span] += np.where(valid[span] > 0, gain[patch] * centred + offset[patch], np.float32(0))
        return r, valid.astype(bool), fractions

    def shows_nothing(self, equations: NodalEquations) -> bool:
        """Whether the scan has hardly any contrast in the specimen."""
        return contrast_ratio(equations) < MIN_CONTRAST_RATIO

    def visible_share(self, equations: NodalEquations) -> np.ndarray:
        """How much of the voxels around a node the scan shows, 0 … 1  # (n_nodes,)"""
        share = 1.0 - equations.lost / np.maximum(self.pixel_map.pixels_per_element, 1)
        return self.pixel_map.at_nodes(share[:, None, None])[:, 0, 0]

    def synthetic_image(self, r: np.ndarray):
        """Refused: no scan is made of a residual."""
        raise InputError("a residual of volumes as a scan", expected="images of a surface", found="volumes",
                         remedy="look at the sections of the residual in the report")

    @classmethod
    def of(cls, voxel_map: VoxelMap, stack: VolumeStack, frames: Sequence[int], degree: int = 3,
           lowpass_px: float = 0.0, border_px: int = 0, patch_px: float = 100.0) -> VolumeReference:
        """Attach the reference scans to the voxels.

        Parameters
        ----------
        frames : of the unmoved specimen; their mean is the reference
        degree : {3, 5}; lowpass_px : standard deviation of a Gaussian, voxels; border_px : left out along the borders
        patch_px : size of a patch of brightness, voxels

        Raises
        ------
        InputError
            Where the reference shows no contrast on the mesh.
        """
        pm, n_max = voxel_map, voxel_map.conn.shape[1]
        level = _level(pm, stack, frames)
        hessian = np.zeros((pm.n_elements, n_max * (n_max + 1) // 2, 6))
        coupling, grey = np.zeros((pm.n_elements, n_max, 3, 2)), np.zeros((pm.n_elements, 3))
        stored: dict[int, Voxels] = {}
        for number in range(len(pm.blocks) - 1):
            voxels = _voxels(pm, number, stack, frames, degree, lowpass_px, level)
            elements = np.arange(*pm.blocks[number:number + 2])
            _sums_of(pm, elements, pm.start[elements[0]], voxels, np.ones(len(voxels.f), np.uint8), hessian, coupling,
                     grey)
            if voxels.nbytes + sum(block.nbytes for block in stored.values()) <= KEPT_BYTES:
                stored[number] = voxels
        n, first, second = grey.sum(axis=0)
        if not second / n - (first / n) ** 2 > 0.0:
            raise InputError("the reference scan shows no contrast on the mesh", expected="a texture",
                             found=f"grey value {level:g} everywhere",
                             remedy="check the order of the scans and the scanner table")
        patches = {"none": np.zeros(pm.n_elements, dtype=np.int64), "frame": np.zeros(pm.n_elements, dtype=np.int64),
                   "patch": _patches(pm, patch_px)}
        pairs = pm.is_node[:, :, None] & pm.is_node[:, None, :]
        rows, columns = np.broadcast_arrays(pm.conn[:, :, None], pm.conn[:, None, :])
        pattern = block_pattern(rows, columns, pairs, pm.n_nodes, pm.n_nodes, 3)
        return cls(pm, stack, tuple(frames), degree, lowpass_px, border_px, level, hessian, coupling, grey,
                   pattern, {name: _layout(name, patch, pm, grey, level) for name, patch in patches.items()},
                   stored=stored)


_NOTHING, _NO_FRACTIONS = np.empty(0, np.float32), np.empty((3, 0), np.float32)


def volume_still_gain(std_px: float) -> float:
    """Variance of a blurred voxel over that of a voxel, of independent noise."""
    return float(np.sum(np.square(lowpass_weights(std_px)))) ** 3


def _layout(mode: str, patch: np.ndarray, voxel_map: VoxelMap, grey: np.ndarray, level: float) -> Brightness:
    n_patches = int(patch.max()) + 1
    mean = level + np.bincount(patch, grey[:, 1]) / np.maximum(np.bincount(patch, grey[:, 0]), 1.0)
    at = np.broadcast_to(patch[:, None], voxel_map.conn.shape)
    pattern = block_pattern(voxel_map.conn, at, voxel_map.is_node, voxel_map.n_nodes, n_patches, (3, 2))
    return Brightness(mode, patch.astype(np.int64), mean.astype(np.float32), pattern)


def _patches(voxel_map: VoxelMap, patch_px: float) -> np.ndarray:
    """Patches of about `patch_px` cubed  # (n_elements,)"""
    middle = voxel_map.middle.astype(float)
    low, extent = middle.min(axis=0), np.ptp(middle, axis=0) + 1.0
    n = np.maximum(1, np.rint(extent / patch_px)).astype(int)
    cell = np.minimum((middle - low) / extent * n, n - 1).astype(int)
    return np.unique((cell[:, 2] * n[1] + cell[:, 1]) * n[0] + cell[:, 0], return_inverse=True)[1]


def _level(voxel_map: VoxelMap, stack: VolumeStack, frames: Sequence[int]) -> float:
    """Mean grey value of some blocks of the reference: a number near all grey values keeps the digits of the sums."""
    number = (len(voxel_map.blocks) - 1) // 2
    low, high = voxel_map.boxes[number][:, ::-1]
    block = stack.block(frames[0], *(slice(int(a), int(b) + 1) for a, b in zip(low, high, strict=True)))
    return float(np.mean(block, dtype=np.float64))


def _voxels(voxel_map: VoxelMap, number: int, stack: VolumeStack, frames: Sequence[int], degree: int,
            lowpass_px: float, level: float) -> Voxels:
    """The reference at the voxels of a block, from the voxels of the scans around them."""
    low, high = voxel_map.boxes[number][0, ::-1], voxel_map.boxes[number][1, ::-1] + 1
    blur = np.array(lowpass_weights(lowpass_px), dtype=np.float32)
    taps = (degree - 1) // 2  # beside a voxel, that have a part in its slope
    begin, stop = _with_reach(low - taps, high + taps, degree, stack.shape, mirrors=len(blur) == 1)
    halo = len(blur) // 2
    block: np.ndarray | None = None
    for frame in frames:
        scan = mirrored_block(lambda *at, frame=frame: stack.block(frame, *at), stack.shape, begin - halo, stop + halo)
        block = scan if block is None else np.add(block, scan, dtype=np.float32)
    if len(frames) > 1:
        block = block / np.float32(len(frames))
    for axis in range(3):
        block = filtered(block, blur, axis)
    inner = tuple(slice(a, b) for a, b in zip(low - begin, high - begin, strict=True))
    f = np.subtract(block[inner], np.float32(level), dtype=np.float32)
    slopes = slopes_in(block, level, degree, tuple((low - begin).tolist()), f.shape)
    first, end = voxel_map.run_start[voxel_map.blocks[number:number + 2]]
    run = voxel_map.run[first:end]
    values = [np.empty(int(run[:, 3].sum()) + LANES, dtype=np.float32) for _ in range(4)]  # vectors read beyond the end
    for part, out in zip((f, *slopes), values, strict=True):
        _gather(part.reshape(-1), np.array(part.shape), run, low, out)
        out[-LANES:] = 0.0
    return Voxels(*(out[:-LANES] for out in values))


def _coefficients(voxel_map: VoxelMap, number: int, stack: VolumeStack, frame: int, motion: np.ndarray, degree: int,
                  lowpass_px: float, border: int,
                  level: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Spline coefficients of a scan where a block of voxels may be, their box, and the places that are inside.

    # flat float32; (8,) int32 first place with all taps and number of such places (column, row, slice), entries of a
    row and of a slice; (3,), (3,) int32
    """
    span = slice(*voxel_map.blocks[number:number + 2])
    farthest = np.array(voxel_map.shape)[::-1] - 1
    u = motion[span]
    spread = np.abs(u[:, :, 1:]).sum(axis=2)  # no place in a cell is beyond 1
    low_u, high_u = (u[:, :, 0] - spread).min(axis=0), (u[:, :, 0] + spread).max(axis=0)
    first = np.clip(np.floor(voxel_map.boxes[number, 0] + low_u) - 1, 0, farthest).astype(np.int64)
    end = np.clip(np.ceil(voxel_map.boxes[number, 1] + high_u) + 1, first, farthest).astype(np.int64)
    blur = np.array(lowpass_weights(lowpass_px), dtype=np.float32)
    low, high = (first - (degree - 1) // 2)[::-1], (end + (degree + 1) // 2 + 1)[::-1]  # with taps below and above
    begin, stop = _with_reach(low, high, degree, stack.shape, mirrors=len(blur) == 1)
    halo = len(blur) // 2
    block = mirrored_block(lambda *at: stack.block(frame, *at), stack.shape, begin - halo, stop + halo)
    for axis in range(3):
        block = filtered(block, blur, axis)
    nx, ny = (end - first + degree + 1)[:2].tolist()
    flat = coefficients_in(block, level, degree, tuple((low - begin).tolist()), tuple((high - low).tolist()),
                           _TAPS_BEYOND + (degree + 1) * nx)
    box = np.array([*first, *(end - first + 1), nx, nx * ny], dtype=np.int32)
    low_inside, high_inside = np.full(3, border, np.int32), (farthest - border).astype(np.int32)
    return flat, box, low_inside, high_inside


def _with_reach(low: np.ndarray, high: np.ndarray, degree: int, shape: tuple[int, int, int], mirrors: bool
                ) -> tuple[np.ndarray, np.ndarray]:
    """A block with what its spline filter reaches; mirrors : whether the filter may end with the volume"""
    begin, stop = low - REACH[degree], high + REACH[degree]
    if mirrors:
        begin = np.where(low >= 0, np.maximum(begin, 0), begin)
        stop = np.where(high <= shape, np.minimum(stop, shape), stop)
    return begin, stop


def _sums_of(voxel_map: VoxelMap, elements: np.ndarray, begin: int, voxels: Voxels, valid: np.ndarray,
             hessian: np.ndarray, coupling: np.ndarray, grey: np.ndarray) -> None:
    pm = voxel_map
    element_sums(elements, begin, pm.kind, N_SOLID_NODES, TRANSFORMS, pm.run_start, pm.run, pm.start, pm.affine,
                 pm.middle, pm.places, pm.table_start, pm.table, voxels.f, voxels.gx, voxels.gy, voxels.gz, valid,
                 hessian, coupling, grey)


@njit(cache=True, nogil=True)
def _gather(block, shape, run, low, out):
    """Values at the voxels of runs  # block of `shape` (z, y, x), flat, low (3,) its first slice, row, column"""
    k, rows, columns, size = 0, shape[1], shape[2], block.size
    low_z, low_y, low_x = low[0], low[1], low[2]
    for j in range(run.shape[0]):
        source = ((run[j, 2] - low_z) * rows + run[j, 1] - low_y) * columns + run[j, 0] - low_x
        ahead = min(j + 16, run.shape[0] - 1)
        early = ((run[ahead, 2] - low_z) * rows + run[ahead, 1] - low_y) * columns + run[ahead, 0] - low_x
        fetch_early(block, early)
        fetch_early(block, early + run[ahead, 3])
        length, i = np.int64(run[j, 3]), 0
        while i < length:  # what is copied beyond the run is written over by the next one
            if source + i + LANES <= size:
                copy_eight(block, source + i, out, k + i)
            else:
                for m in range(i, length):
                    out[k + m] = block[source + m]
            i += LANES
        k += length


def volume_reference(voxel_map: VoxelMap, experiment: Experiment) -> VolumeReference:
    """The reference of an experiment, with interpolation, low-pass and patches of its options."""
    options, recording = experiment.options, experiment.recording
    return VolumeReference.of(voxel_map, recording.volumes, recording.averaged or (experiment.model.reference,),
                              DEGREES[options.interpolation], options.lowpass_px, options.border_px,
                              options.patch_px)
