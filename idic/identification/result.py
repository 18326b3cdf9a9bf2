"""The result as a record: values with standard deviations, parameters that are not identifiable and why, fit and cost.

Meaning of every key: docs/quantities.md (schema ``idic.result/1``).
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from idic.fe import EXTERNAL
from idic.identification.discrepancy.normal_equations import DiscrepancySystem
from idic.identification.discrepancy.variances import Variances, estimate
from idic.identification.joint import Joint
from idic.identification.loop import parameters_at
from idic.identification.noise.channel_noise import (
    added_spread,
    channel_noise_content,
    channel_noise_notes,
    compared_readings,
    estimated_channel_noise,
    smooth_share,
    smooth_spread,
    repeated_readings,
    with_channel_noise,
)
from idic.identification.noise.input_noise import gradient_notes, noise_content, noise_notes
from idic.identification.step.ending import end_entry
from idic.identification.step.estimator import estimator_notes
from idic.identification.step.increments import increment_notes, increments_entry, time_bias
from idic.identification.step.parameter_covariance import (
    MAX_UNDETERMINED_SHARE, Scaled, Spectrum, scaled_system, undetermined_share,
)
from idic.identification.step.state import Evaluation, LoopState
from idic.images import CAMERA_PARAMETERS, LENS_PARAMETERS, PLACED_TURNS
from idic.laws import get_law
from idic.model import Experiment, Remedies, in_words, strayed
from idic.parameters import STRESS_UNITS, ParameterSet, digits_text

Names = Mapping[str, Mapping[str, str]]  # {experiment: {its parameter: parameter of the whole}}
SCHEMA = "idic.result/1"
WITHOUT_STD = {"correlation": {"names": [], "matrix": []}, "derived": {}}  # of a search that a simulation ended
MIN_IMITATED_CORRELATION = 0.95  # of an undetermined parameter with its partners; below, the noise hides its effect
MESH_COUNTED = ("the error by the mesh was estimated by a simulation on a finer one; std counts it (mesh_bias, a part "
                "of std_model)")
MESH_SIZE_COUNTED = ("the size of the error by the mesh was estimated by a simulation on a coarser one, as a finer one "
                     "is too large; std counts it (mesh_bias, with an uncertain sign, a part of std_model)")
MESH_CONTRADICTED = ("a simulation on a finer mesh leaves a residual that the recording does not show: std does not "
                     "count the error by the mesh")
MESH_NOT_COUNTED = "std does not count the error by the mesh; idic systematic estimates it (discretisation_bias)"
SMALL_STRAINS = ('small strains are an assumption: the same law with finite strains (kinematics = "finite") would '
                 "move {}; std does not count it")
MAX_STRAIGHT_SHARE = 0.1  # of the time between two frames: a longer shift of the log is told
MIN_SHIFT_STD = 3.0  # standard deviations of that shift; below, it is noise


def at_bound(parameters: ParameterSet) -> dict[str, float]:
    """The bound of every free parameter that lies within a millionth of one, in the user's unit."""
    bounds = {}
    for name in parameters.free:
        p = parameters[name]
        near_bounds = [b for b in p.bounds if np.isfinite(b) and abs(p.value - b) <= 1e-6 * max(abs(b), 1e-12)]
        if near_bounds:
            bounds[name] = float(near_bounds[-1] / p.factor)
    return bounds


def build_result(experiment: Experiment, state: LoopState, point: Evaluation | None, image_noise: float,
                 residual: Mapping, frames: Sequence[Mapping], cost: Mapping,
                 discrepancy: DiscrepancySystem | str, joint: Joint | None = None) -> dict:
    """The contents of ``RUN/result.json``.

    Parameters
    ----------
    point : the accepted evaluation; None where no simulation converged
    discrepancy : of the model at that point, or why it is not estimated
    residual : ``image_rms_gv``, ``image_chi2_dof``, ``channel_rms``, ``channel_chi2_dof``
    frames : one mapping per frame: frame, label, status, rms_gv, chi2_dof
    cost : wall_s, forward_s, image_s, peak_rss_mb, forward_runs
    joint : the experiments whose whole this is; None: a single one
    """
    model = experiment.model
    parameters = parameters_at(model, state)
    result: dict[str, Any] = {"schema": SCHEMA, "status": state.status, "end": end_entry(state),
              "title": experiment.title, "parameters": {}, "derived": {},
              "iterations": state.iteration, "evaluations": state.evaluations, "rounds": state.rounds,
              "forward_runs": int(cost.get("forward_runs", state.evaluations)),
              "quantity": experiment.recording.quantity, "noise": noise_content(experiment.recording),
              "residual": dict(residual),
              "correlation": {"names": [], "matrix": []}, "eigenvalues": [], "eigenvectors": [],
              "not_identifiable": [], "frames": [dict(frame) for frame in frames],
              "cost": {key: value for key, value in cost.items() if key != "forward_runs"},
              "method": experiment.options.method,
              "estimator": "generalised" if state.generalised else "ordinary",
              "at_bound": at_bound(parameters), "stages": state.schedule.stage + 1,
              "notes": [*experiment.notes, *estimator_notes(experiment, state.estimator.kind),
                        *increment_notes(experiment, state.increments)],
              "increments": increments_entry(experiment, state.increments),
              "history": [dict(entry) for entry in state.history]}
    analysis = None
    if point is not None and point.system is not None:
        result["notes"] += record_notes(experiment, parameters) if joint is None else joint_record_notes(joint,
                                                                                                         parameters)
        analysis = Analysis(experiment, parameters, point, image_noise, discrepancy, joint and joint.names)
        result |= analysis.summary() | (WITHOUT_STD if state.failed else {})
        if analysis.channels and not state.failed:
            result["noise"] |= {"channels": channel_noise_content(model, analysis.channels)}
            result["notes"] += channel_noise_notes(model, analysis.channels)
        if not state.failed and model.solver is None and (model.mesh.is_raised_by_default or (
                model.n_dim == 3 and (model.mesh.can_raise_order or model.mesh.can_halve))):
            result["notes"].append(_mesh_note(analysis))
    for p in parameters.values():
        entry = _parameter_entry(p, model.parameters, analysis, state.failed)
        bias = time_bias(model, state.increments).get(p.name)
        entry["time_bias"] = None if bias is None or entry["std"] is None else bias / p.factor
        if analysis is not None and p.free and entry["std"] is not None and analysis.mesh_bias is not None:
            entry["mesh_bias"] = float(analysis.direction(p.name) @ analysis.mesh_bias) / p.factor
            entry["discretisation_bias"] = entry["mesh_bias"] + (entry["time_bias"] or 0.0)
        result["parameters"][p.name] = entry
    if analysis is not None:
        result["notes"] += [*strain_notes(analysis, result["parameters"]), *shift_notes(experiment, parameters,
                                                                                        result["parameters"])]
    return result


def _mesh_note(analysis: Analysis) -> str:
    """Whether the error by the mesh of a solid, or of linear elements, is counted."""
    if analysis.mesh_contradicted:
        return MESH_CONTRADICTED
    if analysis.mesh_bias is None:
        return MESH_NOT_COUNTED
    size_only = not isinstance(analysis.discrepancy, str) and analysis.discrepancy.mesh_size_only
    return MESH_SIZE_COUNTED if size_only else MESH_COUNTED


def record_notes(experiment: Experiment, parameters: ParameterSet) -> list[str]:
    """Notes on the records of one experiment: its images, the places in its body, the readings of its log."""
    return [*noise_notes(experiment), *gradient_notes(experiment), *strayed(experiment.model, parameters),
            *repeated_readings(experiment)]


def joint_record_notes(joint: Joint, parameters: ParameterSet) -> list[str]:
    """The same of every experiment, each judged by its own frames; parameters : of the whole."""
    values = parameters.as_values()
    return [f"{name}: {note}" for name, experiment in joint.experiments.items() for note in
            record_notes(experiment, experiment.model.parameters.with_values(joint.values_of(name, values)))]


def shift_notes(experiment: Experiment, parameters: ParameterSet, entries: Mapping[str, Mapping]) -> list[str]:
    """Where the columns of the log count far from the times that they were read at: they are straight in between."""
    model = experiment.model
    entry, shift = entries.get("time.offset"), model.log_shift(parameters)
    interval = float(np.median(np.diff(model.times))) if model.n_frames > 1 else np.inf
    if entry is None or not entry["free"] or entry["std"] is None or abs(shift) < max(
            MAX_STRAIGHT_SHARE * interval, MIN_SHIFT_STD * entry["std"] * parameters["time.offset"].factor):
        return []
    remedy = (f"write value = {entry['value']:.4g} in its [[dof]] and identify again, until this note is gone"
              if experiment.recording.is_log_interpolated else
              f"give a log with times of its own, faster than the images (a column time_s"
              f"{Remedies(experiment).times_of_images})")
    return [f"time.offset: the log counts {abs(shift):.3g} s {'earlier' if shift < 0.0 else 'later'} than it was read, "
            f"{abs(shift) / interval:.2g} of the time between two images, and its columns are taken as straight over "
            f"that time. Where they bend, all values are wrong: {remedy}"]


def strain_notes(analysis: Analysis, entries: Mapping[str, Mapping]) -> list[str]:
    """Where a law of small strains moves parameters by more than their standard deviation."""
    if analysis.strain_bias is None:
        return []
    moved = []
    for name in analysis.names:
        entry, p = entries[name], analysis.parameters[name]
        bias = float(analysis.direction(name) @ analysis.strain_bias) / p.factor
        if entry["std"] is not None and abs(bias) > entry["std"]:
            change_text = ("+" if bias < 0.0 else "-") + digits_text(abs(bias), 2, zeros=True)
            moved.append(f"{name} by {change_text} {entry['unit']}".rstrip(" -")
                         + f" (std {digits_text(entry['std'], 2, zeros=True)})")
    return [SMALL_STRAINS.format(", ".join(moved))] if moved else []


def _parameter_entry(p, start: ParameterSet, analysis: Analysis | None, failed: bool) -> dict:
    """failed : a simulation ended the search on its way to the minimum: the point has no standard deviation."""
    first = start[p.name]
    entry = {"value": p.shown, "std": None, "std_noise": None, "std_model": None, "systematic_std": None,
             "discretisation_bias": None, "unit": p.unit, "start": first.shown, "free": p.free,
             "ci95": None}  # null: not estimated
    if not p.free:
        return entry
    std = analysis.std(p.name) if analysis else None
    if std is None:
        entry["value"] = first.shown
        if p.shown != first.shown:
            entry["value_relative"] = p.shown  # valid in ratio to the other undetermined parameters only
        return entry
    if failed:
        return entry
    entry |= {key: value / abs(p.factor) for key, value in analysis.parts(analysis.direction(p.name)).items()
              if value is not None}
    entry["ci95"] = [p.shown - 1.96 * entry["std"], p.shown + 1.96 * entry["std"]]
    return entry


class Analysis:
    """Spectrum, covariance and the statistics from them at the accepted point.

    joint_names : of several experiments together: {experiment: {its parameter: parameter of the whole}}
    planned : of a test that is not made yet: what its readings leave is no noise
    """

    def __init__(self, experiment: Experiment, parameters: ParameterSet, point: Evaluation, image_noise: float,
                 discrepancy: DiscrepancySystem | str = "it is not asked for", joint_names: Names | None = None,
                 planned: bool = False):
        self.experiment, self.parameters = experiment, parameters
        self.joint_names = joint_names or {"": {name: name for name in parameters}}
        self.names = point.system.names
        self.channels = {} if planned else estimated_channel_noise(experiment, parameters, point)
        system = with_channel_noise(point.system, experiment.model, self.channels)
        self.scaled: Scaled = scaled_system(system, parameters, point.reference_gram, image_noise)
        self.spectrum: Spectrum = self.scaled.spectrum()
        self.of_noise = self.scaled.covariance(self.spectrum)
        weight = self.scaled.weight
        inverse = self.spectrum.inverse
        answer = inverse if weight is None else inverse @ weight  # to a change of b of the data
        self.discrepancy = discrepancy
        self.variances: Variances | None = None
        self.of_model: np.ndarray | None = None
        if not isinstance(discrepancy, str):
            if self.channels and discrepancy.channel_rows is not None:
                of_channels = discrepancy.channel_rows, compared_readings(point.system), experiment.model, self.channels
                smooth = smooth_spread(*of_channels)
                discrepancy = replace(discrepancy, noise=discrepancy.noise + added_spread(*of_channels)
                                      + (0.0 if smooth is None else smooth))
            self.variances = estimate(discrepancy, self.spectrum.inverse, self.scaled.slopes, self.scaled.b, weight)
            self.of_model = answer @ self.variances.covariance @ answer.T
        self._count_smooth_errors(point, answer)
        error = None if isinstance(discrepancy, str) else discrepancy.mesh_error
        self.mesh_contradicted = error is not None and not self.variances.mesh
        scaled_error = None if error is None or self.mesh_contradicted else self.scaled.slopes * error[:len(self.names)]
        self.mesh_bias = None if scaled_error is None else answer @ scaled_error  # (n,) scaled
        strains = None if isinstance(discrepancy, str) else discrepancy.strain_error
        self.strain_bias = None if strains is None else answer @ (self.scaled.slopes * strains[:len(self.names)])
        self.covariance = self.of_noise if self.of_model is None else self.of_noise + self.of_model
        self.share = undetermined_share(self.spectrum)

    def _count_smooth_errors(self, point: Evaluation, answer: np.ndarray) -> None:
        """Add the smooth errors of channels to the covariance by the model's error (docs/method.md, equation 14.6)."""
        rows = np.array([record.channel_columns for record in point.system.frames]) if self.channels else np.zeros(0)
        smooth = smooth_spread(rows, compared_readings(point.system), self.experiment.model, self.channels)
        if smooth is not None:
            slopes = self.scaled.slopes
            added = answer @ (slopes[:, None] * smooth * slopes) @ answer.T
            self.of_model = added if self.of_model is None else self.of_model + added

    def direction(self, name: str) -> np.ndarray:
        """Derivative of a parameter, in internal units, by the scaled ones  # (n,)"""
        return np.where(np.array(self.names) == name, self.scaled.slopes, 0.0)

    def parts(self, gradient: np.ndarray) -> dict[str, float | None]:
        """Standard deviation of a quantity, and its parts from noise and from the discrepancy of the model.

        gradient : (n,) of the quantity by the scaled parameters
        """
        def std(matrix: np.ndarray) -> float:
            return float(np.sqrt(max(gradient @ matrix @ gradient, 0.0)))

        return {"std": std(self.covariance), "std_noise": std(self.of_noise),
                "std_model": None if self.of_model is None else std(self.of_model)}

    def std(self, name: str) -> float | None:
        """Standard deviation in internal units; None where the data leave the parameter open."""
        i = self.names.index(name)
        if self.share[i] > MAX_UNDETERMINED_SHARE:
            return None
        return float(np.sqrt(max(self.covariance[i, i], 0.0)) * abs(self.scaled.slopes[i]))

    def summary(self) -> dict:
        deviations = np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))
        indices = [i for i, name in enumerate(self.names) if self.std(name) is not None and deviations[i] > 0]
        matrix = self.covariance[np.ix_(indices, indices)] / np.outer(deviations[indices], deviations[indices])
        return {
            "correlation": {"names": [self.names[i] for i in indices], "matrix": matrix.tolist()},
            "eigenvalues": self.spectrum.values.tolist(),
            "eigenvectors": self.spectrum.vectors.tolist(),
            "M": {"names": list(self.names), "matrix": self.scaled.M.tolist()},
            "not_identifiable": self._not_identifiable(),
            "derived": self._ratios() | self._material_constants(),
            "discrepancy": self._discrepancy(),
        }

    def _discrepancy(self) -> dict:
        """What the model leaves unexplained (docs/quantities.md)."""
        if isinstance(self.discrepancy, str):
            return {"not_estimated": self.discrepancy}
        size, share = self.variances.std, smooth_share(self.experiment.model, self.channels)
        if share:
            size = size | {"channel": share}
        ratios = [self.variances.likelihood_ratio, *(noise.likelihood_ratio for noise in self.channels.values())]
        return {"significant": self.variances.significant or share > 0.0, "likelihood_ratio": max(ratios),
                "std": size, "motion_px": {key: size[key] * px for key, px in self.discrepancy.motion_px.items()}}

    def _not_identifiable(self) -> list[dict]:
        entries = []
        for i, name in enumerate(self.names):
            if self.share[i] <= MAX_UNDETERMINED_SHARE:
                continue
            partners, alike = self._partners(i), None
            if not self._has_force() and self._is_stress(name):
                reason = ("no force: only ratios of moduli can be determined" if partners
                          else "no force: it scales the stress and does not change the motion")
            else:
                reason, alike = self._reason(i, partners)
            entries.append({"name": name, "reason": reason, "together_with": partners, "correlation": alike})
        return entries

    def _has_force(self) -> bool:
        """Whether a force or a load is known: a displacement alone gives no stress."""
        return bool(self.experiment.model.loads) or any(c.kind != "displacement"
                                                        for c in self.experiment.model.channels)

    def _reason(self, i: int, partners: list[str]) -> tuple[str, float | None]:
        """Why the data leave parameter i open: it has no effect, or one that its partners can imitate, with the
        correlation of both (None elsewhere)."""
        alike = self._imitated(i, partners) if partners else 0.0
        partner_list = ", ".join(in_words(partners, self.names))
        if alike < MIN_IMITATED_CORRELATION:
            return ("it changes neither images nor channels by more than the noise"
                    + (": a camera shows only where the specimen deforms or turns"
                       if self.names[i].rpartition(".")[2] in {*CAMERA_PARAMETERS, *LENS_PARAMETERS,
                    *PLACED_TURNS} else "") + (f" (correlation {alike:.2f} with {partner_list})" if partners
                                               else "")), None
        gauges = [partner for partner in partners if partner.startswith("boundary.") and partner.endswith(".scale")]
        if gauges and self._is_stress(self.names[i]):
            return f"determined only up to the factor {gauges[0]}: no channel measures that load", None
        together = partner_list if len(partners) == 1 else f"{partner_list} together"
        return f"cannot be told apart from {together}: correlation {alike:.3f}", alike

    def _imitated(self, i: int, partners: list[str]) -> float:
        """Multiple correlation of the effect of parameter i with those of its partners, 0 … 1."""
        indices = [self.names.index(name) for name in partners]
        M, rhs = self.scaled.M, self.scaled.M[indices, i]
        if not M[i, i] > 0.0:
            return 0.0
        size = np.sqrt(np.where(np.diagonal(M)[indices] > 0.0, np.diagonal(M)[indices], 1.0))
        share = (rhs / size) @ np.linalg.pinv(M[np.ix_(indices, indices)] / size[:, None] / size, rcond=1e-12,
                                              hermitian=True) @ (rhs / size) / M[i, i]
        return float(np.sqrt(np.clip(share, 0.0, 1.0)))

    def _partners(self, i: int) -> list[str]:
        """The other parameters in the undetermined directions that hold parameter i."""
        weak = self.spectrum.vectors[:, ~self.spectrum.determined]
        together = np.abs(weak @ weak[i])
        return [self.names[j] for j in range(len(self.names)) if j != i
                and together[j] > MAX_UNDETERMINED_SHARE * together[i]]

    def _is_stress(self, name: str) -> bool:
        return self.parameters[name].unit in STRESS_UNITS

    def _ratios(self) -> dict:
        """Ratios of open parameters that the data do determine, with their standard deviations."""
        open_names = [name for i, name in enumerate(self.names)
                      if self.share[i] > MAX_UNDETERMINED_SHARE and self.parameters[name].transform == "log"]
        ratios = {}
        for a, first in enumerate(open_names):
            for second in open_names[a + 1:]:
                direction = np.zeros(len(self.names))
                direction[self.names.index(first)], direction[self.names.index(second)] = 1.0, -1.0
                undetermined = self.spectrum.vectors[:, ~self.spectrum.determined].T @ direction
                if np.linalg.norm(undetermined) > MAX_UNDETERMINED_SHARE:
                    continue
                value = self.parameters[first].value / self.parameters[second].value
                parts = self.parts(value * direction)
                std = parts["std"]
                same_set = first.rpartition(".")[0] == second.rpartition(".")[0]
                label = f"{first}/{second.rpartition('.')[2]}" if same_set else f"{first}/{second}"
                ratios[label] = {"value": value, **parts, "ci95": [value - 1.96 * std, value + 1.96 * std]}
        return ratios

    def _material_constants(self) -> dict:
        """What the laws derive from their parameters, where identified ones enter and determine it.

        Of several experiments, where a parameter belongs to one: under the name of that experiment.
        """
        constants: dict[str, dict] = {}
        for experiment, material in product(self.joint_names, self.experiment.model.materials):
            parameter_names, stem = self.joint_names[experiment], material.element_set
            derived = {} if material.law == EXTERNAL else get_law(material.law).derived
            for name, quantity in derived.items():
                parameters = {argument: f"{stem}.{argument}"
                              for argument in inspect.signature(quantity.value).parameters}
                if not set(parameters.values()) <= set(parameter_names):
                    continue  # another experiment's material
                names = {argument: parameter_names[parameter] for argument, parameter in parameters.items()}
                label = f"{stem}.{name}" if names == parameters else f"{experiment}.{stem}.{name}"
                value, slopes = _with_slopes(quantity.value, names, self.parameters)
                gradient = np.array([slopes.get(n, 0.0) for n in self.names]) * self.scaled.slopes
                undetermined = self.spectrum.vectors[:, ~self.spectrum.determined].T @ gradient
                size = np.linalg.norm(gradient)
                if (size == 0.0 or not np.isfinite(value)
                        or np.linalg.norm(undetermined) > MAX_UNDETERMINED_SHARE * size):
                    continue
                parts = self.parts(gradient)
                std = parts["std"]
                constants[label] = {"value": value, **parts, "unit": quantity.unit,
                                    "ci95": [value - 1.96 * std, value + 1.96 * std]}
        return constants


def _with_slopes(function, names: Mapping[str, str], parameters: ParameterSet) -> tuple[float, dict[str, float]]:
    """Value of a derived quantity and its derivative by each of its parameters, by the complex step.

    names : {argument of the function: its parameter}
    """
    values = {argument: parameters[name].value for argument, name in names.items()}
    slopes = {name: float(np.imag(function(**(values | {argument: values[argument] + 1e-30j})))) / 1e-30
              for argument, name in names.items()}
    return float(function(**values)), slopes
