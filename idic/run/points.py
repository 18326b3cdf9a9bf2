"""The evaluated points of an identification in a RUN folder, of one experiment or of several.

The state and the RUN folder decide the next step, never this process: a run that was killed resumes where it stood and
ends with the same bits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from idic.identification import DiscrepancySystem, Evaluation, Joint, LoopState, Trial, resolve_stages, start
from idic.model import Experiment
from idic.run.part_points import PartPoints, simulate_trials
from idic.run.prepared.session import Timing
from idic.run.search import start_values
from idic.run.store.run_folders import RunFolders
from idic.run.store.state_file import load_state, save_state


@dataclass(frozen=True)
class RunPoints:
    """The points of a prepared RUN, and the files written at its end. See `idic.identification.driver.PointStore`."""

    folders: RunFolders
    parts: Mapping[str, PartPoints]
    joint: Joint
    timing: Timing

    @property
    def experiment(self) -> Experiment:
        return self.joint.whole

    @property
    def image_noise(self) -> float:
        """That of the first experiment."""
        return next(iter(self.noises.values()))

    @property
    def noises(self) -> dict[str, float]:
        """The noise of the images of every experiment, GV after the low-pass."""
        return {name: part.image_noise for name, part in self.parts.items()}

    def state(self) -> LoopState:
        state = load_state(self.folders.run)
        if state is None:
            state = self._first_state()
            self._save(state)
        elif any(load_state(folder) != self.joint.state_of(name, state)
                 for name, folder in self.folders.below.items()):
            self._save(state)  # a kill came between the state of all and those of the parts
        return state

    def _first_state(self) -> LoopState:
        """The state at the start, which a search moves where there is one experiment."""
        part = next(iter(self.parts.values()))
        values = start_values(part.session) if self.joint.single else None
        state = start(self.joint.whole, searched=values is not None)
        for part in self.parts.values():
            part.write_first_start()
        return state if values is None else replace(state, trial=Trial(dict(values)))

    def simulate(self, trials: Sequence[LoopState]) -> list[str]:
        reasons = iter(simulate_trials([(part.session, self.joint.state_of(name, trial)) for trial in trials
                                        for name, part in self.parts.items()], self.timing))
        return [self.joint.reason({name: next(reasons) for name in self.parts}) for _ in trials]

    def correlate(self, trials: Sequence[LoopState], failed: Sequence[str]) -> list[Evaluation]:
        return [Evaluation(trial.evaluations, None, None, reason) if reason else self._correlated(trial)
                for trial, reason in zip(trials, failed, strict=True)]

    def _correlated(self, trial: LoopState) -> Evaluation:
        stage = resolve_stages(self.joint.whole)[trial.schedule.stage]
        return self.joint.combine({name: part.correlate(self.joint.state_of(name, trial), stage)
                                   for name, part in self.parts.items()}, self.noises)

    def accepted(self, state: LoopState) -> Evaluation | None:
        if state.accepted is None:
            return None
        return self.joint.combine({name: part.accepted(state) for name, part in self.parts.items()}, self.noises)

    def keep(self, state: LoopState, points: Sequence[Evaluation], previous: Evaluation | None) -> None:
        for name, part in self.parts.items():
            part.write_points(self.joint.state_of(name, state), [point.part(name) for point in points],
                              None if previous is None else previous.part(name))
        self._save(state)
        for part in self.parts.values():
            part.remove_points(state)

    def postprocess(self, state: LoopState, began: float) -> dict:
        """Residual maps and a result per experiment; of several then that of all in ``RUN/result.json``."""
        from idic.run.postprocess import postprocess  # here: an identification begins sooner

        stage = resolve_stages(self.joint.whole)[state.schedule.stage]
        results = {name: postprocess(part.session, self.joint.state_of(name, state), self.timing, began, stage)
                   for name, part in self.parts.items()}
        if self.joint.single:
            return next(iter(results.values()))
        return self._joint_result(state, results, {name: part.discrepancy(state) for name, part in self.parts.items()})

    def write_interrupted(self, began: float) -> dict | None:
        """The accepted point as a result; nothing where there is none."""
        from idic.run.postprocess import write_interrupted

        running = load_state(self.folders.run)
        if running is None or running.accepted is None:
            return None
        state = replace(running, status="interrupted")
        results = {name: write_interrupted(part.session, self.joint.state_of(name, state), self.timing, began)
                   for name, part in self.parts.items()}
        return next(iter(results.values())) if self.joint.single else self._joint_result(state, results, None)

    def _joint_result(self, state: LoopState, results: Mapping[str, dict],
                      discrepancies: Mapping[str, DiscrepancySystem | str] | None) -> dict:
        from idic.run.joint_result import write_joint_result  # here: most runs are of one experiment

        return write_joint_result(self.folders, self.joint, state, self.accepted(state), self.noises, results,
                                  discrepancies, {name: part.session.context for name, part in self.parts.items()})

    def _save(self, state: LoopState) -> None:
        save_state(self.folders.run, state)
        for name, folder in self.folders.below.items():
            save_state(folder, self.joint.state_of(name, state))
