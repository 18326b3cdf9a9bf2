"""Files in a folder that somebody else may have filled, such as a RUN: opened there, and nowhere else.

The folder may be reached by links: the user names it. Below it every level is opened by the handle of the one above, no
symbolic link is followed, and only regular files are opened: a link could lead to any file
of the user, and a pipe has no end. Without handles of folders (Windows) every level is looked at first.
"""

from __future__ import annotations

import os
import shutil
import stat
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import IO, Any

from idic.errors import InputError

HANDLES = {os.open, os.mkdir, os.rename, os.stat, os.unlink} <= os.supports_dir_fd and hasattr(os, "O_NOFOLLOW")
PATIENCE_S = 5.0 if os.name == "nt" else 0.0
PAUSE_S = 0.02
DATA_ROOT = "IDIC_DATA_ROOT"  # of a worker of deployments: what others may name lies below
_NO_WAITING = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0)
_PLAIN = getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
_FLAGS = {"r": os.O_RDONLY, "w": os.O_WRONLY | os.O_CREAT, "x": os.O_WRONLY | os.O_CREAT | os.O_EXCL,
          "a": os.O_WRONLY | os.O_CREAT | os.O_APPEND, "r+": os.O_RDWR, "a+": os.O_RDWR | os.O_CREAT}
_KINDS = {stat.S_IFLNK: "a symbolic link", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket", stat.S_IFDIR: "a folder",
          stat.S_IFCHR: "a device", stat.S_IFBLK: "a device", stat.S_IFREG: "a file"}
Name = str | PurePath


def open_inside(folder: Path | str, name: Name, mode: str = "rb") -> IO[Any]:
    """A regular file in a folder, opened without following a link.

    Parameters
    ----------
    folder : as the user names it
    name : relative to it, separated by ``/``
    mode : as of `open`: r, w, x, a, r+; ``a+`` keeps the content of the file. Texts are UTF-8

    Raises
    ------
    InputError
        The name leads out of the folder, or a link, a pipe or another special file has it.
    FileNotFoundError
        There is no such file.
    """
    kind = mode.replace("b", "")
    with _level(folder, name) as place:
        descriptor = _descriptor(place, _FLAGS[kind])
    if kind == "w":
        os.ftruncate(descriptor, 0)
    return os.fdopen(descriptor, mode, encoding=None if "b" in mode else "utf-8")


def read_inside(folder: Path | str, name: Name) -> bytes:
    """The content of a regular file in a folder; errors as of `open_inside`."""
    with open_inside(folder, name) as stream:
        return stream.read()


def write_inside(folder: Path | str, name: Name, content: str | bytes, lasting: bool = False) -> Path:
    """Put a file into a folder, in the place of an earlier one of this name, whole or not at all.

    lasting : also after a power cut

    Raises
    ------
    InputError
        As of `open_inside`; nothing is written.
    """
    data = content.encode() if isinstance(content, str) else content
    with _level(folder, name) as place:
        _refuse_special(place)
        temporary = place.beside(f".{place.name}.{uuid.uuid4().hex[:12]}.tmp")
        try:
            with os.fdopen(_descriptor(temporary, _FLAGS["x"]), "wb") as stream:
                stream.write(data)
                stream.flush()
                if lasting:
                    os.fsync(stream.fileno())
            _replace(temporary, place)
        finally:
            with suppress(FileNotFoundError):
                temporary.unlink()
        if lasting:
            place.sync()
        return place.path


def folder_inside(folder: Path | str, name: Name = "") -> Path:
    """A folder in a folder, made where it is missing; `InputError` where a link or a file has its name."""
    root = Path(folder)
    root.mkdir(parents=True, exist_ok=True)
    if name in ("", "."):
        return root
    with _level(root, PurePath(name) / "x", make=True) as place:
        return place.path.parent


def replace_inside(folder: Path | str, source: Name, target: Name) -> None:
    """Rename a file or a folder in a folder; what has the new name is replaced, a link as such."""
    with _level(folder, source) as earlier, _level(folder, target) as later:
        _replace(earlier, later)


def free_inside(folder: Path | str, name: Name) -> Path:
    """A path in a folder that nothing has any more, for a library that writes to a path."""
    remove_inside(folder, name)
    return Path(folder) / name


def refuse_outside_of_data(path: Path | str, key: str) -> Path:
    """A path with its links followed; it lies below the folder of the variable `DATA_ROOT`, where that is set.

    Raises
    ------
    InputError
        It lies elsewhere.
    """
    root, resolved = os.environ.get(DATA_ROOT), Path(path).resolve()
    if root and not resolved.is_relative_to(Path(root).resolve()):
        raise InputError("a path outside of the data of this worker", key=key, expected=f"a path below {root}",
                         found=str(path), remedy=f"move the data there, or start the worker with another {DATA_ROOT}")
    return resolved


def replace_file(source: Path | str, target: Path | str, patience_s: float = PATIENCE_S,
                 handles: tuple[int | None, int | None] = (None, None)) -> None:
    """`os.replace`, tried again while another program holds one of the two.

    On Windows a file that another program has open, a virus scanner or a reader of the RUN, can neither be replaced nor
    renamed; it is let go after moments.

    handles : of the folders of the two, where they are names in them

    Raises
    ------
    PermissionError
        It is held longer than `patience_s`, or this user may not write there.
    """
    end = time.monotonic() + patience_s
    while True:
        try:
            os.replace(source, target, src_dir_fd=handles[0], dst_dir_fd=handles[1])
            return
        except PermissionError:
            if time.monotonic() >= end:
                raise
        time.sleep(PAUSE_S)


def remove_inside(folder: Path | str, name: Name) -> None:
    """Delete a file or a folder with all its content; of a link, the link."""
    try:
        with _level(folder, name) as place:
            if stat.S_ISDIR(place.status().st_mode):
                shutil.rmtree(place.at, **({} if place.handle is None else {"dir_fd": place.handle}))
            else:
                place.unlink()
    except FileNotFoundError:
        return


def way_inside(folder: Path | str, name: Name) -> Path:
    """The path of a folder in a folder, which need not exist; `InputError` where a link or a file is on the way."""
    with suppress(FileNotFoundError), _level(folder, PurePath(name) / "x"):
        pass
    return Path(folder) / name


def is_inside(folder: Path | str, name: Name) -> bool:
    """Whether a folder has a regular file of this name, on a way without links."""
    try:
        with _level(folder, name) as place:
            return stat.S_ISREG(place.status().st_mode)
    except (OSError, InputError):
        return False


def is_regular(path: str) -> bool:
    """Whether a path is a regular file itself, and no link to one; cheap."""
    try:
        return stat.S_ISREG(os.lstat(path).st_mode)
    except OSError:
        return False


def refuse_special_files(folder: Path | str, except_in: tuple[str, ...] = ()) -> None:
    """`InputError` where a folder holds a link, a pipe or another special file, at any depth.

    For what libraries open by its path, such as the arrays of Zarr.

    except_in : folders of links to data, made by idic
    """
    todo = [os.fspath(folder)]
    while todo:
        try:
            entries = os.scandir(todo.pop())
        except (FileNotFoundError, NotADirectoryError):  # another process has just removed it
            continue
        with entries:
            for entry in entries:
                if entry.is_dir(follow_symlinks=False):
                    todo += [] if entry.name in except_in else [entry.path]
                elif not entry.is_file(follow_symlinks=False):
                    _refuse_special(_Place(Path(entry.path), None))


def checked_parts(name: Name) -> tuple[str, ...]:
    """The levels of a relative name.

    Raises
    ------
    InputError
        It is empty, absolute, or has ``..`` or a drive.
    """
    text = name.as_posix() if isinstance(name, PurePath) else name
    parts = tuple(text.split("/"))
    strange = any(part in ("", ".", "..") or "\0" in part or (os.name == "nt" and ("\\" in part or ":" in part))
                  for part in parts)
    if strange:
        raise InputError("a name leads out of its folder", expected="a name inside it, without ..", found=repr(text),
                         remedy="do not use this folder: idic writes no such names")
    return parts


@dataclass(frozen=True)
class _Place:
    """A name in an open folder. handle : of the folder; None where the system has none, and the path counts"""

    path: Path
    handle: int | None

    @property
    def name(self) -> str:
        return self.path.name

    @property
    def at(self) -> str:
        """What the functions of the system take beside the handle."""
        return os.fspath(self.path) if self.handle is None else self.path.name

    def beside(self, name: str) -> _Place:
        return _Place(self.path.with_name(name), self.handle)

    def status(self) -> os.stat_result:
        return os.stat(self.at, dir_fd=self.handle, follow_symlinks=False)

    def unlink(self) -> None:
        os.unlink(self.at, dir_fd=self.handle)

    def sync(self) -> None:
        """Let the name outlast a power cut, where folders can be synchronised."""
        with suppress(OSError):
            descriptor = os.dup(self.handle) if self.handle is not None else os.open(self.path.parent, os.O_RDONLY)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)


@contextmanager
def _level(folder: Path | str, name: Name, make: bool = False) -> Iterator[_Place]:
    """The last level of a name, with the folder above it open.

    make : the folders on the way, where they are missing
    """
    *levels, end = checked_parts(name)
    path = Path(folder)
    handle = os.open(path, os.O_RDONLY | os.O_DIRECTORY | _PLAIN) if HANDLES else None
    try:
        for level in levels:
            place = _Place(path / level, handle)
            if make:
                with suppress(FileExistsError):
                    os.mkdir(place.at, dir_fd=handle)
            handle, path = _entered(place), place.path
        yield _Place(path / end, handle)
    except OSError as problem:
        if problem.filename is not None and handle is not None and not os.path.isabs(os.fsdecode(problem.filename)):
            problem.filename = os.fspath(path / os.fsdecode(problem.filename))
        raise
    finally:
        if handle is not None:
            os.close(handle)


def _entered(place: _Place) -> int | None:
    """The handle of a folder that lies in an open one, which is closed."""
    if place.handle is None:
        _refuse_special(place, folder=True)
        return None
    try:
        handle = os.open(place.at, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | _PLAIN, dir_fd=place.handle)
    except OSError:
        _refuse_special(place, folder=True)
        raise
    os.close(place.handle)
    return handle


def _descriptor(place: _Place, flags: int) -> int:
    """An open regular file."""
    if place.handle is None:
        _refuse_special(place)
    try:
        descriptor = os.open(place.at, flags | getattr(os, "O_NOFOLLOW", 0) | _NO_WAITING | _PLAIN, 0o666,
                             dir_fd=place.handle)
    except OSError:
        _refuse_special(place)
        raise
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        _refuse_special(place)
    return descriptor


def _refuse_special(place: _Place, folder: bool = False) -> None:
    """`InputError` where the name is that of a link, a pipe …; a name without a file passes."""
    try:
        kind = stat.S_IFMT(place.status().st_mode)
    except OSError:
        return
    if kind != (stat.S_IFDIR if folder else stat.S_IFREG):
        raise InputError(f"{_KINDS.get(kind, 'a special file')} where idic opens {'folders' if folder else 'files'}",
                         file=place.path, expected="a folder" if folder else "a regular file",
                         found=_KINDS.get(kind, "a special file"),
                         remedy="remove it, and do not use this folder if it comes from somebody else")


def _replace(source: _Place, target: _Place) -> None:
    replace_file(source.at, target.at, handles=(source.handle, target.handle))
