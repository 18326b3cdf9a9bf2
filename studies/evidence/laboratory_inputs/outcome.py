"""What a door made of an input: right, refused with a reason, or wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from idic.errors import InputError
from idic.experiment_file import load_experiment
from idic.report import check

RIGHT, REFUSED, WRONG = "right", "refused", "wrong"


@dataclass(frozen=True)
class Input:
    """kind : of section 1 or 2; name : of the input; judge : folder -> outcome and what was found"""

    kind: str
    name: str
    judge: Callable[[Path], tuple[str, str]]


def outcome(case: Input, folder: Path) -> tuple[str, str]:
    """The outcome; a refusal counts where it names what was expected and what to do."""
    try:
        return case.judge(folder)
    except InputError as problem:
        has_reason = bool(problem.what and problem.remedy)
        return (REFUSED if has_reason else WRONG), problem.what
    except Exception as problem:  # noqa: BLE001  # a crash at a door is an outcome, too
        return WRONG, f"a crash: {problem!r}"


def right_if(is_right: object, found: object = "") -> tuple[str, str]:
    """Right or wrong, with what was found."""
    return (RIGHT if is_right else WRONG), str(found)


def order_of(folder: Path) -> list[str]:
    """The images in the order of the experiment, once `check` has accepted it."""
    experiment = load_experiment(folder)
    check(experiment, draw=False)
    return list(experiment.recording.labels)


def warnings_of(folder: Path) -> str:
    """The warnings of `check`, all cameras together."""
    report = check(load_experiment(folder), draw=False)
    return " ".join([*report.warnings, *(text for camera in report.cameras for text in camera.warnings)])
