"""Height images of a cross-section: a frame against the reference image, from sums over the rows of every column.

    r = f + h - g(x + u),      L = g_x u' - h',      g_x = (f_x + dh/dx) / (1 + du/dx)

(docs/method.md, equation 9.5) for sensitivities u' (along the section, px) and h' (height). u and h depend on the
image column only, so M and b need the column sums of 1, f_x, f_x^2, r and r f_x and no more. Degrees of freedom are
``3 node + component`` as for any height image; the second component (across the section) has no information.

Levelling takes the place of brightness: an offset of the whole "frame", or its "tilt" (offset and two slopes).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from idic.correlation.image_equations.comparison import NoiseTerms
from idic.correlation.image_equations.frame import FrameGram, NodalEquations
from idic.correlation.image_equations.residual import ResidualMap
from idic.correlation.pixels.section_map import RIM_PX, SectionMap
from idic.correlation.height.section_nodes import (LEVELLING, ColumnSums, SectionMotion, column_sums, levelling_blocks,
                                                   nodal_sums, section_motion)
from idic.correlation.height.section_pass import (N_SUMS, from_blocks, poles, section_residuals, section_sums,
                                                  tap_weights, to_blocks)
from idic.errors import InputError
from idic.images import REACH_STDS, lowpass, lowpass_weights, noise_gain, prefilter, still_gain
from idic.model import Experiment

_GAP_MARGIN_PX = 8  # px on either side of a missing height whose spline coefficients it changes


@dataclass(frozen=True, eq=False)
class SectionReference:
    """The reference height image on the columns of a section, rows turned into blocks (`section_pass`).

    f, fx, w : arrays (n_blocks, n_columns, LANES), float32: height less `level`, its slope along the section (per px),
    1 for pixels in the ROI.  y : (n_blocks, LANES).  x : (n_columns,) column in half image widths from the middle.
    """

    pixel_map: SectionMap
    f: np.ndarray
    fx: np.ndarray
    w: np.ndarray
    y: np.ndarray
    x: np.ndarray
    sums: ColumnSums
    level: float
    degree: int
    lowpass_px: float = 0.0
    n_images: int = 1
    n_components = 3
    is_section = True

    @property
    def contrast(self) -> float:
        """Standard deviation of f in the ROI."""
        inside = self.w > 0
        return float(np.std(self.f[inside], dtype=np.float64))

    @property
    def image(self) -> SectionReference:
        """Itself."""
        return self

    def compare(self, experiment: Experiment, frame: int, motion: np.ndarray) -> NodalEquations:
        """Nodal equations of one frame under a nodal motion (n_nodes, 3)."""
        return self.equations(experiment.recording.stack.frame(frame), motion, experiment.options.brightness)

    def compare_pixels(self, experiment: Experiment, frame: int, motion: np.ndarray,
                       coefficients: np.ndarray) -> ResidualMap:
        """Residual of every pixel; coefficients : (nb,) levelling."""
        return self.residual_map(experiment.recording.stack.frame(frame), motion,
                                 experiment.options.brightness,
                                 coefficients)

    def shows_nothing(self, equations: NodalEquations) -> bool:
        """No: heights have no brightness."""
        return False

    def noise_terms(self, equations: NodalEquations, columns: np.ndarray, projected: FrameGram) -> NoiseTerms:
        """The columns alone: there are no generalised least squares of cross-sections."""
        return NoiseTerms(self.shared_columns(equations, columns, equations.n_brightness))

    def pattern_maps(self) -> Mapping[str, tuple[np.ndarray, ...]]:
        """None of heights."""
        return {}

    def synthetic_image(self, r: np.ndarray) -> tuple[np.ndarray, SectionReference]:
        """An image with the residual r (n_pixels,) at rest  # (ny, nx), and this reference without low-pass"""
        pm = self.pixel_map
        image = pm.to_image(from_blocks(self.f, pm.shape[0])[pm.valid] - r)
        return np.where(np.isnan(image), 0.0, image) + self.level, replace(self, lowpass_px=0.0)

    def shared_columns(self, equations: NodalEquations, columns: np.ndarray, n_brightness: int) -> np.ndarray:
        """Columns of one frame as multiples of f_x and of 1, image column by image column; they add over the frames.

        ``L = (f_x + dh/dx) / (1 + du/dx) u' - h' = a f_x + c``: the noise of the reference image multiplies their sum.

        Parameters
        ----------
        columns : array (3 n_nodes, m)

        Returns
        -------
        array (2 n_columns + nb, m + nb) : a, c and the levelling columns.
        """
        pm, moved = self.pixel_map, equations.motion
        fields = pm.at_columns(columns.reshape(pm.n_nodes, 3, -1)[:, [0, 2]])  # (n_columns, 2, m)
        along = (pm.side / moved.stretch)[:, None] * fields[:, 0]
        n, m = pm.n_columns, columns.shape[1]
        shared = np.zeros((2 * n + n_brightness, m + n_brightness))
        shared[:n, :m] = along
        shared[n:2 * n, :m] = moved.dh[:, None] * along - fields[:, 1]
        shared[2 * n:, m:] = np.eye(n_brightness)
        return shared

    def pull_back(self, equations: NodalEquations) -> np.ndarray:
        """What takes a nodal field of a frame to the reference  # (n_nodes, 3, 3)"""
        return equations.motion.pull_back

    def shared_gram(self, experiment: Experiment, shared: np.ndarray) -> tuple[np.ndarray, int]:
        """S^T S of summed `shared_columns`, the first rows of `shared`; the Gram matrix and the number of those
        rows."""
        n_rows = 2 * self.pixel_map.n_columns + LEVELLING[experiment.options.brightness]
        return self.gram_of(shared[:n_rows]), n_rows

    def gram_of(self, shared: np.ndarray) -> np.ndarray:
        """S^T S over the pixels of the reference, S from summed `shared_columns`  # (n, n)"""
        n = self.pixel_map.n_columns
        a, c, levels = shared[:n], shared[n:2 * n], shared[2 * n:]
        constants = -np.stack([np.ones(n), self.x, np.zeros(n)])[:len(levels)].T @ levels  # (n, m) multiples of 1
        c = c + constants
        d = -np.broadcast_to(levels[2], c.shape) if len(levels) == 3 else np.zeros_like(c)  # multiples of y
        s = self.sums
        squares = a.T @ (s.fxfx[:, None] * a) + c.T @ (s.count[:, None] * c) + d.T @ (s.yy[:, None] * d)
        cross = a.T @ (s.fx[:, None] * c) + a.T @ (s.yfx[:, None] * d) + c.T @ (s.y[:, None] * d)
        return squares + cross + cross.T

    def equations(self, image: np.ndarray, motion: np.ndarray,
                  levelling: str = "none") -> NodalEquations:
        """Compare one height image with the reference under a nodal motion.

        Parameters
        ----------
        image : array (ny, nx)
            The frame as recorded; heights that are not finite are left out, with their surroundings along the row.
        motion : array (n_nodes, 3)
            Column and row displacement (px) and height of the nodes.
        levelling : "none" | "frame" | "tilt"
            Unknown heights of the whole frame; their columns take the place of brightness.
        """
        pm = self.pixel_map
        moved = section_motion(pm, motion)
        frame = _Frame.of(self, image, moved)
        sums = np.empty((pm.n_columns, N_SUMS))
        section_sums(frame.image, np.float32(frame.level), poles(self.degree), frame.first, frame.weights, frame.shift,
                     self.f, self.fx, frame.w, self.y, sums)
        visible = frame.first >= 0
        sides = self.sums if frame.valid is pm.valid else _frame_sums(self, frame.valid)
        total = sides.seen(visible)
        q, matrix = nodal_sums(pm, moved, sums, total)
        hb, bb, rb = levelling_blocks(pm, self.x, moved, sums, total, levelling)
        n_valid = int(total.count.sum())
        lost, lost_pixels = _lost(pm, frame.valid, visible)
        return NodalEquations(q, matrix, hb, bb, rb, float(sums[:, 2].sum()), n_valid, pm.n_pixels - n_valid, lost,
                          lost_pixels, np.bincount(pm.edge, sums[:, 2], pm.n_elements),
                          float((total.count / moved.stretch).sum() / max(n_valid, 1)), motion=moved)

    def residual_map(self, image: np.ndarray, motion: np.ndarray, levelling: str = "none",
                     coefficients: np.ndarray | None = None) -> ResidualMap:
        """Residual pixel by pixel, the levelling `coefficients` (nb,) removed; arguments as of `equations`."""
        pm = self.pixel_map
        frame = _Frame.of(self, image, section_motion(pm, motion))
        r = np.empty_like(self.f)
        section_residuals(frame.image, np.float32(frame.level), poles(self.degree), frame.first, frame.weights,
                          frame.shift, self.f, frame.w, r)
        r = from_blocks(r, pm.shape[0])
        valid = frame.valid & (frame.first >= 0)
        if coefficients is not None and len(coefficients):
            y = from_blocks(self.y[:, None], pm.shape[0])[:, 0]
            levels = [np.ones((1, pm.n_columns)), self.x[None, :], y[:, None]]
            r = r + sum(c * level for c, level in zip(coefficients, levels[:LEVELLING[levelling]], strict=True))
        across = float(np.sum(np.square(lowpass_weights(self.lowpass_px))))
        gain = across * noise_gain(frame.fraction, degree=self.degree, lowpass_px=self.lowpass_px)
        return ResidualMap(np.where(valid, r, 0.0)[pm.valid].astype(np.float32), valid[pm.valid],
                           np.broadcast_to(gain, pm.valid.shape)[pm.valid], still_gain(self.lowpass_px))


def build_section_reference(section_map: SectionMap, image: np.ndarray, degree: int = 5,
                            lowpass_px: float = 0.0) -> SectionReference:
    """Attach the reference height image to the columns of a section; pixels that are not finite leave the ROI.

    Raises
    ------
    InputError
        Where the image has another size than the map, or is flat or missing throughout.
    """
    pm = section_map
    _check_size(pm, image)
    filled, missing = _without_gaps(np.asarray(image), pm.shape, lowpass_px)
    valid = pm.valid if missing is None else pm.valid & ~missing[:, pm.column]
    inside = filled[:, pm.column][valid]
    if len(inside) == 0 or np.ptp(inside) == 0:
        raise InputError("the reference image shows no roughness on the section", expected="a rough surface",
                         found="no finite height" if len(inside) == 0 else f"height {inside[0]:g} everywhere",
                         remedy="check the reference image, the camera table and the mask")
    level = float(inside.mean(dtype=np.float64))
    blurred = (lowpass(filled, lowpass_px) - level).astype(np.float32)
    iy, ix = (a.ravel().astype(np.int32) for a in np.meshgrid(np.arange(pm.shape[0]), pm.column, indexing="ij"))
    fx = prefilter(blurred, degree).gradient_at_pixels(ix, iy)[0].reshape(pm.shape[0], -1)
    y = (np.arange(pm.shape[0]) - 0.5 * (pm.shape[0] - 1)) / (0.5 * pm.shape[0])
    valid_map = replace(pm, valid=valid)
    return SectionReference(
        valid_map, to_blocks(blurred[:, pm.column]), to_blocks(fx), to_blocks(valid),
        to_blocks(y[:, None])[:, 0].copy(), (pm.column - 0.5 * (pm.shape[1] - 1)) / (0.5 * pm.shape[1]),
        column_sums(fx, valid, y), level, degree, lowpass_px)


def _lost(pm: SectionMap, valid: np.ndarray, visible: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lost pixels per edge (n_elements,), and which they are (n_lost,)."""
    if valid is pm.valid and visible.all():
        return np.zeros(pm.n_elements, dtype=np.int64), np.zeros(0, dtype=np.int64)
    if valid is pm.valid:
        columns = np.flatnonzero(~visible)
        lost = pm.valid[:, columns]
    else:
        columns = np.arange(pm.n_columns)
        lost = pm.valid & ~(valid & visible)
    per_edge = np.bincount(pm.edge[columns], lost.sum(axis=0), pm.n_elements)
    return per_edge.astype(np.int64), pm.numbers[:, columns][lost]


@dataclass(frozen=True, eq=False)
class _Frame:
    """A frame ready for the pass; `valid` is the map's own array where every height is there."""

    image: np.ndarray
    level: float
    first: np.ndarray
    weights: np.ndarray
    fraction: np.ndarray
    shift: np.ndarray
    w: np.ndarray
    valid: np.ndarray

    @classmethod
    def of(cls, reference: SectionReference, image: np.ndarray, moved: SectionMotion) -> _Frame:
        pm = reference.pixel_map
        _check_size(pm, image)
        filled, missing = _without_gaps(np.asarray(image), pm.shape, reference.lowpass_px)
        filled = np.ascontiguousarray(lowpass(filled, reference.lowpass_px), dtype=np.float32)
        position = np.clip(pm.column + moved.u, -1e6, 1e6)
        first, weights, fraction = tap_weights(position, reference.degree, (RIM_PX, pm.shape[1] - 1 - RIM_PX))
        level = float(filled.mean())  # heights far above the roughness would cost digits
        shift = (moved.h + (reference.level - level)).astype(np.float32)
        if missing is None:
            return cls(filled, level, first, weights, fraction, shift, reference.w, pm.valid)
        at = np.clip(np.rint(position), 0, pm.shape[1] - 1).astype(int)
        valid = pm.valid & ~missing[:, at]
        return cls(filled, level, first, weights, fraction, shift, to_blocks(valid), valid)


def _check_size(section_map: SectionMap, image: np.ndarray) -> None:
    if np.shape(image) != section_map.shape:
        raise InputError("a height image differs in size from the images the section was placed on",
                         expected=str(section_map.shape), found=str(np.shape(image)),
                         remedy="give every height image the same number of pixels")


def _without_gaps(image: np.ndarray, shape, lowpass_px: float) -> tuple[np.ndarray, np.ndarray | None]:
    """Heights that are not finite filled along their row, and pixels that this changes  # (ny, nx) each; None: none

    A row without any takes the mean of the others. lowpass_px : by which the filled image will be smoothed, across
    rows, too
    """
    if np.isfinite(image.sum()):
        return image, None
    gap = ~np.isfinite(image)
    filled, columns = np.array(image, dtype=np.float32), np.arange(shape[1])
    mean = float(image[~gap].mean()) if not gap.all() else 0.0
    for row in np.flatnonzero(gap.any(axis=1)):
        finite = ~gap[row]
        filled[row, gap[row]] = (np.interp(columns[gap[row]], columns[finite], image[row, finite]) if finite.any()
                                 else mean)
    if lowpass_px > 0.0:
        from scipy import ndimage  # here: an identification begins sooner

        reach = int(np.ceil(REACH_STDS * lowpass_px))
        gap = ndimage.maximum_filter(gap, 2 * reach + 1, mode="constant")
    changed = np.cumsum(np.pad(gap, ((0, 0), (_GAP_MARGIN_PX + 1, _GAP_MARGIN_PX))), axis=1)
    return filled, changed[:, 2 * _GAP_MARGIN_PX + 1:] > changed[:, :-2 * _GAP_MARGIN_PX - 1]


def _frame_sums(reference: SectionReference, valid: np.ndarray) -> ColumnSums:
    ny = reference.pixel_map.shape[0]
    return column_sums(from_blocks(reference.fx, ny), valid, from_blocks(reference.y[:, None], ny)[:, 0])
