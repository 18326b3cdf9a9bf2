"""Several experiments in one RUN: a folder per experiment under ``RUN/experiments``, one state for all.

``RUN/experiments/NAME`` is a whole RUN (images, simulations, residual maps, result, report); all experiments together
choose its steps. ``RUN/joint.json`` names them, ``RUN/state.json`` is the state that counts, and each experiment keeps
its view of it.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from idic.identification import DiscrepancySystem, Evaluation, Joint, LoopState, join, joined, resolve_stages, start
from idic.model import Experiment
from idic.run.joint_result import JointEvaluation, joint_result, result_of_part
from idic.run.points import RunPoints, simulate_trials
from idic.run.prepared.session import Timing
from idic.run.recovery.recover import finished_result, restored, result_of_state, start_over
from idic.run.runs import Progress, SingleRun, earlier_run
from idic.run.store.checkpoint import load_checkpoint, save_checkpoint
from idic.run.store.discrepancy_store import load_discrepancy
from idic.run.store.layout import EXPERIMENTS
from idic.run.store.run_store import RunStore
from idic.run.store.state_file import STATE_FILE, load_state, save_state
from idic.run.workers.probe import ExperimentToSee
from idic.run.workers.runner import TaskRunner

DESCRIPTION, SCHEMA = "joint.json", "idic.joint/1"


def is_joint(run: Path | str) -> bool:
    """Whether a RUN folder holds several experiments that were identified together."""
    return (Path(run) / DESCRIPTION).exists()


def folders_of(run: Path | str) -> dict[str, Path]:
    """The folders of the experiments of a joint RUN, by their names."""
    names = load_checkpoint(Path(run) / DESCRIPTION, SCHEMA)["names"]
    return {name: Path(run) / EXPERIMENTS / name for name in names}


@dataclass(frozen=True)
class JointRun:
    """Several experiments in one RUN folder. See `idic.run.runs.Run`."""

    store: RunStore
    parts: Mapping[str, SingleRun]
    joint: Joint

    @classmethod
    def planned(cls, paths: Sequence[str | Path], out: str | Path, overrides: dict) -> JointRun:
        """Read all experiments; see `plan_run`."""
        parts = {name: SingleRun(RunStore(Path(out) / EXPERIMENTS / name), str(path), overrides)
                 for name, path in zip(experiment_names(paths), paths, strict=True)}
        return cls(RunStore(out), parts, join({name: part.experiment for name, part in parts.items()}))

    def check(self, sensitivity: str) -> None:
        """Everything that can be wrong before something is written."""
        for part in self.parts.values():
            part.check(sensitivity)
        start(self.joint.whole)

    @contextmanager
    def claim(self, resume: bool) -> Iterator[None]:
        """Lock the folders; an existing run is resumed with --resume only."""
        if not resume and is_joint(self.store.run):
            raise earlier_run(self.store.run)
        identity = hashlib.sha256("\n".join(
            f"{name} {part.experiment.identity}" for name, part in self.parts.items()).encode()).hexdigest()
        with ExitStack() as stack:
            stack.enter_context(self.store.claim(identity, title=self.joint.whole.title))
            for part in self.parts.values():
                stack.enter_context(part.claim(resume=True))
            save_checkpoint(self.store.run / DESCRIPTION, SCHEMA, {"names": list(self.parts)})
            yield

    def recover(self, runner: TaskRunner) -> list[str]:
        """See `recovery.recover`; where one experiment has to start over, all do."""
        found = [*restored(self.store, (STATE_FILE,)),
                 *(f"{name}: {text}" for name, part in self.parts.items() for text in part.recover(runner))]
        begun = (self.store.run / STATE_FILE).exists()
        if begun and not all((part.store.run / STATE_FILE).exists() for part in self.parts.values()):
            for store in (self.store, *(part.store for part in self.parts.values())):
                start_over(store)
        return found

    @property
    def worth_scanning_by_workers(self) -> bool:
        return any(part.worth_scanning_by_workers for part in self.parts.values())

    def finished_result(self) -> dict | None:
        result = result_of_state(self.store)
        whole = result is not None and all(finished_result(part.store) is not None for part in self.parts.values())
        return result if whole else None

    def ingest(self, runner: TaskRunner, progress: Callable[[int, int], None] | None = None) -> None:
        for part in self.parts.values():
            part.ingest(runner, progress)

    @property
    def prepared(self) -> bool:
        return all(part.prepared for part in self.parts.values())

    @property
    def measures(self) -> bool:
        return any(part.measures for part in self.parts.values())

    @property
    def worth_workers(self) -> bool:
        return any(part.worth_workers for part in self.parts.values())

    @property
    def first_job(self) -> tuple[str, str, dict]:
        return next(iter(self.parts.values())).first_job

    @property
    def to_see(self) -> tuple[ExperimentToSee, ...]:
        return tuple(one for part in self.parts.values() for one in part.to_see)

    @property
    def n_stages(self) -> int:
        return len(resolve_stages(self.joint.whole))

    def prepare(self, runner: TaskRunner) -> None:
        for part in self.parts.values():
            if not part.prepared:
                part.prepare(runner)

    def open_points(self, runner: TaskRunner, sensitivity: str, timing: Timing, tasks: Progress | None = None,
                    say: Callable[[str], None] | None = None) -> JointPoints:
        parts = {name: part.open_points(runner, sensitivity, timing, tasks, say) for name, part in self.parts.items()}
        return JointPoints(self.store.run, parts, join({name: part.experiment for name, part in parts.items()}), timing)


@dataclass(frozen=True)
class JointPoints:
    """The points of several RUN folders with one state. See `idic.run.runs.Points`."""

    run: Path
    parts: Mapping[str, RunPoints]
    joint: Joint
    timing: Timing

    @property
    def experiment(self) -> Experiment:
        return self.joint.whole

    @property
    def folders(self) -> list[Path]:
        return [folder for part in self.parts.values() for folder in part.folders]

    @property
    def image_noise(self) -> float:
        """That of the first experiment."""
        return next(iter(self.parts.values())).image_noise

    def state(self) -> LoopState:
        state = load_state(self.run)
        if state is None:
            state = start(self.joint.whole)
            for part in self.parts.values():
                part.first_state()
            self._save(state)
        elif any(load_state(part.session.run) != self.joint.state_of(name, state) for name, part in self.parts.items()):
            self._save(state)  # a kill came between the state of all and those of the parts
        return state

    def simulate(self, trials: Sequence[LoopState]) -> list[str]:
        jobs = [(part.session, self.joint.state_of(name, trial)) for trial in trials
                for name, part in self.parts.items()]
        said = iter(simulate_trials(jobs, self.timing))
        own = [[(name, next(said)) for name in self.parts] for _ in trials]
        return ["; ".join(f"{name}: {why}" for name, why in one if why) for one in own]

    def correlate(self, trials: Sequence[LoopState], failed: Sequence[str]) -> list[JointEvaluation]:
        found = []
        for trial, why in zip(trials, failed, strict=True):
            stage = resolve_stages(self.joint.whole)[trial.schedule.stage]
            parts = {name: Evaluation(trial.evaluations, None, None, why) if why else
                     part.correlate_trial(self.joint.state_of(name, trial), stage) for name, part in self.parts.items()}
            found.append(JointEvaluation(trial.evaluations, None, None, why, parts=parts) if why
                         else self._combined(parts))
        return found

    def accepted(self, state: LoopState) -> JointEvaluation | None:
        if state.accepted is None:
            return None
        return self._combined({name: part.accepted(state) for name, part in self.parts.items()})

    def keep(self, state: LoopState, points: Sequence[JointEvaluation], previous: JointEvaluation | None) -> None:
        for name, part in self.parts.items():
            before = None if previous is None else previous.parts[name]
            part.write_points(self.joint.state_of(name, state), [point.parts[name] for point in points], before)
        self._save(state)
        for part in self.parts.values():
            part.remove_points(state)

    def postprocess(self, state: LoopState, began: float) -> dict:
        """Residual maps and a result per experiment, then that of all in ``RUN/result.json``."""
        stage = resolve_stages(self.joint.whole)[state.schedule.stage]
        own = {name: part.postprocess(self.joint.state_of(name, state), began, stage)
               for name, part in self.parts.items()}
        made = {name: load_discrepancy(part.session.context.store, state.accepted.number) if state.accepted is not None
                else "no simulation converged" for name, part in self.parts.items()}
        return self._write(state, own, joined(made, self.joint.whole.parameters.free, self.joint.names), made)

    def write_interrupted(self, began: float) -> dict | None:
        state = load_state(self.run)
        if state is None or state.accepted is None:
            return None
        own = {name: part.write_interrupted(began) for name, part in self.parts.items()}
        return self._write(replace(state, status="interrupted"), own, "the run was interrupted: std counts noise alone")

    def _write(self, state: LoopState, own: Mapping[str, dict], discrepancy: DiscrepancySystem | str,
               parts: Mapping[str, DiscrepancySystem | str] | None = None) -> dict:
        result = joint_result(self.run, self.joint, state, self.accepted(state), self._noise, own, discrepancy, parts)
        for name, part in self.parts.items():
            result_of_part(Path(part.session.run), own[name], result, name, self.joint.names[name])
        return result

    @property
    def _noise(self) -> dict[str, float]:
        return {name: part.image_noise for name, part in self.parts.items()}

    def _save(self, state: LoopState) -> None:
        save_state(self.run, state)
        for name, part in self.parts.items():
            save_state(part.session.run, self.joint.state_of(name, state))

    def _combined(self, parts: Mapping[str, Evaluation]) -> JointEvaluation:
        whole = self.joint.combine(parts, self._noise)
        return JointEvaluation(whole.number, whole.system, whole.reference_gram, whole.message, whole.increments,
                               whole.intervals, parts)


def experiment_names(paths: Sequence[str | Path]) -> list[str]:
    """Names of the experiments: those of their folders, numbered where two are alike."""
    names: list[str] = []
    for path in paths:
        path = Path(path).resolve()
        folder = path.parent if path.suffix == ".toml" else path
        stem = re.sub(r"[^A-Za-z0-9_-]+", "_", folder.name) or "experiment"
        number, name = 1, stem
        while name in names:
            number += 1
            name = f"{stem}_{number}"
        names.append(name)
    return names
