"""A free FE-DIC on the images of a finished run: its distance from the simulated motion, and its noise floor."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from idic.correlation import FieldReference, frame_spline, residual_map
from idic.measure import Seen, dic_frame, field_frame, fitted_dof, residual_noise
from idic.report.result.record import FreeFields, NoiseFloor, Sensitivities

SEED = 20  # of the noise of the still image


@dataclass(frozen=True)
class FreeMotions:
    """A free FE-DIC of some frames, without its residual maps; see `idic.report.result.record.FreeFields`.

    Attributes
    ----------
    u_full_px : (n_frames, n_nodes, 2) px
        The displacement with values at unseen nodes, too.
    brightness : (n_frames, n_coefficients)
    """

    frames: tuple[int, ...]
    difference_px: np.ndarray
    u_full_px: np.ndarray
    brightness: np.ndarray
    chi2_dof: np.ndarray
    length_px: float

    @classmethod
    def of(cls, inputs: Seen, frames: Sequence[int], motion: Callable[[int], np.ndarray]) -> FreeMotions | None:
        """Free displacement of some frames, started from the simulated one.

        motion : frame -> simulated displacement of the nodes in the image  # (n_nodes, 2) px
        """
        brightness, variance = inputs.experiment.options.brightness, inputs.experiment.recording.noise.std_gv**2
        differences, full, coefficients, chi2 = [], [], [], []
        for frame in frames:
            u = motion(frame)
            if isinstance(inputs.reference, FieldReference):
                fit = field_frame(inputs.reference, inputs.reference.measured(inputs.experiment, frame),
                                  inputs.smoother)
                if fit is None:
                    return None
                chi2.append(fit.field_variance(inputs.reference, fitted_dof(fit)) / variance)
            else:
                spline = frame_spline(inputs.experiment, frame)
                fit = dic_frame(inputs.reference, spline, u, inputs.smoother, brightness)
                if fit.factorisation is None or not fit.n_pixels:
                    return None
                chi2.append(residual_noise(inputs.reference, spline, fit, brightness, fitted_dof(fit)).variance
                            / variance)
            differences.append(fit.u_px - u)
            full.append(fit.u_full_px)
            coefficients.append(fit.brightness)
        if not frames:
            return None
        return cls(tuple(frames), np.array(differences), np.array(full), np.array(coefficients), np.array(chi2),
                   inputs.smoother.length_px)


def with_residuals(inputs: Seen, motions: FreeMotions) -> FreeFields:
    """The motions with the residual that each of them leaves."""
    residuals = [_residual(inputs, frame, u, coefficients)
                 for frame, u, coefficients in zip(motions.frames, motions.u_full_px, motions.brightness, strict=True)]
    return FreeFields(motions.frames, motions.difference_px, np.array(residuals, dtype=np.float32), motions.chi2_dof,
                      motions.length_px)


def _residual(inputs: Seen, frame: int, u_px: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Residual in the reference image, NaN where there is no valid pixel  # (ny, nx)"""
    if isinstance(inputs.reference, FieldReference):
        residual = inputs.reference.compare_pixels(inputs.experiment, frame, u_px, coefficients)
    else:
        residual = residual_map(inputs.reference, frame_spline(inputs.experiment, frame), u_px,
                            inputs.experiment.options.brightness,
                            coefficients)
    return inputs.reference.pixel_map.to_image(np.where(residual.valid, residual.r, np.nan))


def noise_floor(inputs: Seen | None, phi: Sensitivities | None, result: Mapping, reference) -> NoiseFloor:
    """Root mean square over the nodes of the noise of displacement, over the elements of that of strain.

    The free FE-DIC is given a still image: the reference image with the noise that the difference of two images has.
    The model's floor follows from the covariance of its parameters, std(u)^2 = phi^T Cov phi.
    """
    free_stds = (None, None) if inputs is None else _of_still_image(inputs)
    model_stds = (None, None) if phi is None else _of_model(phi, result, reference)
    return NoiseFloor(*free_stds, *model_stds, None if phi is None else phi.frame)


def _of_still_image(inputs: Seen) -> tuple[float | None, float | None]:
    noise = inputs.experiment.recording.noise
    sigma = noise.in_sums_gv if isinstance(inputs.reference, FieldReference) else noise.std_gv
    fit = inputs.still_frame(np.random.default_rng(SEED), sigma) if sigma else None
    u = np.zeros((0, 2)) if fit is None else fit.u_px[np.isfinite(fit.u_px).all(axis=1)]
    if fit is None or not len(u):
        return None, None
    return _rms(u), _rms(_strains(inputs.reference.pixel_map, fit.u_full_px))


def _of_model(phi: Sensitivities, result: Mapping, reference) -> tuple[float | None, float | None]:
    """rms standard deviation of the simulated displacement in px, and of its strain where the view is plane."""
    table = result.get("correlation", {})
    stds = _formal_stds(result)
    chosen = [i for i, name in enumerate(phi.names) if name in table.get("names", ()) and stds.get(name) is not None]
    if not chosen or not phi.sizes:
        return None, None
    names = [phi.names[i] for i in chosen]
    at = [table["names"].index(name) for name in names]
    steps = np.array([stds[name] / phi.sizes[i] for name, i in zip(names, chosen, strict=True)])
    covariance = np.asarray(table["matrix"], dtype=float)[np.ix_(at, at)] * np.outer(steps, steps)
    fields = phi.phi_px[chosen]  # (n, n_nodes, 2 or 3)
    plane = not reference.is_section
    nodes = reference.pixel_map.visible_nodes if plane else np.arange(fields.shape[1])
    variance = np.einsum("iac,ij,jac->ac", fields[:, nodes, :2], covariance, fields[:, nodes, :2])
    strain = None
    if plane and fields.shape[2] == 2:
        strains = np.array([_strains(reference.pixel_map, field) for field in fields])  # (n, n_elements, 3)
        strain = float(np.sqrt(np.mean(np.einsum("iec,ij,jec->ec", strains, covariance, strains))))
    return float(np.sqrt(np.mean(variance))), strain


def _formal_stds(result: Mapping) -> dict[str, float | None]:
    """Standard deviations from noise alone, of parameters too that other treatments have found not identifiable."""
    judged = {entry["name"]: entry["std"] for entry in result["not_identifiable"] if "std" in entry}
    return {name: judged.get(name, entry["std"]) for name, entry in result["parameters"].items()}


def _strains(pixel_map, u_px: np.ndarray) -> np.ndarray:
    """Small strain at the middle of the elements: two normal components and the shear  # (n_elements, 3)"""
    gradient = pixel_map.deformation_gradient(u_px) - np.eye(2)
    return np.stack([gradient[:, 0, 0], gradient[:, 1, 1], 0.5 * (gradient[:, 0, 1] + gradient[:, 1, 0])], axis=1)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
