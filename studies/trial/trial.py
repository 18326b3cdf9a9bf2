"""One trial, from its sealed truth to the answer of the tool, in one process: `run_trial`.

The generator opens the seal and writes a folder without the truth; the tool gets the path of that folder only.
"""

from __future__ import annotations

import os
import tempfile
import traceback
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idic.errors import NotConverged
from idic.plain_values import finite
from idic.run import write_json
from idic_studies.trial.plan import Truth, paint_of, scene_of
from idic_studies.trial.scenes.calculix import calculix, solve_with_calculix
from idic_studies.trial.scenes.recording import write_public
from idic_studies.trial.scenes.scene import Scene
from idic_studies.trial.scenes.solve import Motion, campaign_mesh, solve
from idic_studies.trial.seal import Folder, opened
from idic_studies.trial.tool_run import run_tool

NOT_GENERATED = "not_generated"  # verdict where the simulation of the truth failed


@dataclass(frozen=True)
class TrialJob:
    """A trial to run: folder of the trials, ID; with_ablations : with ablations and decoys, never in a drawn world."""

    out: str
    number: str
    with_ablations: bool = True


def check_solvers(folder: Folder, numbers: Iterable[str]) -> None:
    """`InputError` where a truth needs CalculiX and CalculiX is not installed."""
    if any(opened(folder, number).solver == "calculix" for number in numbers):
        calculix()


def run_trial(job: TrialJob) -> str:
    """Generate the recording, run the tool, write its answer (a task); returns the ID. A crash counts as an answer."""
    folder = Folder(Path(job.out))
    truth = opened(folder, job.number)
    with tempfile.TemporaryDirectory(prefix="trial-") as public:
        try:
            scene = scene_of(truth)
            write_public(Path(public), scene, motion_of(folder, job.number, truth, scene), paint_of(truth))
        except NotConverged as problem:  # no recording
            answer: dict = {"verdict": NOT_GENERATED, "problem": str(problem)}
        else:
            answer = _answer(Path(public), job.with_ablations and not truth.world)
    answer["attempt"] = 1 + _attempts(folder, job.number)
    folder.answer(job.number).parent.mkdir(parents=True, exist_ok=True)
    write_json(folder.answer(job.number), finite(answer))
    return job.number


def _answer(public: Path, with_ablations: bool) -> dict:
    try:
        return run_tool(public, with_ablations=with_ablations).content
    except NotConverged as problem:
        return {"verdict": "failed", "problem": str(problem)}
    except Exception:  # noqa: BLE001  one broken trial must not end the others, and counts as a wrong answer
        return {"verdict": "failed", "problem": traceback.format_exc(limit=8)}


def _attempts(folder: Folder, number: str) -> int:
    """Number of earlier answers of this trial: an answer may be deleted, its count stays."""
    counter = folder.out / "attempts" / number
    counter.parent.mkdir(parents=True, exist_ok=True)
    with counter.open("ab") as file:
        n_answers = os.fstat(file.fileno()).st_size
        file.write(b".")
    return n_answers


def motion_of(folder: Folder, number: str, truth: Truth, scene: Scene | None = None) -> Motion:
    """The motion of a trial, solved once and stored."""
    scene, path = scene_of(truth) if scene is None else scene, folder.motion(number)
    mesh = campaign_mesh(scene)
    if not path.exists():
        motion = (solve_with_calculix if truth.solver == "calculix" else solve)(scene, mesh)
        path.parent.mkdir(parents=True, exist_ok=True)
        _store(path, {"u": motion.u, "force": motion.force})
    with np.load(path, allow_pickle=False) as stored:
        return Motion(mesh, stored["u"], stored["force"])


def _store(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays whole or not at all."""
    with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as file:
        np.savez_compressed(file, **arrays)
    os.replace(file.name, path)
