"""A free FE-DIC on the images of a finished run: its distance from the simulated motion, and its noise floor."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from idic.correlation import FieldReference, frame_spline, residual_map
from idic.measure import Seen, dic_frame, field_frame, field_variance, fitted_dof, residual_noise, still_frame
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


def free_motions(seen: Seen, frames: Sequence[int], motion: Callable[[int], np.ndarray]) -> FreeMotions | None:
    """Free displacement of some frames, started from the simulated one.

    motion : frame -> simulated displacement of the nodes in the image  # (n_nodes, 2) px
    """
    brightness, variance = seen.experiment.options.brightness, seen.experiment.noise.std_gv**2
    differences, full, coefficients, chi2 = [], [], [], []
    for frame in frames:
        u = motion(frame)
        if isinstance(seen.reference, FieldReference):
            found = field_frame(seen.reference, seen.reference.measured(seen.experiment, frame), seen.smoother)
            if found is None:
                return None
            chi2.append(field_variance(found, seen.reference, fitted_dof(found)) / variance)
        else:
            spline = frame_spline(seen.experiment, frame)
            found = dic_frame(seen.reference, spline, u, seen.smoother, brightness)
            if found.factorisation is None or not found.n_pixels:
                return None
            chi2.append(residual_noise(seen.reference, spline, found, brightness, fitted_dof(found)).variance
                        / variance)
        differences.append(found.u_px - u)
        full.append(found.u_full_px)
        coefficients.append(found.brightness)
    if not frames:
        return None
    return FreeMotions(tuple(frames), np.array(differences), np.array(full), np.array(coefficients), np.array(chi2),
                       seen.smoother.length_px)


def with_residuals(seen: Seen, found: FreeMotions) -> FreeFields:
    """The motions with the residual that each of them leaves."""
    residuals = [_residual(seen, frame, u, coefficients)
                 for frame, u, coefficients in zip(found.frames, found.u_full_px, found.brightness, strict=True)]
    return FreeFields(found.frames, found.difference_px, np.array(residuals, dtype=np.float32), found.chi2_dof,
                      found.length_px)


def _residual(seen: Seen, frame: int, u_px: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Residual in the reference image, NaN where there is no valid pixel  # (ny, nx)"""
    if isinstance(seen.reference, FieldReference):
        left = seen.reference.compare_pixels(seen.experiment, frame, u_px, coefficients)
    else:
        left = residual_map(seen.reference, frame_spline(seen.experiment, frame), u_px,
                            seen.experiment.options.brightness,
                            coefficients)
    return seen.reference.pixel_map.to_image(np.where(left.valid, left.r, np.nan))


def noise_floor(seen: Seen | None, phi: Sensitivities | None, result: Mapping, reference) -> NoiseFloor:
    """Root mean square over the nodes of the noise of displacement, over the elements of that of strain.

    The free FE-DIC is given a still image: the reference image with the noise that the difference of two images has.
    The model's floor follows from the covariance of its parameters, std(u)^2 = phi^T Cov phi.
    """
    free = (None, None) if seen is None else _of_still_image(seen)
    model = (None, None) if phi is None else _of_model(phi, result, reference)
    return NoiseFloor(*free, *model, None if phi is None else phi.frame)


def _of_still_image(seen: Seen) -> tuple[float | None, float | None]:
    noise = seen.experiment.noise
    sigma = noise.in_sums_gv if isinstance(seen.reference, FieldReference) else noise.std_gv
    found = still_frame(seen, np.random.default_rng(SEED), sigma) if sigma else None
    u = np.zeros((0, 2)) if found is None else found.u_px[np.isfinite(found.u_px).all(axis=1)]
    if found is None or not len(u):
        return None, None
    return _rms(u), _rms(_strains(seen.reference.pixel_map, found.u_full_px))


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
