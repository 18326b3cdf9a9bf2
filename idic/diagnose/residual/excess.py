"""Is there anything that noise does not explain? Three tests, and a margin below which nothing is called a mismatch.

omnibus    every pixel's white residual against the variance that noise leaves there: sees everything, weakly
whiteness  a mismatch of motion is smooth: m = r df/dx resembles itself some pixels further on, noise does not;
           r (f - mean) and r itself tell of lighting instead; runs of one sign in the channels
directed   the drop of chi-square under free motion, by far the strongest

With 10^8 pixels everything is significant through interpolation alone, so that every figure comes with its size as a
motion in pixels, and the practical margin (`idic.diagnose.residual.margin`) is what a recording must exceed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from idic.diagnose.residual.evidence import Evidence
from idic.diagnose.residual.grey_value_effects import sums_against
from idic.diagnose.residual.margin import ASSUMED, Margin
from idic.diagnose.residual.residual_evidence import CameraResidual, ResidualEvidence
from idic.identification import z_text

LAGS_PX = (6, 10, 14, 20)  # beyond the reach of interpolation and low-pass
# neighbouring products are alike through interpolation and low-pass: variance of their sum
PRODUCT_VARIANCE_FACTOR = 4.0
MAX_TESTED_FRAMES = 12  # at most, spread over the recording


@dataclass(frozen=True)
class ExcessTest:
    """One test of excess. p_value : of noise alone; words : in a sentence."""

    name: str
    p_value: float
    words: str


def p_beyond_margin(gain, rank, margin):
    """Probability of this drop of chi-square from noise and a motion of chi-square `margin` (Patnaik 1949)."""
    gain, rank, margin = np.asarray(gain, float), np.asarray(rank, float), np.asarray(margin, float)
    spread = (rank + 2.0 * margin) / (rank + margin)
    return stats.chi2.sf(gain / spread, (rank + margin) / spread)


def margin_chi2(evidence: Evidence, margin: Margin = ASSUMED) -> np.ndarray:
    """Chi-square per frame of a motion at the margin, weighed by how well pixels see it  # (T,)"""
    if margin.floor is None:
        return margin.px**2 * power(evidence)
    return power(evidence, margin.nodes_px(evidence.back.shape[1]))


def power(evidence: Evidence, size_px: np.ndarray | None = None) -> np.ndarray:
    """Chi-square of a motion of one px (rms) in each frame: sum |grad f|^2 / 2 sigma^2  # (T,)

    Heights count as the motion in the image that would change as much; of a cross-section rows see no motion.

    From nodal sums of one component at a time, of which shape functions add up to one.

    size_px : (n_nodes,) motion of every node in the place of one px
    """
    node, component = np.divmod(evidence.seen, evidence.n_components)
    planes, sums = seen_planes(evidence), []
    size = np.ones(len(node)) if size_px is None else size_px[node]
    for part in evidence.parts:
        moved = [np.where(component == k, size, 0.0) for k in planes]
        sums.append(sum(float(motion[component == k] @ (part.A @ motion)[component == k])
                        for k, motion in zip(planes, moved, strict=True)) / len(planes))
    return np.array(sums)


def seen_planes(evidence: Evidence) -> tuple[int, ...]:
    """Directions in the image along which motion is seen: columns and rows, of a cross-section columns alone, of a
    volume slices, too."""
    return tuple(k for k in range(evidence.n_axes) if k in evidence.seen % evidence.n_components)


def pixel_tests(residual: ResidualEvidence) -> tuple[ExcessTest, ...]:
    """Omnibus and whiteness from one more look at some frames' pixels, runs from the channels.

    Grey images only have the whiteness test; heights and sections the omnibus; volumes, whose voxels are many and
    whose correlation is measured otherwise (`idic.images.quality.volume_noise`), runs alone.
    """
    runs = [_runs(residual.evidence, k) for k in range(len(residual.evidence.channel_weight))]
    if residual.evidence.n_axes == 3:
        return tuple(runs)
    sums = _Sums()
    chosen = np.unique(np.linspace(0, len(residual.evidence.parts) - 1, MAX_TESTED_FRAMES).astype(int))
    for index in chosen:
        for camera in residual.cameras:
            sums.add(*_white_pixels(residual, camera, int(index)), camera)
    tests = [sums.omnibus(), *sums.whiteness()]
    return tuple(tests + runs)


def _white_pixels(residual: ResidualEvidence, camera: CameraResidual, index: int) -> tuple[np.ndarray, np.ndarray]:
    """White residual in standard deviations of noise at each pixel, and the mask of counted pixels."""
    evidence, context = residual.evidence, camera.context
    frame, nodes = int(evidence.frames[index]), context.experiment.model.mesh.nodes
    motion = camera.view.at(frame).motion(nodes, camera.turned(residual.u[index]))
    nodal, kappa, c = context.reference.compare(context.experiment, frame, motion), evidence.kappa, evidence.share
    fit = np.zeros(0)
    if nodal.n_brightness:  # of the white frame: what all frames share has a brightness of its own
        fit = np.linalg.pinv(nodal.bb, hermitian=True) @ (nodal.rb - c * sums_against(context, camera.shared_gv)[1])
    pixels = context.reference.compare_pixels(context.experiment, frame, motion, fit)
    white = (pixels.r - c * camera.shared_gv) / np.sqrt(kappa[index])
    k = float(np.sum(1.0 / kappa))
    noise = (pixels.noise_gain * (1.0 - c / kappa[index]) ** 2
             + c**2 * (k - 1.0 / kappa[index]) * pixels.noise_gain.mean())
    variance = (noise + pixels.reference_gain / pixels.n_images * (1.0 - c * k) ** 2) / kappa[index]
    return white / np.sqrt(variance) / context.experiment.recording.noise.std_gv, pixels.valid


class _Sums:
    """Lag products of maps, collected over frames."""

    def __init__(self):
        self.squares = self.n = self.effective = 0.0
        self.products = {name: np.zeros(2) for name in ("motion", "gain", "offset")}  # sum m m', sum m^2 m'^2

    def add(self, r: np.ndarray, valid: np.ndarray, camera: CameraResidual) -> None:
        self.squares += float((r[valid] ** 2).sum())
        self.n += float(valid.sum())
        image = _image(camera, np.where(valid, r, 0.0))
        neighbour = [float((a * b).sum() / max((image**2).sum(), 1e-300)) for a, b in _pairs(image, 1)]
        self.effective += valid.sum() / (1.0 + 2.0 * neighbour[0] ** 2) / (1.0 + 2.0 * neighbour[1] ** 2)
        patterns = camera.context.reference.pattern_maps()
        maps = {name: [image * _image(camera, values) for values in patterns[name]] for name in patterns}
        if maps:
            maps["offset"] = [image]
        for name, fields in maps.items():
            total = self.products[name]
            for field in fields:
                for lag in LAGS_PX:
                    for a, b in _pairs(field, lag):
                        total += [(a * b).sum(), ((a * b) ** 2).sum()]

    def omnibus(self) -> ExcessTest:
        ratio = self.squares / max(self.n, 1.0)
        z = (ratio - 1.0) / np.sqrt(2.0 / max(self.effective, 1.0))
        return ExcessTest("omnibus", float(stats.norm.sf(z)),
                    f"chi-square per pixel is {ratio:.4f} of what noise leaves ({z_text(float(z))} standard "
                    f"deviations)")

    def whiteness(self) -> list[ExcessTest]:
        words = {"motion": "the residual times the gradient is correlated over several pixels: motion is left",
                 "gain": "the residual times the brightness is correlated over several pixels: a gain is left",
                 "offset": "the residual is correlated over several pixels: an offset is left"}
        tests = []
        for name, (total, squares) in self.products.items():
            if squares > 0.0:
                z = total / np.sqrt(squares * PRODUCT_VARIANCE_FACTOR)
                tests.append(ExcessTest(f"whiteness, {name}", float(stats.norm.sf(z)),
                                  words[name] if z > 3.0 else f"no {name} is left that neighbouring pixels share"))
        return tests


def _image(camera: CameraResidual, values: np.ndarray) -> np.ndarray:
    return np.nan_to_num(camera.context.reference.pixel_map.to_image(values))


def _pairs(field: np.ndarray, lag: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """A map and its copy, shifted along both axes."""
    return [(field[:, lag:], field[:, :-lag]), (field[lag:], field[:-lag])]


def _runs(evidence: Evidence, channel: int) -> ExcessTest:
    """Wald-Wolfowitz: how often the residual of a channel changes its sign."""
    signs = np.sign([evidence.residual(part)[1][channel] for part in evidence.parts])
    up, down = int((signs > 0).sum()), int((signs < 0).sum())
    n, runs = up + down, 1 + int((np.diff(signs[signs != 0]) != 0).sum())
    if min(up, down) == 0 or n < 8:
        return ExcessTest("runs", 1.0 if n < 8 else 2.0 ** (1 - n), "the force residual keeps one sign")
    mean = 1.0 + 2.0 * up * down / n
    variance = (mean - 1.0) * (mean - 2.0) / (n - 1)
    z = (runs - mean) / np.sqrt(variance)
    return ExcessTest("runs", float(stats.norm.cdf(z)), f"{runs} runs of one sign where {mean:.1f} are expected")
