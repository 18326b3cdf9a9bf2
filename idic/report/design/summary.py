"""The tables of design.json: expected parameters, spectrum, confusable pairs, comparison of plans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from idic.identification import Analysis, Design, JointDesign
from idic.model import Experiment
from idic.readers import factor_to
from idic.report.design.words import direction, fixed_product, grade

MIN_CONFUSABLE_CORRELATION = 0.95  # |correlation| above which a test does not separate two parameters


def summary(design: Design, pattern: str, path: Path | str, confusable: float) -> dict:
    """One entry of ``plans``."""
    experiment, fields = design.experiment, {field.name: field for field in design.fields}
    content: dict[str, Any] = {
        "name": design.name, "title": experiment.title, "experiment": str(Path(path).resolve()),
        "frames": experiment.model.n_frames, "duration_s": float(np.ptp(experiment.model.times)),
        "image_px": size_of(experiment), "pixels": design.n_pixels,
        "points": points_of(design), "motion_px": float(design.motion_px.max()), "pattern": pattern,
        "noise": {"std_gv": experiment.recording.noise.std_gv, "unit": experiment.recording.value_unit,
                  "source": experiment.recording.noise.source},
        "channels": {c.column: {"unit": c.unit, "noise_std": float(noise), "peak": float(peak)} for c, noise, peak in
                     zip(experiment.model.channels, design.channel_noise, design.channel_peak, strict=True)},
        "parameters": parameters_of(design.full),
    }
    for name, entry in content["parameters"].items():
        field, factor = fields.get(name), design.parameters[name].factor
        for key, analysis in (("std_images_only", design.image), ("std_test_known", design.materials)):
            std = None if analysis is None or name not in analysis.names else analysis.std(name)
            entry[key] = None if std is None else abs(std / factor)
        entry |= {"motion_px": None if field is None else field.largest,
                  "motion_frame": None if field is None else field.frame}
    content |= _spectrum(design.full, confusable)
    content["alike"] = [{"names": [design.names[i], design.names[j]], "cosine": float(design.alike[i, j])}
                        for i, j in zip(*np.triu_indices(len(design.names), 1), strict=True)
                        if abs(design.alike[i, j]) > confusable]
    factors = np.array([abs(design.parameters[name].factor) for name in design.names])
    content["growth"] = {"frames": design.growth_frames.tolist(),
                         "times": experiment.model.times[design.growth_frames].tolist(),
                         "std": dict(zip(design.names, (design.growth / factors).T.tolist(), strict=True))}
    content["without_channels"] = [] if design.image is None else design.image.summary()["not_identifiable"]
    content["assumptions"] = list(design.notes)
    content["notes"] = list(experiment.notes)
    return content


def size_of(experiment: Experiment) -> list[int]:
    """Columns and rows of the images, of scans also slices."""
    recording = experiment.recording
    shape = recording.volumes.shape if recording.quantity == "volume" else recording.image_shape
    return [int(n) for n in shape[::-1]]


def points_of(design: Design) -> dict | None:
    """Points of a measured field on the mesh; their distance is what its px is. None for images."""
    points = design.experiment.recording.points
    return None if points is None else {"number": design.n_pixels // points.n_components, "pitch": points.pitch_mm,
                                        "unit": design.experiment.model.length_unit}


def parameters_of(analysis: Analysis) -> dict:
    """Value and expected standard deviation of every free parameter, in the user's units."""
    entries = {}
    for i, name in enumerate(analysis.names):
        p, std = analysis.parameters[name], analysis.std(name)
        relative = None if std is None else std / abs(analysis.scaled.slopes[i])  # of the value, or of the scale
        entries[name] = {"value": p.shown, "unit": p.unit, "std": None if std is None else abs(std / p.factor),
                      "relative_std": None if std is None else std / abs(p.value) if p.value else relative,
                      "grade": grade(relative)}
    return entries


def _spectrum(analysis: Analysis, confusable: float) -> dict:
    analysis_summary, spectrum = analysis.summary(), analysis.spectrum
    scales = [None if (p := analysis.parameters[name]).transform == "log" else abs(p.scale / p.factor)
              for name in analysis.names]
    labels = [name.rpartition(".")[2] if _one_set(analysis.names) else name for name in analysis.names]
    largest, smallest = spectrum.values[0], spectrum.values[-1]
    analysis_summary["condition"] = float(largest / max(smallest, 1e-300)) if smallest > 0 else None
    analysis_summary["directions"] = [
        {"text": direction(vector, labels, scales), "std": float(std) if np.isfinite(std) else None,
         "determined": bool(is_determined), "fixed": fixed_product(vector, labels, scales)}
        for vector, std, is_determined in zip(spectrum.vectors.T, spectrum.stds, spectrum.determined, strict=True)]
    analysis_summary["confusable"] = confusable_pairs(analysis_summary, confusable)
    return analysis_summary


def confusable_pairs(analysis_summary: Mapping, limit: float) -> list[dict]:
    """Pairs that the test does not separate: correlated above the limit, or only their combination is determined."""
    names, matrix = analysis_summary["correlation"]["names"], np.array(analysis_summary["correlation"]["matrix"])
    pairs = [{"names": [names[i], names[j]], "correlation": float(matrix[i, j])}
             for i, j in zip(*np.triu_indices(len(names), 1), strict=True) if abs(matrix[i, j]) > limit]
    for entry in analysis_summary["not_identifiable"]:
        for partner in entry["together_with"]:
            names = sorted((entry["name"], partner))
            if not any(sorted(pair["names"]) == names for pair in pairs):  # type: ignore[call-overload]
                pairs.append({"names": names, "correlation": None})
    return pairs


def _one_set(names: Sequence[str]) -> bool:
    return len({name.rpartition(".")[0] for name in names}) == 1


def joint_summary(joint: JointDesign, confusable: float) -> dict:
    """All plans identified together."""
    return {"parameters": parameters_of(joint.full), **_spectrum(joint.full, confusable), "notes": list(joint.notes)}


def compare(content: Mapping) -> dict:
    """Standard deviation of every material parameter per plan and jointly, in one unit, the best plan named."""
    plans = {plan["name"]: plan["parameters"] for plan in content["plans"]}
    joint, rows = content["joint"]["parameters"], {}
    for name, entry in joint.items():
        entries = {plan: parameters[name] | {"to": factor_to(entry["unit"], parameters[name]["unit"])}
                   for plan, parameters in plans.items()
                 if name in parameters}
        stds = {plan: None if entry_of["std"] is None else entry_of["to"] * entry_of["std"]
                for plan, entry_of in entries.items()
                if entry_of["to"] is not None}  # another dimension is no other size
        if not stds:
            continue
        determined = {plan: std for plan, std in stds.items() if std is not None}
        best = min(determined, key=determined.get) if determined and len(stds) > 1 else None
        rows[name] = {"unit": entry["unit"], "value": entry["value"], "std": stds, "joint": entry["std"], "best": best}
    conditions = {plan["name"]: plan["condition"] for plan in content["plans"]}
    conditions["joint"] = content["joint"]["condition"]
    return {"plans": list(plans), "parameters": rows, "condition": conditions}
