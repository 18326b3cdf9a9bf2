"""One case of a study: read, identify, store. A case gives the same bits in every process."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from idic.measure import BoundaryStart, Regularisation, dic_stack, with_boundary_start
from idic.experiment_file import load_experiment
from idic.identification import (
    CoarseFit, Identification, identify, measured_start, search, starts_from_dic, wants_search, with_measured_noise,
)
from idic.model import Experiment, Measured, leading_frames
from idic.parameters import ParameterSet
from idic_studies.cases.fields import stored_fields
from idic_studies.cases.realisation import quantised, realisation
from idic_studies.cases.registry import make_study
from idic_studies.cases.store import StudyStore
from idic_studies.cases.study import Case, Rendering
from idic.run import peak_memory_mb

EXPERIMENTS = "experiments"


@dataclass(frozen=True)
class CaseJob:
    """A case to run in the folder of a study, or, with the name of a rendering as `key`, images to render."""

    out: str
    study: str
    size: str
    key: str


def render(job: CaseJob) -> str:
    """Write the folder of a virtual test and store its images, unless they exist (a task)."""
    rendering = make_study(job.study, job.size).rendering(job.key)
    folder = experiment_folder(job.out, rendering.name)
    store = StudyStore(job.out)
    if not store.has_images(rendering.name, rendering.source):
        folder.mkdir(parents=True, exist_ok=True)
        store.keep_images(rendering.name, rendering.write(folder), rendering.source)
    return job.key


def run_case(job: CaseJob) -> str:
    """Identify (or simulate) a case and store its record (a task)."""
    study, store = make_study(job.study, job.size), StudyStore(job.out)
    case = next(case for case in study.cases if case.key == job.key)
    rendering = study.rendering(case.images)
    experiment = case_experiment(store, rendering, case)
    truth = experiment.model.parameters.with_values(_known(experiment.model.parameters,
                                                           true_values(job.out, rendering.name)
                                                     | case.truth))
    began, cpu = time.perf_counter(), time.process_time()
    if case.identify:
        used_part = experiment if case.n_frames is None else leading_frames(experiment, case.n_frames)
        used_part = with_measured_noise(used_part)
        used_part, local = with_measured_start(used_part) if case.measure_start else (used_part, None)
        used_part, searched = with_searched_start(used_part)
        identification = identify(used_part, local, searched=searched)
        cost = _cost(began, cpu)
        facts, arrays = outcome_of(identification, truth)
        arrays["start"] = np.array([experiment.model.parameters[name].shown
                                    for name in facts["names"]])  # before the search
        end = identification.parameters
    else:
        facts, arrays, cost, end = {"names": list(experiment.model.parameters.free),
                                    "status": "simulated"}, {}, {}, truth
    arrays |= stored_fields(case.keep, experiment, end, truth)
    arrays["times"] = experiment.model.times
    facts |= {"case": asdict(case), "noise": experiment.recording.noise.std_gv,
              "value_unit": experiment.recording.value_unit,
              "pixel_mm": experiment.model.camera.pixel_size, **cost}
    store.write_case(case.key, case.ident(rendering), facts, arrays)
    return case.key


def case_experiment(store: StudyStore, rendering: Rendering, case: Case) -> Experiment:
    """The experiment of a case with all its frames; noise and rounding of the case act when an image is read."""
    folder = experiment_folder(store.run, rendering.name)
    experiment = load_experiment(folder, case.overrides, stack=store.images(rendering.name))
    experiment = realisation(experiment, case.noise, case.disturbance, case.seed)
    return quantised(experiment, case.bits) if case.bits else experiment


def experiment_folder(out: Path | str, rendering: str) -> Path:
    """Folder of experiment.toml, mesh, log and truth of a rendering."""
    return Path(out) / EXPERIMENTS / rendering


def true_values(out: Path | str, rendering: str) -> dict[str, float]:
    """The true parameters of a rendering, in the user's units."""
    content = json.loads((experiment_folder(out, rendering) / "truth.json").read_text(encoding="utf-8"))
    return dict(content["parameters"])


def outcome_of(identification: Identification, truth: ParameterSet) -> tuple[dict, dict[str, np.ndarray]]:
    """Facts and arrays of an identification, as `CaseRecord` names them."""
    result, state, experiment = identification.result, identification.state, identification.experiment
    names = experiment.model.parameters.free
    entries = [result["parameters"][name] for name in names]
    arrays = {
        "start": np.array([entry["start"] for entry in entries]),
        "value": np.array([identification.parameters[name].shown for name in names]),
        "std": _known_stds(entries, "std"),
        "std_noise": _known_stds(entries, "std_noise"),
        "truth": np.array([truth[name].shown for name in names]),
        "history": np.array([[h["values"][name] / truth[name].factor for name in names] for h in state.history]),
        "accepted": np.array([h["accepted"] for h in state.history]),
        "history_rms": np.array([np.nan if h["rms_gv"] is None else h["rms_gv"] for h in state.history]),
        "frame_rms": np.full(experiment.model.n_frames, np.nan),
    }
    facts = {"names": list(names), "units": [entry["unit"] for entry in entries], "status": state.status,
             "estimator": result["estimator"],
             "iterations": state.iteration, "evaluations": state.evaluations, "rounds": state.rounds,
             "failed_runs": sum(h["phi"] is None for h in state.history), "correlation": result["correlation"],
             "derived": result["derived"], "discrepancy": result.get("discrepancy"),
             "not_identifiable": [entry["name"] for entry in result["not_identifiable"]]}
    if identification.point is not None:
        for record in identification.point.system.frames:
            arrays["frame_rms"][record.frame] = np.sqrt(record.rr / max(record.n_pixels, 1))
        arrays["M"] = np.array(result["M"]["matrix"])
        pixels = sum(record.n_pixels for record in identification.point.system.frames)
        facts["image_rms"] = float(np.sqrt(sum(record.rr
                                               for record in identification.point.system.frames) / max(pixels, 1)))
        facts["noise_units"] = facts["image_rms"] / (np.sqrt(2.0) * identification.weights.image_noise)
    return facts, arrays


def _known_stds(entries: list[dict], key: str) -> np.ndarray:
    """One standard deviation per parameter, NaN where it is not known  # (n,)"""
    return np.array([np.nan if entry[key] is None else entry[key] for entry in entries])


def with_searched_start(experiment: Experiment) -> tuple[Experiment, bool]:
    """The experiment with the start of the global search, where a run would search; and whether the start moved."""
    if not wants_search(experiment):
        return experiment, False
    u_px = dic_stack(experiment, Regularisation.smooth()).u_px if experiment.recording.quantity != "height" else None
    bare = replace(experiment, recording=replace(experiment.recording, stack=None))
    outcome = search(experiment, lambda trials: [CoarseFit.of(bare, u_px, t.values, t.evaluations, t.simplified)
                                             for t in trials])
    return experiment.with_parameters(experiment.model.parameters.with_values(outcome.values)), outcome.moved


def with_measured_start(experiment: Experiment) -> tuple[Experiment, np.ndarray | None]:
    """The experiment with start values of its measured and virtual boundaries from a free FE-DIC, as in a run.

    Returns
    -------
    experiment : with start values and modes of virtual boundaries
    local : (n_frames, m) mm, frame-local unknowns; None where no boundary is measured
    """
    measured = any(isinstance(entry.drive, Measured) for entry in experiment.model.prescribed)
    if not measured and not starts_from_dic(experiment):
        return experiment, None
    u_px = dic_stack(experiment, Regularisation.smooth()).u_px
    local = measured_start(experiment, u_px, experiment.recording.excluded)
    return with_boundary_start(experiment, BoundaryStart.of(experiment, u_px, experiment.recording.excluded)), local


def _known(parameters: ParameterSet, values: Mapping[str, float]) -> dict[str, float]:
    """True values in internal units of the parameters that this form of the model has."""
    return {name: value * parameters[name].factor for name, value in values.items() if name in parameters}


def _cost(began: float, cpu: float) -> dict[str, float]:
    return {"wall_s": time.perf_counter() - began, "cpu_s": time.process_time() - cpu,
            "peak_rss_mb": peak_memory_mb(children=False)}
