"""A process of its own that makes the residual maps, so that the page is answered meanwhile.

Opening a RUN compiles and imports for seconds, which would hold the server's process. Requests and answers are lines of
JSON; the process ends where its standard input does, with the server.

    {"run": "FOLDER/runs/NAME", "frame": null}   ->   {"point": {"evaluation": 3, ..., "picture": BASE64}}
"""

from __future__ import annotations

import base64
import json
import os
import subprocess
import sys
import threading
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import IO, Any

from idic.draw.folder import run_folder
from idic.draw.point import Point, accepted_point
from idic.draw.watch import has_accepted
from idic.errors import InputError
from idic.store.state_file import load_state
from idic.workers.dask_settings import ONE_THREAD
from idic.workers.working_folder import empty_folder


@dataclass
class Viewer:
    """The points of the RUNs of one folder; the last one is kept."""

    folder: Path
    _process: subprocess.Popen | None = None
    _last: tuple[tuple, Point] | None = None
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def point(self, name: str, frame: int | None = None) -> Point | None:
        """The accepted point of a RUN at a frame (None: the last one); None before there is one.

        Raises
        ------
        InputError
            The RUN cannot be read.
        """
        run = run_folder(self.folder, name)
        with self._lock:
            state = load_state(run)
            if not has_accepted(state):
                return None
            key = (name, state.accepted.number, frame, run.stat().st_ino)
            if self._last is None or self._last[0] != key:
                point = self._asked(run, frame)
                if point is None or point.evaluation != state.accepted.number:  # another one was accepted meanwhile
                    return point
                self._last = (key, point)
            return self._last[1]

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            with suppress(OSError):
                self._process.stdin.close()
            self._process = None

    def _asked(self, run: Path, frame: int | None) -> Point | None:
        process = self._started()
        try:
            _write(process.stdin, {"run": str(run), "frame": frame})
            line = process.stdout.readline()
        except OSError:  # it has ended
            line = b""
        if not line:
            self.close()
            raise InputError("the residual map cannot be made", expected="an answer of the process that makes it",
                             found="none", remedy="load the page again; the identification continues")
        answer = json.loads(line)
        if "problem" in answer:
            raise InputError("the residual map cannot be made", expected="a RUN that can be read",
                             found=answer["problem"], remedy="wait for the next point; the identification continues")
        return _read(answer["point"])

    def _started(self) -> subprocess.Popen:
        if self._process is None or self._process.poll() is not None:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "idic.draw.viewer"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL, cwd=empty_folder(), env={**os.environ, **ONE_THREAD})
        return self._process


def _write(stream: IO[bytes], answer: dict[str, Any]) -> None:
    stream.write(json.dumps(answer).encode() + b"\n")
    stream.flush()


def _sent(point: Point | None) -> dict[str, Any] | None:
    return None if point is None else asdict(point) | {"picture": base64.b64encode(point.picture).decode("ascii")}


def _read(sent: dict[str, Any] | None) -> Point | None:
    if sent is None:
        return None
    return Point(**(sent | {"picture": base64.b64decode(sent["picture"]), "box": tuple(sent["box"])}))


def serve(requests: IO[bytes], answers: IO[bytes]) -> None:
    """Answer requests until there are no more."""
    for line in requests:
        request = json.loads(line)
        try:
            answer = {"point": _sent(accepted_point(Path(request["run"]), request["frame"]))}
        except (InputError, OSError, ValueError, KeyError) as problem:  # a point that is just being replaced
            answer = {"problem": str(problem)[:300] or type(problem).__name__}
        _write(answers, answer)


if __name__ == "__main__":
    serve(sys.stdin.buffer, sys.stdout.buffer)
