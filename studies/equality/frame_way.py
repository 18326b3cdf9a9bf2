"""How far it is from `identify` to the equation that runs, and what one frame passes through.

    python -m idic_studies.equality.frame_way

A strip is identified in memory; the third frame is followed from `frame_system` on. What is printed: the functions and
files from the call to the image kernel; the files of which the frame runs a function (properties of records apart);
how often a frame makes what it should make once.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter as Counts
from collections.abc import Iterator
from contextlib import redirect_stdout
from dataclasses import dataclass, field, replace
from io import StringIO
from pathlib import Path
from types import CodeType, FrameType, FunctionType, ModuleType
from typing import Any

import numpy as np

import idic
from idic.experiment_file import load_experiment
from idic.identification import identify
from idic.images import ArrayStack
from idic.model import Experiment
from idic_studies.equality.counting import Counter
from idic_studies.equality.strips import Strip, write_recorded
from idic_studies.equality.workshop import Workshop

SOURCE = Path(idic.__file__).parent
FOLLOWED = 3  # the frame of the strip that is followed: the first ones compile
ENTRY, FRAME, KERNEL = "identify", "frame_system", "image_pass"  # functions
ONCE = {  # what a frame makes once: the function that makes it
    "motion in the image": "image_motion", "coefficients of the elements": "PixelMap.element_coefficients",
    "inverse gradients of the elements": "inverse_gradients", "gradients of the elements": "PixelMap.element_gradients",
    "gradient at the nodes": "Model.nodal_gradient", "Jacobian of the camera at the nodes": "Camera.jacobian",
    "image pass": KERNEL, "spline of the frame": "prefilter",
}
Place = tuple[str, str]  # file, function


@dataclass
class FrameWay:
    """What was seen.

    way : from the call to the image kernel; calls : of every function that the followed frame runs; properties : those
    of them that are properties of a record
    """

    way: tuple[Place, ...] = ()
    calls: Counts[Place] = field(default_factory=Counts)
    properties: set[Place] = field(default_factory=set)

    @property
    def files(self) -> set[str]:
        """The files of which the frame runs a function."""
        return {file for file, name in self.calls if (file, name) not in self.properties}

    def times(self, function: str) -> int:
        """How often the frame runs a function."""
        return sum(number for (_, name), number in self.calls.items() if name == function)


def strip() -> Experiment:
    """The strip of the bench, its images in memory."""
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(StringIO()):
        write_recorded(Workshop(Path(folder), Counter({})), "test", Strip(), seed=5)
        experiment = load_experiment(Path(folder) / "test")
        stack = ArrayStack(np.array([experiment.recording.stack.frame(k) for k in range(experiment.model.n_frames)]))
    return replace(experiment, recording=replace(experiment.recording, stack=stack))


def followed(experiment: Experiment) -> FrameWay:
    """Identify the experiment twice, the first time to compile, and follow one of its frames the second time."""
    identify(experiment)
    tracer = _Tracer()
    sys.setprofile(tracer.profile)
    try:
        identify(experiment)
    finally:
        sys.setprofile(None)
    return tracer.frame_way


class _Tracer:
    """Follows the calls of one frame."""

    def __init__(self) -> None:
        self.frame_way = FrameWay(properties=set(_properties()))
        self._frames, self._depth = 0, 0  # frames that have begun; open functions around the followed one
        self._open: list[Place] = []

    def profile(self, frame: FrameType, event: str, _: Any) -> None:
        """Called by the interpreter at every call and return, by numba at those of compiled functions."""
        if event not in ("call", "return") or not _is_source(frame.f_code):
            return
        if event == "call" and frame.f_code.co_name == FRAME:
            self._frames += 1
            if self._frames == FOLLOWED:
                self._open = _stack(frame.f_back)
                self._depth = len(self._open)
        if self._frames != FOLLOWED or len(self._open) < self._depth:
            return
        if event == "return":
            self._open.pop()
            self._depth += len(self._open) == self._depth  # the followed frame is done
            return
        self._open.append(_place(frame.f_code))
        if "<" not in frame.f_code.co_name:
            self.frame_way.calls[self._open[-1]] += 1
        if frame.f_code.co_name == KERNEL:
            self.frame_way.way = tuple(place for place in self._open if "<" not in place[1].rpartition(".")[2])


def _is_source(code: CodeType) -> bool:
    return code.co_filename.startswith(f"{SOURCE}/")


def _place(code: CodeType) -> Place:
    return str(Path(code.co_filename).relative_to(SOURCE.parent)), code.co_qualname


def _stack(frame: FrameType | None) -> list[Place]:
    """The open functions from `identify` down to a frame of the interpreter."""
    places: list[Place] = []
    while frame is not None:
        if _is_source(frame.f_code):
            places.insert(0, _place(frame.f_code))
        frame = None if frame.f_code.co_name == ENTRY else frame.f_back
    return places


def _modules() -> list[ModuleType]:
    return [module for name, module in sorted(sys.modules.items()) if name.split(".")[0] == "idic"]


def _properties() -> Iterator[Place]:
    """The properties of all classes."""
    for module in _modules():
        for cls in (value for value in list(vars(module).values()) if isinstance(value, type)):
            yield from (_place(value.fget.__code__) for value in vars(cls).values()
                        if isinstance(value, property) and isinstance(value.fget, FunctionType)
                        and _is_source(value.fget.__code__))


def lines(frame_way: FrameWay) -> Iterator[str]:
    """What was seen, in lines."""
    yield f"{len(frame_way.way)} functions, {len({file for file, _ in frame_way.way})} files from {ENTRY} to {KERNEL}:"
    yield from (f"    {file:50} {name}" for file, name in frame_way.way)
    rooms = Counts(file.split("/")[1] for file in frame_way.files)
    yield f"{len(frame_way.files)} files of which a frame runs a function: " + ", ".join(
        f"{number} in {room}" for room, number in sorted(rooms.items()))
    yield from (f"    {file}" for file in sorted(frame_way.files))
    records = {file for file, _ in frame_way.calls} - frame_way.files
    yield f"{len(records)} files more for a property of a record: {', '.join(sorted(records))}"
    yield "times per frame:"
    yield from (f"    {frame_way.times(function)}  {piece} ({function})" for piece, function in ONCE.items())


if __name__ == "__main__":
    for line in lines(followed(strip())):
        sys.stdout.write(f"{line}\n")
