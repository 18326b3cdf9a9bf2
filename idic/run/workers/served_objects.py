"""Contents that the driver serves to its workers over the connections of Dask: no further port, no further program.

Two queues of the scheduler carry requests and answers. Everything passes through the scheduler: for large tests an
object storage is faster (`idic.run.store.mirror.objects`).
"""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from idic.errors import InputError
from idic.inside import replace_file
from idic.run.store.mirror.manifest import digest_of

ANSWER_SECONDS = 300
_POLL_SECONDS = 1.0


class ServedObjects:
    """The objects of the driver, as a worker sees them. See `idic.run.store.mirror.objects.Objects`.

    session : names the queues; place : this worker, for messages
    """

    def __init__(self, session: str, place: str):
        from distributed import Queue, get_client

        self._place, self._mine = place, f"{session}-{uuid.uuid4().hex}"
        self._requests = Queue(session, client=get_client())
        self._answers = Queue(self._mine, client=get_client())

    def get(self, sha256: str) -> bytes:
        """See `Objects.get`."""
        content = self._asked({"get": sha256})
        if content is None or digest_of(content) != sha256:
            raise InputError(f"{self._place} requested a file that the driver no longer has",
                             key="--store driver",
                             expected=f"the content {sha256[:16]}",
                             found="none" if content is None else "another content",
                             remedy="run the command again with --resume; do not change RUN or experiment meanwhile")
        return content

    def put(self, contents: Sequence[bytes]) -> list[str]:
        """See `Objects.put`."""
        for content in contents:
            self._asked({"put": content})
        return [digest_of(content) for content in contents]

    def _asked(self, request: dict):
        number = uuid.uuid4().hex
        self._requests.put(request | {"number": number, "answer": self._mine})
        while True:
            try:
                answer = self._answers.get(timeout=ANSWER_SECONDS)
            except TimeoutError:
                raise InputError(f"the driver does not answer {self._place}", key="--store driver",
                                 expected=f"an answer within {ANSWER_SECONDS} s", found="none",
                                 remedy="run the command again with --resume, or use an object storage") from None
            if answer["number"] == number:  # not one to a task that was cancelled
                return answer["content"]


class ObjectServer:
    """Answers the workers from a thread of the driver; contents that they send wait in a folder until the driver takes
    them.

    find : digest -> the file of the driver with this content; folder : for what workers send
    """

    def __init__(self, client, session: str, find: Callable[[str], bytes | None], folder: Path):
        from distributed import Queue

        self._client, self._find, self._folder = client, find, folder
        self._requests, self._answers = Queue(session, client=client), {}
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="idic-objects", daemon=True)
        self._thread.start()

    def received(self, sha256: str) -> bytes | None:
        """A content that a worker has sent."""
        with suppress(FileNotFoundError):
            return (self._folder / sha256).read_bytes()
        return None

    def close(self) -> None:
        """End the thread and the queues."""
        self._over.set()
        self._thread.join(10 * _POLL_SECONDS)
        with suppress(Exception):  # the scheduler may be gone
            for queue in (self._requests, *self._answers.values()):
                queue.close()

    def _serve(self) -> None:
        while not self._over.is_set():
            try:
                request = self._requests.get(timeout=_POLL_SECONDS)
            except TimeoutError:
                continue
            except Exception:  # noqa: BLE001 - the connection is lost, which the runner reports
                return
            with suppress(Exception):  # this worker is gone; its task is done elsewhere
                self._answer(request)

    def _answer(self, request: dict) -> None:
        from distributed import Queue

        content = None
        if "get" in request:
            content = self._find(request["get"])
        else:
            self._folder.mkdir(parents=True, exist_ok=True)
            temporary = self._folder / f".{uuid.uuid4().hex[:12]}"
            temporary.write_bytes(request["put"])
            replace_file(temporary, self._folder / digest_of(request["put"]))
        name = request["answer"]
        if name not in self._answers:
            self._answers[name] = Queue(name, client=self._client)
        self._answers[name].put({"number": request["number"], "content": content})


def read_file(path: str) -> bytes | None:
    """The content of a file, None where it is gone."""
    try:
        with open(path, "rb") as stream:
            return stream.read()
    except FileNotFoundError:
        return None


__all__ = ["ANSWER_SECONDS", "ObjectServer", "ServedObjects", "read_file"]
