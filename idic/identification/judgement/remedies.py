"""Remedies for light and aliasing, tried at the accepted motion: one image pass over a few frames each, no simulation.

A model that follows the images as well as a free motion does, with a residual above noise, lacks nothing mechanical.
What the images lack is tried: gain and offset by patches, smaller patches, a better interpolant, a stronger low-pass.
χ² at the same motion tells which of them removes the residual.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.correlation import build_experiment_reference
from idic.images import Camera
from idic.model import Experiment, Options

SMALLER_PATCHES = 0.5  # of the present patches
MIN_PATCH_PX = 30.0  # below, gain and offset take the pattern itself
STRONGER_LOWPASS_PX = 1.0


@dataclass(frozen=True)
class Remedy:
    """One setting and its effect: χ² per pixel of the frames tried, before and after."""

    setting: str
    chi2_before: float
    chi2_after: float

    @classmethod
    def tried(cls, experiment: Experiment, camera: Camera, frames: Sequence[int],
              motion: Callable[[int], np.ndarray]) -> tuple[Remedy, ...]:
        """χ² of some frames with every remedy, at a given motion.

        Parameters
        ----------
        experiment : view of one camera, grey images, noise known
        motion : frame -> displacement of the nodes in the image (n_nodes, 2) px
        """
        initial_chi2 = chi2_at(experiment, camera, frames, motion)
        return tuple(cls(setting, initial_chi2, chi2_at(replace(experiment, options=options), camera, frames, motion))
                     for setting, options in remedies(experiment.options))


def remedies(options: Options) -> Iterator[tuple[str, Options]]:
    """Settings to try, as they are written under [options], and the options with each."""
    if options.defocus == "none":
        if options.brightness != "patch":
            yield f'brightness = "patch", patch_px = {options.patch_px:g}', replace(options, brightness="patch")
        smaller = SMALLER_PATCHES * options.patch_px
        if smaller >= MIN_PATCH_PX:
            yield (f'brightness = "patch", patch_px = {smaller:g}',
                   replace(options, brightness="patch", patch_px=smaller))
    if options.interpolation != "quintic":
        yield 'interpolation = "quintic"', replace(options, interpolation="quintic")
    if options.lowpass_px < STRONGER_LOWPASS_PX:
        yield f"lowpass_px = {STRONGER_LOWPASS_PX:g}", replace(options, lowpass_px=STRONGER_LOWPASS_PX)


def chi2_at(experiment: Experiment, camera: Camera, frames: Sequence[int],
            motion: Callable[[int], np.ndarray]) -> float:
    """Mean χ² per pixel of some frames, brightness fitted in each."""
    reference = build_experiment_reference(experiment, camera)
    chi2, pixels = 0.0, 0
    for frame in frames:
        u = motion(frame)
        fit = reference.compare(experiment, frame, u).brightness_fit()
        residual = reference.compare_pixels(experiment, frame, u, fit.coefficients)
        n = int(residual.valid.sum())
        if n:
            # unknowns of the brightness take their share of the noise, which matters with many patches
            chi2 += n * residual.chi2_dof(experiment.recording.noise.std_gv) * n / max(n - len(fit.coefficients), 1)
            pixels += n
    return chi2 / pixels if pixels else float("nan")
