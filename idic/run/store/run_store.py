"""The RUN folder on disk: access by one process, groups that are created atomically, the ingested images.

::

    RUN/run.lock                      one process at a time (`run_lock`)
    RUN/run.zarr/                     zarr 3; attribute ``identity`` = the experiment's hash
    RUN/run.zarr/images/frames        the stack, if ingested
    RUN/run.zarr/<group>/...          a part of the identification, written under a temporary name and renamed
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path, PurePath

import zarr
from pydantic import BaseModel

from idic.errors import InputError
from idic.images import Stack
from idic.inside import is_regular, refuse_special_files, remove_inside, replace_file
from idic.run.store.arrays import Damaged, FrameArrays, gets_smaller, write_compressed
from idic.run.store.layout import FROM_PYTHON, OF_LINKS
from idic.run.store.run_lock import LOCK_NAME, run_lock
from idic.run.store.schemas.types import refuse_other_types

STORE_NAME = "run.zarr"
_SEAL = "descriptions"  # attribute of a group
SCHEMA = "idic.run/2"  # a new number where an older RUN would be misread
_ANY_SCHEMA = re.compile(r"idic\.run/\d+")
_ASIDE, _REMOVED = ".old", ".gone.old"  # endings of folders that are being replaced, and removed
_SET_ASIDE = re.compile(r"\.(?P<name>.+)\.[0-9a-f]{12}\.old")
_OWN_FILES = {LOCK_NAME, "log.txt", STORE_NAME, FROM_PYTHON}


class RunStore:
    """Access to ``RUN/run.zarr``. The constructor does not touch the disk; `claim` opens the store for a run.

    Groups are plain folders (`Path`), so that tasks in other processes receive them as text.
    """

    def __init__(self, run: Path | str):
        self.run = Path(run)
        self.path = self.run / STORE_NAME

    @contextmanager
    def claim(self, identity: str, *, title: str = "") -> Iterator[RunStore]:
        """Lock the RUN for a ``with`` block, create the store or check that it belongs to this experiment.

        Leftovers of a killed process (temporary names) are removed; a group that it was replacing comes back.

        Raises
        ------
        InputError
            The folder holds other files or the run of another experiment, or another process uses it.
        """
        self._refuse_foreign_folder()
        self.refuse_special_files()
        self.refuse_other_version()
        with run_lock(self.run):
            stored = self.identity()
            if stored is None:
                remove_inside(self.run, STORE_NAME)
                with renamed_when_complete(self.path) as folder:
                    _create_group(folder, {"schema": SCHEMA, "identity": identity, "title": title})
            elif stored != identity:
                raise InputError(
                    "this RUN folder belongs to another experiment (or to the same one with other settings)",
                    file=self.run,
                    expected=f"identity {identity[:16]}",
                    found=f"identity {stored[:16]}{self._title_text()}",
                    remedy="choose another --out, or delete this folder",
                )
            self._remove_leftovers()
            yield self
            self._remove_leftovers()  # of workers that were killed during the run

    def refuse_other_version(self) -> None:
        """InputError where another version of idic wrote the store: what it holds would be misread."""
        schema = str(_attributes(self.path).get("schema", SCHEMA))
        if schema != SCHEMA and _ANY_SCHEMA.fullmatch(schema):
            raise InputError("another version of idic made this RUN", file=self.run, expected=SCHEMA, found=schema,
                             remedy="identify the experiment again into a new RUN")

    def refuse_special_files(self) -> None:
        """InputError where the RUN holds links or pipes, which what is written here would follow."""
        refuse_special_files(self.run, except_in=OF_LINKS)

    def identity(self) -> str | None:
        """The identity of the experiment of this store; None without a store."""
        stored = self._root_attributes().get("identity")
        return None if stored is None else str(stored)  # a damaged description may hold a number

    # groups ---------------------------------------------------------------------------------------
    @contextmanager
    def building(self, name: str, ident: Mapping | None = None, once: bool = False) -> Iterator[Path]:
        """A new group, built under a temporary name and renamed at the end of a ``with`` block without exception.

        An older group of the same name is replaced. A repeated task is harmless: its group replaces the first one.

        Parameters
        ----------
        name : str
            ``"it003/SPECIMEN.E"``, for instance.
        ident : mapping
            The inputs of the contents (JSON values; floats as hex); `finished` compares them.
        once : bool
            A group that another process has finished with the same inputs meanwhile stays, as others may be reading it.
        """
        target = self._inside(name)
        _require_parents(self.path, target.parent)
        with renamed_when_complete(target, lambda: once and self.finished(name, ident) is not None) as folder:
            _create_group(folder, {"ident": dict(ident or {}), "finished": True})
            yield folder
            for array in _arrays_in(folder):
                missing = FrameArrays.open(folder, array).missing()
                if missing:
                    raise RuntimeError(f"group {name}: {array} is incomplete, chunk {missing[0]} is missing")
            _seal(folder)

    def repeat(self, name: str, ident: Mapping, source: Path) -> Path:
        """A new group with the arrays of a finished one; `Damaged` if these are incomplete or altered."""
        with self.building(name, ident) as folder:
            for array in _arrays_in(source):
                stored = FrameArrays.open(source, array)
                for first, stop in stored.chunks():
                    stored.read(first, stop)
                shutil.copytree(source / array, folder / array)
        return self.path / name

    def thin(self, name: str, digits: Mapping[str, int | None]) -> Path:
        """Replace a finished group by one with some of its arrays, compressed; one that gets no smaller stays.

        digits : array -> binary digits that stay, None: all
        """
        source = self.group(name)
        arrays = _arrays_in(source)
        large = [array for array in arrays if array in digits and gets_smaller(source, array, digits[array])]
        if set(arrays) <= set(digits) and not large:
            return source
        with self.building(name, self.ident(source)) as folder:
            for array in (array for array in arrays if array in digits):
                if array not in large or not _compressed(source, folder, array, digits[array]):
                    shutil.copytree(source / array, folder / array, copy_function=_link_or_copy)
        return self.path / name

    def ident(self, folder: Path, kind: type[BaseModel] | None = None) -> dict:
        """The inputs of a finished group; `InputError` where they are not of a `kind` of `idic.run.store.schemas`."""
        stored = _attributes(folder).get("ident", {})
        if kind is not None:
            refuse_other_types(stored, kind, folder)
        return stored if isinstance(stored, dict) else {}

    def described(self, name: str, ident: Mapping | None = None) -> Path | None:
        """The folder of a group with the inputs `ident` that was finished once, whether or not it has all its
        chunks."""
        folder = self._inside(name)
        attributes = _attributes(folder)
        stored_ident = attributes.get("ident")
        if not attributes.get("finished") or not isinstance(stored_ident, Mapping) or (
                ident is not None and stored_ident != _as_json(ident)):
            return None
        descriptions = _descriptions(folder)
        return folder if attributes.get(_SEAL, descriptions) == descriptions else None

    def finished(self, name: str, ident: Mapping | None = None) -> Path | None:
        """The folder of a finished group with the inputs `ident` and all its chunks; otherwise None."""
        folder = self.described(name, ident)
        if folder is None:
            return None
        try:
            complete = not any(FrameArrays.open(folder, array).missing() for array in _arrays_in(folder))
        except Damaged:
            return None
        return folder if complete else None

    def group(self, name: str) -> Path:
        """The folder of a finished group; `Damaged` if it is missing or incomplete."""
        folder = self.finished(name)
        if folder is None:
            raise Damaged(
                "a part of the run is missing or incomplete",
                file=self.path / name,
                remedy="run the command again with --resume: this part is computed anew",
            )
        return folder

    def remove(self, name: str) -> None:
        """Delete a group if it exists."""
        _remove_tree(self._inside(name))

    # images ---------------------------------------------------------------------------------------
    def ingest(self, stack: Stack, progress: Callable[[int, int], None] | None = None, source: str = ""):
        """The stack as a `ZarrStack`, copied frame by frame unless the store has a complete copy of this `source`."""
        from idic.run.store.stack import ZarrStack

        return ZarrStack.of(self, stack, progress, source)

    # helpers --------------------------------------------------------------------------------------
    def _inside(self, name: str) -> Path:
        """The folder of a group; it lies in the store, whatever the name and whatever links another program put
        there."""
        folder = self.path / name
        if ".." in PurePath(name).parts or not folder.resolve().is_relative_to(self.path.resolve()):
            raise InputError("a part of the run would lie outside its folder", file=self.path,
                             expected="a name inside it",
                             found=name, remedy="rename the set or material in the mesh, and remove links in the RUN")
        return folder

    def _root_attributes(self) -> dict:
        attributes = _attributes(self.path)
        return attributes if attributes.get("schema") == SCHEMA else {}

    def _title_text(self) -> str:
        title = self._root_attributes().get("title")
        return f" ({title})" if title else ""

    def _refuse_foreign_folder(self) -> None:
        if self.run.exists() and not self.run.is_dir():
            raise InputError("the output must be a folder", file=self.run, found="a file",
                             remedy="choose another --out")
        if not self.run.is_dir() or self.path.exists():
            return
        strangers = sorted(entry.name for entry in self.run.iterdir() if entry.name not in _OWN_FILES)
        strangers = [name for name in strangers if not name.startswith(".")]
        if strangers:
            raise InputError(
                "the output folder is in use for something else",
                file=self.run,
                expected="a new or empty folder, or an earlier RUN",
                found=", ".join(strangers[:5]) + (" ..." if len(strangers) > 5 else ""),
                remedy="choose another --out",
            )

    def _remove_leftovers(self) -> None:
        for pattern in (".*.tmp", "figures/.*.tmp", "tables/.*.tmp"):
            for file in self.run.glob(pattern):
                remove_inside(self.run, file.relative_to(self.run))
        for base, folders, names in os.walk(self.path):
            for name in [name for name in names if name.startswith(".") and name.endswith(".tmp")]:
                (Path(base) / name).unlink(missing_ok=True)
            for name in [name for name in folders if name.startswith(".") and name.endswith((".tmp", ".old"))]:
                folders.remove(name)
                back = set_back(Path(base) / name)
                if back is None:
                    shutil.rmtree(Path(base) / name, ignore_errors=True)
                else:
                    folders.append(back.name)
            if "c" in folders:
                folders.remove("c")  # chunks: thousands of files, none of them temporary


@contextmanager
def renamed_when_complete(target: Path, unless: Callable[[], bool] = lambda: False) -> Iterator[Path]:
    """A temporary folder next to `target`; it replaces `target` if the block ends without an exception.

    unless : asked at the end; True drops the new folder
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    folder = target.parent / f".{target.name}.{uuid.uuid4().hex[:12]}.tmp"
    folder.mkdir()
    try:
        yield folder
        _sync_tree(folder)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    if unless():
        shutil.rmtree(folder, ignore_errors=True)
        return
    _take_place(folder, target)


def _take_place(folder: Path, target: Path) -> None:
    """Put a complete folder in the place of `target`; whenever this ends, one of the two is there or comes back.

    A rename onto a folder with files fails: the old one is set aside for the moment of the second rename (`set_back`
    finds it there after a kill), and is deleted only when the new one is in its place.
    """
    aside = _set_aside(target)
    try:
        replace_file(folder, target)
    except BaseException:
        if aside is not None and not target.exists():
            replace_file(aside, target)
        shutil.rmtree(folder, ignore_errors=True)
        raise
    _sync(target.parent)
    if aside is not None:
        _remove_tree(aside)


def _set_aside(target: Path) -> Path | None:
    """Rename a folder that is about to be replaced; None where there is none."""
    aside = target.parent / f".{target.name}.{uuid.uuid4().hex[:12]}{_ASIDE}"
    try:
        replace_file(target, aside)
    except FileNotFoundError:
        return None
    return aside


def set_back(folder: Path) -> Path | None:
    """Give a folder that was set aside its name again, if nothing took its place; None where it stays."""
    was = _SET_ASIDE.fullmatch(folder.name)
    target = folder.parent / was["name"] if was else None
    if target is None or target.exists():
        return None
    replace_file(folder, target)
    return target


def _sync_tree(folder: Path) -> None:
    """Synchronise a folder with the disk, descriptions last: a power cut leaves no incomplete group."""
    for base, _, names in os.walk(folder, topdown=False):
        for name in names:
            _sync(Path(base) / name)
        _sync(Path(base))


def _sync(path: Path) -> None:
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except PermissionError:  # folders cannot be opened on every system
        return
    try:
        os.fsync(descriptor)
    except OSError:
        pass  # not every file system supports it; the checksums reveal an incomplete chunk
    finally:
        os.close(descriptor)


def _remove_tree(path: Path) -> None:
    """Delete a folder; it is renamed first, so that no reader finds it half deleted and no `claim` restores it."""
    doomed = path.parent / f".{path.name.lstrip('.')}.{uuid.uuid4().hex[:12]}{_REMOVED}"
    try:
        replace_file(path, doomed)
    except FileNotFoundError:  # there is none, or another task was faster
        return
    shutil.rmtree(doomed, ignore_errors=True)


def _create_group(folder: Path, attributes: dict) -> None:
    zarr.create_group(store=str(folder), attributes=_as_json(attributes), overwrite=False)


def _require_parents(root: Path, folder: Path) -> None:
    """Describe every level between the store and a group as a zarr group, for other zarr readers."""
    levels = [folder, *folder.parents]
    for level in reversed(levels[: levels.index(root)]):
        if not _is_described(level):
            level.mkdir(parents=True, exist_ok=True)
            _describe(level)


def _is_described(folder: Path) -> bool:
    try:
        return json.loads((folder / "zarr.json").read_text(encoding="utf-8"))["node_type"] == "group"
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return False


def _describe(folder: Path) -> None:
    """Write the description of a group without attributes, atomically."""
    temporary = folder / f".zarr.json.{uuid.uuid4().hex[:12]}.tmp"
    temporary.write_text(json.dumps({"attributes": {}, "zarr_format": 3, "node_type": "group"}, indent=2),
                         encoding="utf-8")
    _sync(temporary)
    replace_file(temporary, folder / "zarr.json")
    _sync(folder)


def _attributes(folder: Path) -> dict:
    try:
        attributes = json.loads((folder / "zarr.json").read_text(encoding="utf-8")).get("attributes", {})
    except (OSError, ValueError, AttributeError, RecursionError):
        return {}
    return attributes if isinstance(attributes, dict) else {}


def _seal(folder: Path) -> None:
    """Write the checksums of the array descriptions into the description of their group; the checksums of the chunks do
    not cover the shape."""
    file = folder / "zarr.json"
    content = json.loads(file.read_text(encoding="utf-8"))
    content["attributes"][_SEAL] = _descriptions(folder)
    file.write_text(json.dumps(content, indent=2), encoding="utf-8")


def _descriptions(folder: Path) -> dict[str, str]:
    files = sorted(folder.glob("*/zarr.json"))
    return {file.parent.name: hashlib.sha256(file.read_bytes()).hexdigest() if is_regular(os.fspath(file)) else ""
            for file in files}


def _compressed(source: Path, folder: Path, array: str, digits: int | None) -> bool:
    """Write an array of a group into another one, compressed; False, and nothing is left, where it is damaged or the
    disk is full."""
    try:
        write_compressed(source, folder, array, digits)
    except (Damaged, OSError):
        shutil.rmtree(folder / array, ignore_errors=True)
        return False
    return True


def _link_or_copy(source: str, target: str) -> None:
    """A second name of a file that is not changed any more; a copy where the disk has no links."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


def _arrays_in(folder: Path) -> list[str]:
    names = []
    for file in sorted(folder.glob("*/zarr.json")):
        try:
            kind = json.loads(file.read_text(encoding="utf-8"))["node_type"]
        except (ValueError, KeyError, TypeError, RecursionError, IsADirectoryError) as problem:
            raise Damaged("the description of a stored array cannot be read", file=file, expected="JSON of Zarr",
                          found=f"{type(problem).__name__}: {problem}",
                          remedy="run the command again with --resume: this part is computed anew") from problem
        if kind == "array":
            names.append(file.parent.name)
    return names


def _as_json(value):
    """The value after a round trip through a JSON file (tuples become lists)."""
    return json.loads(json.dumps(value if not isinstance(value, Mapping) else dict(value)))

