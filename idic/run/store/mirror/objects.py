"""Contents under their digests in an object storage (S3 and whatever else fsspec opens): immutable, checked at every
read."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Protocol, TypeVar

from idic.errors import InputError
from idic.run.store.mirror.manifest import digest_of

BATCH_BYTES = 64_000_000  # of contents that are sent side by side
_T = TypeVar("_T")


class Objects(Protocol):
    """Contents by their digests, shared by driver and workers."""

    def get(self, sha256: str) -> bytes:
        """A content, checked against its digest; `InputError` where it is missing or altered."""

    def put(self, contents: Sequence[bytes]) -> list[str]:
        """Keep contents; returns their digests."""


class StoredObjects:
    """Objects under a URL of fsspec.

    Parameters
    ----------
    url : ``s3://bucket/prefix``, ``file:///mnt/...``; credentials come from the settings of fsspec and of its file
    system
    place : who reads and writes, for messages ("the driver", a worker's address)
    """

    def __init__(self, url: str, place: str):
        self.url, self._place = url.rstrip("/"), place
        import fsspec

        try:
            self._fs, root = fsspec.core.url_to_fs(self.url)
        except (ImportError, ValueError) as problem:
            raise InputError("the store cannot be opened", key="--store", expected="a URL that fsspec opens, e.g. "
                             "s3://bucket/prefix, on driver and workers", found=f"{url}: {problem}",
                             remedy="correct it, or install its file system: pip install s3fs for s3://") from problem
        self._root = f"{root.rstrip('/')}/objects"

    def get(self, sha256: str) -> bytes:
        """See `Objects.get`. An altered object is deleted, so that ``--resume`` sends it again."""
        path = self._path(sha256)
        content = self._tried("read", lambda: self._fs.cat_file(path), missing=None)
        if content is None:
            raise self._spoilt(path, "none")
        if digest_of(content) != sha256:
            self._delete(path)
            raise self._spoilt(path, f"{len(content)} bytes with another checksum; the object has been deleted")
        return content

    def put(self, contents: Sequence[bytes]) -> list[str]:
        """See `Objects.put`."""
        names = [digest_of(content) for content in contents]
        paths = {self._path(name): content for name, content in zip(names, contents, strict=True)}
        self._tried("write", lambda: self._send(paths))
        return names

    def sizes(self) -> dict[str, int]:
        """Digests and sizes of all objects."""
        self._tried("read", self._fs.invalidate_cache)
        objects = self._tried("read", lambda: self._fs.find(self._root, detail=True), missing={})
        return {path.rpartition("/")[2]: int(entry["size"]) for path, entry in objects.items()}

    def delete(self, names: Iterable[str]) -> None:
        """Delete objects; those that are gone already do not matter."""
        for name in names:
            self._delete(self._path(name))

    def _delete(self, path: str) -> None:
        self._tried("delete", lambda: self._fs.rm_file(path), missing=None)

    def _send(self, contents: dict[str, bytes]) -> None:
        try:
            self._fs.pipe(contents)
        except FileNotFoundError:  # a file system with folders
            for path in contents:
                self._fs.makedirs(path.rpartition("/")[0], exist_ok=True)
            self._fs.pipe(contents)

    def _path(self, sha256: str) -> str:
        return f"{self._root}/{sha256[:2]}/{sha256}"

    def _tried(self, action: str, call: Callable[[], _T], **missing: Any) -> _T:
        """A call to the file system; a failure is reported with its place."""
        try:
            return call()
        except FileNotFoundError as problem:
            if missing:
                return missing["missing"]
            raise self._failed(action, problem) from problem
        except Exception as problem:  # file systems of fsspec raise the types of their libraries
            raise self._failed(action, problem) from problem

    def _failed(self, action: str, problem: Exception) -> InputError:
        return InputError(f"{self._place} cannot {action} the store", key="--store", expected=f"access to {self.url}",
                          found=f"{type(problem).__name__}: {problem}",
                          remedy="check address and credentials there (for S3: AWS_ACCESS_KEY_ID, "
                                 "AWS_SECRET_ACCESS_KEY, AWS_ENDPOINT_URL), then continue with --resume")

    def _spoilt(self, path: str, found: str) -> InputError:
        return InputError(f"{self._place} finds an object of the store missing or damaged; it is not used", file=path,
                          expected="the content whose checksum is its name", found=found,
                          remedy="run the command again with --resume: the object is sent again")
