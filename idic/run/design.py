"""`idic design`: the expected standard deviations of planned tests, as design.json, design.html, figures and a table.

Keys of design.json (schema ``idic.design/1``): ``plans``, one entry per experiment; ``joint``, all of them identified
together; ``comparison``, the standard deviation of every parameter in every plan. An entry of ``plans`` holds

``parameters``
    per free parameter: ``value``, ``unit``, expected ``std`` (null: not determined), ``relative_std``; ``grade`` (well
    | fair | poor | open); ``std_images_only``, without the channels; ``std_test_known``, if boundary, camera, channels
    and geometry were known; ``motion_px`` in ``motion_frame``: largest max |lambda dU/dlambda|, the scaling constants
    of Neggers et al. 2015.
``M``, ``eigenvalues``, ``eigenvectors``, ``condition``
    The correlation matrix in scaled unknowns (ln of positive parameters) and its spectrum, strongest first.
``directions``
    per eigenvector: ``text``, ``std``, ``determined``, ``fixed`` (what a weak pair leaves fixed).
``correlation``, ``confusable``, ``alike``, ``not_identifiable``, ``derived``
    as in result.json; pairs with |correlation| above the limit (null: only their combination is determined) and pairs
    whose sensitivity fields are alike.
``without_channels``
    what the images alone leave open, entries as in ``not_identifiable``.
``growth``
    standard deviations after the first frames: ``frames``, ``std``.
``pattern``, ``noise``, ``channels``, ``assumptions``
    what was taken for granted.
``separation``
    of the candidates of a diagnosed RUN (`idic.run.separation.separate`), with ``--separate``.
``points``
    of a plan with measured fields, else null: ``number`` on the specimen; ``pitch``, their distance, in ``unit`` (mm;
    px without a scale): it is one px of ``motion_px``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from idic.errors import InputError
from idic.identification import Design, JointDesign, Plan, joint_names
from idic.inside import folder_inside, write_inside
from idic.report import MIN_CONFUSABLE_CORRELATION, PlanPictures, design_content, design_files, plan_pictures
from idic.run.separation.members import diagnosed
from idic.run.separation.separate import separation_content
from idic.run.store.result_file import write_json
from idic.run.workers.dask_executor import default_workers, open_cluster
from idic.run.workers.runner import Progress

DESIGN_FILE, PAGE_FILE = "design.json", "design.html"


@dataclass(frozen=True)
class DesignJob:
    """One plan to be evaluated: a task."""

    name: str
    plan: Plan


def write_design(paths: Sequence[Path | str], out: Path | str, overrides: Mapping[str, Any] | None = None,
                 noise_std_gv: float | None = None, confusable: float = MIN_CONFUSABLE_CORRELATION,
                 workers: int | None = None, stage: Callable[[str], None] = lambda text: None,
                 progress: Progress | None = None, separate: Path | str | None = None) -> dict:
    """Evaluate planned tests and write ``design.json``, ``design.html``, ``design.csv`` and ``figures`` into `out`.

    Arguments, errors and what is returned as `evaluate_plans`; nothing is written where one of the plans is not
    as expected. stage : called with the name of every step that begins; separate : a diagnosed RUN whose candidates the
    plans shall tell apart.
    """
    if separate is not None:
        diagnosed(separate)  # refuses before anything is simulated
    stage("simulations and sensitivities")
    content, pictures = evaluate_plans(paths, overrides, noise_std_gv, confusable, workers, progress)
    if separate is not None:
        stage("candidates in the plans, and the search for the best course")
        content["separation"] = separation_content(separate, paths, plan_names(paths), overrides, noise_std_gv,
                                                   progress)
    stage("figures and page")
    out = Path(out)
    files = design_files(content, pictures)
    folder_inside(out)
    folder_inside(out, "figures")
    for name, data in files.items():
        write_inside(out, name, data)
    write_json(out / DESIGN_FILE, content)
    return content


def evaluate_plans(paths: Sequence[Path | str], overrides: Mapping[str, Any] | None = None,
                   noise_std_gv: float | None = None, confusable: float = MIN_CONFUSABLE_CORRELATION,
                   workers: int | None = None, progress: Progress | None = None) -> tuple[dict, list[PlanPictures]]:
    """Evaluate planned tests.

    Parameters
    ----------
    paths : experiment folders (or TOML files); [design] says what is planned where images or log are missing
    noise_std_gv : image noise, over what the experiments say
    confusable : |correlation| above which two parameters count as confusable
    workers : processes; None: one per experiment as far as there are cores, 0: all in this process
    progress : called with the number of finished plans and of all, after each

    Returns
    -------
    The content of design.json, and the further data of the figures of each plan.

    Raises
    ------
    InputError
        Anything in an experiment that is not as expected; materials of one name in several experiments that an
        identification would refuse.
    NotConverged
        If a simulation does not reach its end.
    """
    if not 0.0 < confusable < 1.0:
        raise InputError("not a correlation", key="--confusable", expected="a number between 0 and 1",
                         found=f"{confusable:g}", remedy="give for instance 0.95")
    jobs = [DesignJob(name, Plan.of(path, overrides, noise_std_gv))
            for path, name in zip(paths, plan_names(paths), strict=True)]
    joint_names({job.name: job.plan.experiment for job in jobs}, any_unit=True)  # refuses before it is simulated
    n_workers = min(len(jobs), default_workers() if workers is None else workers)
    with open_cluster(n_workers if len(jobs) > 1 and n_workers > 1 else 0) as runner:
        designs = runner.map(run_design, jobs, [f"design-{job.name}" for job in jobs], progress=progress)
    joint = JointDesign.of(designs) if len(designs) > 1 else None
    patterns = [job.plan.pattern for job in jobs]
    return (design_content(designs, joint, patterns, paths, confusable),
            [plan_pictures(design, pattern) for design, pattern in zip(designs, patterns, strict=True)])


def run_design(job: DesignJob) -> Design:
    """Evaluate one plan (a task)."""
    return Design.of(job.name, job.plan.experiment, job.plan.local, job.plan.assumptions)


def plan_names(paths: Sequence[Path | str]) -> list[str]:
    """Short names: folder names (of a TOML file its stem), with more of the path where they are equal."""
    parts = [(p if p.is_dir() else p.with_suffix("")).resolve().parts for p in map(Path, paths)]
    names = [path_parts[-1] for path_parts in parts]
    depth = 1
    while len(set(names)) < len(names) and depth < max(map(len, parts)):
        depth += 1
        names = ["/".join(path_parts[-depth:]) for path_parts in parts]
    if len(set(names)) < len(names):
        raise InputError("an experiment is given twice", key="EXPERIMENT", expected="different experiments",
                         found=", ".join(map(str, paths)), remedy="name each once")
    return names
