"""Starts `idic identify` as a process of its own, and looks at its RUN while it is at work.

The page only reads: a RUN goes on, to the same numbers, whether anybody watches or not.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from idic.correlation.view import view_of
from idic.draw.folder import run_folder
from idic.draw.pictures import png
from idic.errors import InputError
from idic.identify.step.state import LoopState
from idic.run.context import RunContext, correlation_context, open_run
from idic.run.postprocess import channel_table
from idic.store.arrays import FrameArrays
from idic.store.layout import BASE, group_name
from idic.store.result_file import read_result
from idic.store.run_lock import is_held
from idic.store.state_file import load_state
from idic.store.system_store import load_evaluation
from idic.workers.working_folder import empty_folder

CONSOLE = ".console.txt"  # FOLDER/runs/NAME.console.txt: what the command says
MAX_MAP_PX = 900  # width of a residual map in the page
RANGE = 4.0  # standard deviations of the noise: full colour
LOG_LINES = 12


def start(folder: Path, name: str) -> subprocess.Popen:
    """`idic identify FOLDER --out FOLDER/runs/NAME`, which outlives this process; a RUN of this name is resumed.

    Raises
    ------
    InputError
        The name is none.
    """
    run = run_folder(folder, name)
    run.parent.mkdir(exist_ok=True)
    resume = ["--resume"] if (run / "run.zarr").exists() else []
    command = [sys.executable, "-m", "idic", "identify", str(folder), "--out", str(run), *resume]
    apart = ({"creationflags": getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)} if os.name == "nt"
             else {"start_new_session": True})
    with open(run.parent / f"{name}{CONSOLE}", "wb") as console:
        return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=console, stderr=subprocess.STDOUT,
                                cwd=empty_folder(), **apart)


def next_name(taken: tuple[str, ...]) -> str:
    """``run-1``, or the first number that is free."""
    return next(name for k in range(1, 10_000) if (name := f"run-{k}") not in taken)


def state_of(folder: Path, name: str) -> dict:
    """Where a RUN stands: its history, the last lines of its log, whether it has a report. Cheap; asked twice a second."""
    run = run_folder(folder, name)
    try:
        state = load_state(run)
    except (InputError, OSError, ValueError):  # just being replaced
        state = None
    lines = _tail(run / "log.txt") or _tail(run.parent / f"{name}{CONSOLE}")
    return {"name": name, "status": state.status if state else "starting", "iteration": state.iteration if state else 0,
            "evaluations": state.evaluations if state else 0, "accepted": state.accepted.number if _accepted(state) else None,
            "history": [_entry(entry) for entry in state.history] if state else [], "log": lines,
            "result": _result(run), "report": (run / "report.html").is_file()}


def _accepted(state: LoopState | None) -> bool:
    return state is not None and state.accepted is not None and state.accepted.number >= 0


def _entry(entry: Mapping) -> dict:
    return {key: entry.get(key) for key in ("evaluation", "accepted", "phi", "rms_gv", "values", "message")}


def _result(run: Path) -> dict | None:
    """Status, parameters and chi² of a finished RUN."""
    if not (run / "result.json").is_file():
        return None
    try:
        result = read_result(run)
    except (InputError, OSError):
        return None
    return {"status": result["status"], "parameters": result["parameters"], "chi2": result["residual"].get("image_chi2_dof"),
            "derived": result.get("derived", {}), "not_identifiable": result.get("not_identifiable", [])}


def _tail(file: Path) -> list[str]:
    try:
        with file.open("rb") as stream:
            stream.seek(0, os.SEEK_END)
            stream.seek(max(stream.tell() - 8192, 0))
            text = stream.read().decode("utf-8", errors="replace")
    except OSError:
        return []
    return [line[:300] for line in text.splitlines() if line.strip()][-LOG_LINES:]


def is_at_work(folder: Path, name: str) -> bool:
    """Whether a process works on the RUN."""
    return is_held(run_folder(folder, name))


@dataclass(frozen=True)
class Point:
    """What the page shows of an accepted point: channels, and the residual of one frame."""

    evaluation: int
    frame: int
    channels: list[dict]
    chi2: float | None
    picture: bytes
    box: tuple[int, int, int, int]  # of the picture in the image, px


@dataclass
class Watcher:
    """The points of the RUNs of one folder; the last one is kept."""

    folder: Path
    _last: tuple[tuple, Point] | None = None
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def point(self, name: str, frame: int | None = None) -> Point | None:
        """The accepted point of a RUN at a frame (None: the last one); None before there is one."""
        run = run_folder(self.folder, name)
        with self._lock:
            state = load_state(run)
            if not _accepted(state):
                return None
            key = (name, state.accepted.number, frame, run.stat().st_ino)
            if self._last is None or self._last[0] != key:
                self._last = (key, _point(open_run(str(run)), state, frame))
            return self._last[1]


def _point(context: RunContext, state: LoopState, frame: int | None) -> Point:
    experiment = context.experiment
    last = experiment.n_frames - 1
    k = last if frame is None else int(np.clip(frame, min(experiment.reference + 1, last), last))
    simulated, measured = channel_table(context, state.accepted.values, state.accepted.number)
    channels = [{"name": channel.column, "simulated": _finite(simulated[:, i]), "measured": _finite(measured[:, i])}
                for i, channel in enumerate(experiment.channels)]
    image, chi2 = _residual(context, state, k)
    picture, box = _coloured(image, experiment.noise.std_gv or float(np.nanstd(image)) or 1.0)
    return Point(state.accepted.number, k, channels, chi2, picture, box)


def _residual(context: RunContext, state: LoopState, frame: int) -> tuple[np.ndarray, float | None]:
    """Residual of a frame in the reference image (NaN where there is none), and its chi² per pixel."""
    number, values = state.accepted.number, state.accepted.values
    shared = correlation_context(context, context.experiment.parameters.with_values(values)).cameras[0]
    experiment = shared.experiment
    system = load_evaluation(context.store, number, context.names).system
    brightness = next((record.brightness_of(0) for record in system.frames if record.frame == frame), np.zeros(0))
    base, first = context.store.group(group_name(number, BASE)), context.experiment.reference
    u = experiment.turned(FrameArrays.open(base, "u").read(frame - first, frame - first + 1)[0])
    motion = view_of(experiment, shared.camera).at(frame).motion(experiment.mesh.nodes, u)
    found = shared.reference.compare_pixels(experiment, frame, motion, brightness)
    image = shared.reference.pixel_map.to_image(np.where(found.valid, found.r, np.nan))
    std = experiment.noise.std_gv
    chi2 = found.chi2_dof(std) if std else float("nan")
    return image, float(chi2) if np.isfinite(chi2) else None


def _coloured(image: np.ndarray, std: float) -> tuple[bytes, tuple[int, int, int, int]]:
    """The residual as a PNG, blue below and red above zero, and the part of the image that it covers."""
    seen = np.isfinite(image)
    if not seen.any():
        return png(np.zeros((1, 1, 4), dtype=np.uint8)), (0, 0, 1, 1)
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    y0, y1, x0, x1 = int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1
    part, seen = np.nan_to_num(image[y0:y1, x0:x1]).astype(np.float32), seen[y0:y1, x0:x1].astype(np.float32)
    if part.shape[1] > MAX_MAP_PX:
        size = (MAX_MAP_PX, max(round(part.shape[0] * MAX_MAP_PX / part.shape[1]), 1))
        part, seen = (cv2.resize(a, size, interpolation=cv2.INTER_AREA) for a in (part, seen))
    scaled = np.clip(part / (RANGE * std), -1.0, 1.0)
    low, high = np.clip(-scaled, 0, 1), np.clip(scaled, 0, 1)
    blue, green, red = 1.0 - high, 1.0 - 0.8 * (low + high), 1.0 - low
    colours = np.stack([blue, green, red, seen], axis=-1)
    return png(np.round(255 * np.clip(colours, 0, 1)).astype(np.uint8)), (x0, y0, x1, y1)


def _finite(values: np.ndarray) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]

