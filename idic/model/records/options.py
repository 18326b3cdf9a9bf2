"""How a model is compared with a recording and how its parameters are searched for."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Options:
    """How to solve; every entry has a default that suits most tests."""

    interpolation: str = "quintic"  # quintic | cubic: four times less sub-pixel bias, and images are never the cost
    lowpass_px: float = 0.6  # Gaussian blur of every image against aliasing; 0 = none
    camera_blur_px: float = 12**-0.5  # std of the camera's own blur: the area of a pixel, and of the lens what is known
    border_px: int = 0  # left out along the borders of every image, where low-pass and spline mirror it; a file has 4
    edge_margin_px: int = 3  # pixels left out along the edges of the mesh: a step in the image has no sub-pixel value
    left_out_px: tuple[tuple[float, float, float], ...] = ()  # circles (column, row, radius) of the reference image
    element_order: str = "auto"  # auto (tri3, quad4 are computed as tri6, quad8) | as_given | quadratic
    brightness: str = "frame"  # none | frame | patch
    patch_px: float = 100.0
    defocus: str = "none"  # none | frame: the variance of a blur is an unknown of every frame
    method: str = "integrated"  # integrated | two_step | two_step_unweighted (`idic.identification.free_motion`)
    dic_regularisation: str = "auto"  # of free FE-DIC: none | mechanical | gradient; auto: mechanical, two steps none
    weighting: str = "noise"  # noise | paper
    estimator: str = "auto"  # auto | ordinary | generalised least squares: see `idic.identification.step.estimator`
    alpha: float = 0.01
    step_limit: float | None = None  # relative; the paper's weighting uses 0.05
    trial_steps: int = 1  # of a damped or limited step, evaluated in parallel
    max_iterations: int = 40
    search: str = "auto"  # auto | never: better starts are looked for where a law needs it (`start_search`)
    schedule: str = "all"  # all | spectrum: weak directions locked until the strong ones stand
    tolerance: float = 0.02  # stop when the scaled step is this small a part of the standard deviations
    # FE increments per frame (before any cutting); None: 1, or chosen (`idic.identification.step.increments`)
    substeps: int | None = None
    perturbation: float = 1e-4
    locking: str = "auto"  # auto (mean dilatation where it is needed) | none | mean_dilatation

    @property
    def is_two_step(self) -> bool:
        """Whether the motion is measured first and the model fitted to it afterwards."""
        return self.method != "integrated"


@dataclass(frozen=True)
class Stage:
    """One entry of a schedule: these names are free, the others locked.

    lowpass_px : blur of the images in this stage; until_s : end of the frames that it compares
    (`idic.identification.step.schedule`).
    """

    free: tuple[str, ...] | str  # names or "all"
    max_iterations: int | None = None
    lowpass_px: float | None = None
    until_s: float | None = None
