"""``result.json`` of several experiments identified together, and the part of each experiment.

Keys as in `idic.identification.result`; parameters that belong to one experiment are named ``NAME.parameter``, channels
``NAME.column``. ``experiments`` holds noise, residual and folder of each; ``frames`` lists those of all, each with its
``experiment``. ``specimens`` holds, per shared parameter, what each experiment alone says of it and the scatter between
them (`idic.identification.specimens`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from idic.identification import (
    DiscrepancySystem, Evaluation, Joint, LoopState, build_result, joined, specimens_content,
)
from idic.run.judgement.cracks import crack_results
from idic.run.postprocess import INTERRUPTED
from idic.run.prepared.context import RunContext
from idic.run.store.result_file import write_result
from idic.run.store.run_folders import RunFolders

OF_ALL = ("std", "std_noise", "std_model", "ci95", "value", "value_relative", "systematic_std", "discretisation_bias",
          "time_bias")


def write_joint_result(folders: RunFolders, joint: Joint, state: LoopState, point: Evaluation | None,
                       noises: Mapping[str, float], results: Mapping[str, dict],
                       discrepancies: Mapping[str, DiscrepancySystem | str] | None,
                       contexts: Mapping[str, RunContext]) -> dict:
    """Write ``RUN/result.json``, and into the results of the experiments what only all of them say.

    Parameters
    ----------
    noises : of the images of each experiment, GV; results : of each
    discrepancies : of each; None: the run was interrupted, and the scatter between experiments is not estimated
    contexts : of each, whose cracks are judged again with the covariance of all
    """
    frames = [dict(frame) | {"experiment": name} for name, result in results.items() for frame in result["frames"]]
    costs = [result["cost"] for result in results.values()]
    cost = {"forward_runs": max(result["forward_runs"] for result in results.values()),
            "wall_s": max(c["wall_s"] for c in costs), "forward_s": max(c["forward_s"] for c in costs),
            "image_s": max(c["image_s"] for c in costs), "peak_rss_mb": max(c["peak_rss_mb"] for c in costs)}
    discrepancy = INTERRUPTED if discrepancies is None else joined(discrepancies, joint.whole.model.parameters.free,
                                                                   joint.names)
    content = build_result(joint.whole, state, point, noises[next(iter(results))], _residual(results), frames, cost,
                           discrepancy, joint)
    content["experiments"] = {
        name: {"title": result["title"], "noise": result["noise"], "residual": result["residual"],
               "basis": result["basis"],
               "folder": joint.experiments[name].folder, "report": f"experiments/{name}/report.html"}
        for name, result in results.items()}
    if point is not None and discrepancies is not None and not state.failed:
        content["specimens"] = specimens_content(joint, state, point.parts, noises, discrepancies)
    content["has_force"] = any(result.get("has_force", True) for result in results.values())
    content["sensitivity"] = next(iter(results.values())).get("sensitivity")
    cracks = {}
    for name, result in results.items():
        result_of_part(result, content, name, joint.names[name])
        accepted = joint.state_of(name, state).accepted
        if accepted is not None and result.get("cracks"):
            result["cracks"] = crack_results(contexts[name], accepted.number, accepted.values, result)
            cracks |= {f"{name}.{crack}": entry for crack, entry in result["cracks"].items()}
    if cracks:
        content["cracks"] = cracks
    write_result(folders.run, content)
    for name, folder in folders.parts.items():
        write_result(folder, results[name])
    return content


def result_of_part(result: dict, content: Mapping, experiment: str, names: Mapping[str, str]) -> None:
    """Give the result of one experiment the standard deviations that all of them have together."""
    for name, entry in result["parameters"].items():
        shared = content["parameters"][names[name]]
        entry.update({key: shared[key] for key in OF_ALL if key in shared})
    result["has_force"] = content["has_force"]
    short = {joint: name for name, joint in names.items()}
    for key in ("correlation", "M"):
        if key in content:
            places = [i for i, name in enumerate(content[key]["names"]) if name in short]
            matrix = np.array(content[key]["matrix"]).reshape(len(content[key]["names"]), -1)
            result[key] = {"names": [short[content[key]["names"][i]] for i in places],
                           "matrix": matrix[np.ix_(places, places)].tolist()}
    result["derived"] = derived_of_part(content["derived"], experiment, content["experiments"])
    result["not_identifiable"] = [entry | {"name": short[entry["name"]]} for entry in content["not_identifiable"]
                                  if entry["name"] in short]
    result["notes"] = [*result["notes"], "Identified together with other experiments ("
                       + ", ".join(content["experiments"])
                       + "): standard deviations and correlations are those of all."]


def derived_of_part(derived: Mapping[str, dict], experiment: str, experiments: Iterable[str]) -> dict[str, dict]:
    """The derived quantities of one experiment under its own names, without those of the other experiments.

    derived : of the whole, ``NAME.SET.K`` and ``NAME.SET.E1/E2`` those of an experiment
    """
    prefixes = tuple(f"{name}." for name in experiments if name != experiment)
    return {"/".join(side.removeprefix(f"{experiment}.") for side in label.split("/")): entry
            for label, entry in derived.items() if not any(side.startswith(prefixes) for side in label.split("/"))}


def _residual(results: Mapping[str, dict]) -> dict:
    """The fit of all experiments: chi2 over all pixels, every channel under the name of its experiment."""
    pixels = {name: sum(f["n_pixels"] or 0 for f in part["frames"] if f["status"] == "ok" and not f["reference"])
              for name, part in results.items()}
    compared = [name for name, part in results.items()
                if part["residual"]["image_chi2_dof"] is not None and pixels[name]]
    total = sum(pixels[name] for name in compared)

    def mean(key: str, power: int) -> float | None:
        if not total:
            return None
        value = sum(pixels[name] * results[name]["residual"][key] ** power for name in compared) / total
        return value ** (1.0 / power)

    lost = [part["residual"]["lost_pixels"] for part in results.values()]
    summary = {"image_rms_gv": mean("image_rms_gv", 2), "image_chi2_dof": mean("image_chi2_dof", 1),
               "lost_pixels": None if None in lost else sum(lost)}
    for key in ("channel_rms", "channel_chi2_dof", "channel_noise_std"):
        summary[key] = {f"{name}.{column}": value for name, part in results.items()
                        for column, value in part["residual"][key].items()}
    return summary
