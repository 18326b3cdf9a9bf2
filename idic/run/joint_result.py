"""``result.json`` of several experiments identified together, and the part of each experiment.

Keys as in `idic.identification.result`; parameters that belong to one experiment are named ``NAME.parameter``, channels
``NAME.column``. ``experiments`` holds noise, residual and folder of each; ``frames`` lists those of all, each with its
``experiment``. ``specimens`` holds, per shared parameter, what each experiment alone says of it and the scatter between
them (`idic.identification.specimens`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from idic.identification import DiscrepancySystem, Evaluation, Joint, LoopState, build_result, specimens_content
from idic.run.store.result_file import write_result


@dataclass(frozen=True)
class JointEvaluation(Evaluation):
    """An evaluated point of all experiments, and of each."""

    parts: Mapping[str, Evaluation] = field(default_factory=dict)


OF_ALL = ("std", "std_noise", "std_model", "ci95", "value", "value_relative", "systematic_std", "discretisation_bias",
          "time_bias")


def joint_result(run: Path, joint: Joint, state: LoopState, point: JointEvaluation | None, noise: Mapping[str, float],
                 own: Mapping[str, dict], discrepancy: DiscrepancySystem | str,
                 parts: Mapping[str, DiscrepancySystem | str] | None = None) -> dict:
    """Write ``RUN/result.json``; `own` are the results of the experiments, `noise` that of their images (GV).

    parts : the discrepancy of each experiment; None: the scatter between them is not estimated
    """
    frames = [dict(frame) | {"experiment": name} for name, result in own.items() for frame in result["frames"]]
    costs = [result["cost"] for result in own.values()]
    cost = {"forward_runs": max(result["forward_runs"] for result in own.values()),
            "wall_s": max(c["wall_s"] for c in costs), "forward_s": max(c["forward_s"] for c in costs),
            "image_s": max(c["image_s"] for c in costs), "peak_rss_mb": max(c["peak_rss_mb"] for c in costs)}
    result = build_result(joint.whole, state, point, noise[next(iter(own))], _residual(own), frames, cost,
                          discrepancy, joint)
    result["experiments"] = {
        name: {"title": part["title"], "noise": part["noise"], "residual": part["residual"],
               "folder": joint.experiments[name].folder, "report": f"experiments/{name}/report.html"}
        for name, part in own.items()}
    if point is not None and parts is not None and not state.failed:
        result["specimens"] = specimens_content(joint, state, point.parts, noise, parts)
    result["has_force"] = any(part.get("has_force", True) for part in own.values())
    result["sensitivity"] = next(iter(own.values())).get("sensitivity")
    result["history"] = [dict(entry) for entry in state.history]
    write_result(run, result)
    return result


def result_of_part(folder: Path, own: dict, whole: Mapping, experiment: str, names: Mapping[str, str]) -> None:
    """Give the result of one experiment the standard deviations that all of them have together."""
    for name, entry in own["parameters"].items():
        joint = whole["parameters"][names[name]]
        entry.update({key: joint[key] for key in OF_ALL if key in joint})
    own["has_force"] = whole["has_force"]
    back = {joint: name for name, joint in names.items()}
    for key in ("correlation", "M"):
        if key in whole:
            kept = [i for i, name in enumerate(whole[key]["names"]) if name in back]
            matrix = np.array(whole[key]["matrix"]).reshape(len(whole[key]["names"]), -1)
            own[key] = {"names": [back[whole[key]["names"][i]] for i in kept],
                        "matrix": matrix[np.ix_(kept, kept)].tolist()}
    own["derived"] = derived_of_part(whole["derived"], experiment, whole["experiments"])
    own["not_identifiable"] = [entry | {"name": back[entry["name"]]} for entry in whole["not_identifiable"]
                               if entry["name"] in back]
    own["notes"] = [*own["notes"], "Identified together with other experiments (" + ", ".join(whole["experiments"])
                    + "): standard deviations and correlations are those of all."]
    write_result(folder, own)


def derived_of_part(derived: Mapping[str, dict], experiment: str, experiments: Iterable[str]) -> dict[str, dict]:
    """The derived quantities of one experiment under its own names, without those of the other experiments.

    derived : of the whole, ``NAME.SET.K`` and ``NAME.SET.E1/E2`` those of an experiment
    """
    others = tuple(f"{name}." for name in experiments if name != experiment)
    return {"/".join(side.removeprefix(f"{experiment}.") for side in label.split("/")): entry
            for label, entry in derived.items() if not any(side.startswith(others) for side in label.split("/"))}


def _residual(own: Mapping[str, dict]) -> dict:
    """The fit of all experiments: chi2 over all pixels, every channel under the name of its experiment."""
    pixels = {name: sum(f["n_pixels"] or 0 for f in part["frames"] if f["status"] == "ok" and not f["reference"])
              for name, part in own.items()}
    known = [name for name, part in own.items() if part["residual"]["image_chi2_dof"] is not None and pixels[name]]
    total = sum(pixels[name] for name in known)

    def mean(key: str, power: int) -> float | None:
        if not total:
            return None
        value = sum(pixels[name] * own[name]["residual"][key] ** power for name in known) / total
        return value ** (1.0 / power)

    lost = [part["residual"]["lost_pixels"] for part in own.values()]
    summary = {"image_rms_gv": mean("image_rms_gv", 2), "image_chi2_dof": mean("image_chi2_dof", 1),
               "lost_pixels": None if None in lost else sum(lost)}
    for key in ("channel_rms", "channel_chi2_dof", "channel_noise_std"):
        summary[key] = {f"{name}.{column}": value for name, part in own.items()
                        for column, value in part["residual"][key].items()}
    return summary
