"""Resuming a RUN: everything that the next steps need is read once (`scan`), and damaged groups are computed anew.

Damage that shows up later, while a run is at work, ends it with a message; `--resume` then comes here.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from idic.errors import InputError
from idic.fe import sweep
from idic.identification import LoopState
from idic.run.prepared.prepare import write_description
from idic.run.recovery.scan import damaged_groups
from idic.run.store.checkpoint import load_checkpoint, remove_checkpoint, restore_checkpoint
from idic.run.store.layout import BASE, DESCRIPTION, DESCRIPTION_SCHEMA, FIELDS, FLOOR, FREE, SCRATCH, group_name
from idic.run.store.result_file import read_result
from idic.run.store.run_store import RunStore
from idic.run.store.stack import GROUP as IMAGES
from idic.run.store.state_file import STATE_FILE, load_state
from idic.run.workers.runner import SerialRunner, TaskRunner

EVALUATIONS = "evaluations"
START, SYSTEM = "start", "system"
OF_THE_END = ("channels", "final")  # groups that the end of a run writes


def recover(store: RunStore, path: Path | str, runner: TaskRunner) -> list[str]:
    """Remove damaged data from a claimed RUN, so that they are computed anew; returns a line per finding.

    path : where the experiment lies now; it may have moved since the run began
    runner : reads a large RUN side by side

    A damaged image is ingested again, a damaged simulation of the open trial is repeated. Where the accepted point
    itself is damaged, the run starts over: its steps are the same, so its end has the same bits.

    Raises
    ------
    InputError
        The description or the state of the run is damaged, and so is its copy (they are small texts with a checksum).
    """
    lines = restored(store, (DESCRIPTION, STATE_FILE))
    sweep(store.run / SCRATCH)
    settings = load_checkpoint(store.run / DESCRIPTION, DESCRIPTION_SCHEMA)
    state = load_state(store.run)
    measured = ["dic", "motion", "prepared", *(f"cameras/{camera}/dic" for camera in _further(store))]
    measured = [name for name in measured if (store.path / name).exists()]
    needed, tried = ([], []) if state is None else (_needed(store, state), _of_the_open_trial(store, state))
    damaged = damaged_groups(store, [*measured, *needed, *tried], _image_groups(store), runner)
    for name in [name for name in _image_groups(store) if name in damaged]:
        store.remove(name)
        lines.append("stored images are damaged: they are read again")
    if settings is not None and settings["experiment"] != str(Path(path).resolve()):
        write_description(store.run, settings | {"experiment": str(Path(path).resolve())})
    spoilt = [name for name in measured if name in damaged]
    if spoilt or (settings is not None and store.finished("prepared") is None):
        for name in spoilt:
            store.remove(name)
        remove_checkpoint(store.run / DESCRIPTION)
        start_over(store)
        return [*lines, "the preparation (noise, measured motion) is damaged: the run starts over, with the same end"]
    if state is None:
        if not any((store.path / name).exists() for name in OF_THE_END):
            return lines
        start_over(store)  # points of a run that had ended lack what only further steps read
        return [*lines, f"{STATE_FILE} is lost: the run starts over, with the same end"]
    if damaged.intersection(needed):
        start_over(store)
        return [*lines, "the accepted point is damaged: the run starts over, with the same end"]
    for name in [name for name in tried if name in damaged]:
        store.remove(name)
        lines.append(f"{name} is damaged: it is computed again")
    return lines


def restored(store: RunStore, names: Iterable[str]) -> list[str]:
    """Restore the damaged or lost ones of these files from their copies; returns a line per file."""
    return [f"{name} is damaged: its copy takes its place" for name in names if restore_checkpoint(store.run / name)]


def finished_result(store: RunStore) -> dict | None:
    """The result of a run that has ended and whose files are whole; None where something is still to be done."""
    result = result_of_state(store)
    if result is None:
        return None
    return None if damaged_groups(store, _shown(store), (), SerialRunner()) else result


def _shown(store: RunStore) -> list[str]:
    """Groups that a finished run keeps for its report (`idic.run.postprocess`)."""
    state = load_state(store.run)
    if state.accepted is None:
        return []
    return [*OF_THE_END, *(f"cameras/{camera}/final" for camera in _further(store)), *_judged(store)]


def _judged(store: RunStore) -> list[str]:
    """Groups of the judgement, where they were made."""
    return [name for name in (FREE, FIELDS, FLOOR) if (store.path / name).exists()]


def remove_damaged_judgement(store: RunStore) -> None:
    """Remove damaged groups of the judgement, so that they are made anew."""
    for name in damaged_groups(store, _judged(store), (), SerialRunner()):
        store.remove(name)


def result_of_state(store: RunStore) -> dict | None:
    """The result file of a run that has ended, where it belongs to the state in which it did."""
    state = load_state(store.run)
    if state is None or state.running:
        return None
    result = _result(store.run)
    matches = (result.get("status"), result.get("evaluations")) == (state.status, state.evaluations)
    return result if matches else None


def _result(run: Path) -> dict:
    try:
        return read_result(run)
    except (InputError, OSError):
        return {}


def _needed(store: RunStore, state: LoopState) -> list[str]:
    """Groups that cannot be computed anew from the state alone: the first and the accepted point, where the open trials
    start."""
    must = set()
    if state.accepted is not None:
        for number in {0, state.accepted.number}:
            must |= {group_name(number, label) for label in (START, SYSTEM)}
            must |= {_stored_name(folder) for folder in _simulations(store, number)}
        must.add(group_name(state.accepted.number, BASE))
    if state.running:
        must |= {group_name(trial.evaluations, START) for trial in state.trial_states}
    return sorted(must)


def _of_the_open_trial(store: RunStore, state: LoopState) -> list[str]:
    """The stored groups of the trial that was being evaluated, and of those beside it."""
    return [_stored_name(folder) for trial in state.trial_states for folder in _simulations(store, trial.evaluations)]


def _simulations(store: RunStore, number: int) -> list[Path]:
    """The stored groups of an evaluated point, its start included."""
    folders = sorted((store.path / EVALUATIONS / f"{number:03d}").glob("*/"))
    return [folder for folder in folders if not folder.name.startswith(".")]


def _stored_name(folder: Path) -> str:
    """The group of a folder in ``evaluations``."""
    return f"{EVALUATIONS}/{folder.parent.name}/{folder.name}"


def start_over(store: RunStore) -> None:
    """Forget every evaluated point; the preparation stays."""
    remove_checkpoint(store.run / STATE_FILE)
    store.remove(EVALUATIONS)


def _further(store: RunStore) -> list[str]:
    """Names of the further cameras of a RUN."""
    return sorted(folder.name for folder in (store.path / "cameras").glob("*/") if not folder.name.startswith("."))


def _image_groups(store: RunStore) -> list[str]:
    names = [IMAGES, *(f"cameras/{camera}/{IMAGES}" for camera in _further(store))]
    return [name for name in names if (store.path / name).exists()]
