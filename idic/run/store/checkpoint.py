"""The state of a run as one small JSON file, replaced atomically, with a copy in case it is damaged."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from pydantic import BaseModel

from idic.errors import InputError
from idic.inside import read_inside, remove_inside, write_inside
from idic.run.store.result_file import read_json
from idic.run.store.schemas.description import Description, Names
from idic.run.store.schemas.state import State
from idic.run.store.schemas.types import refuse_other_types

BY_SCHEMA: Mapping[str, type[BaseModel]] = {
    "idic.run-description/1": Description, "idic.state/2": State, "idic.joint/1": Names}

def save_checkpoint(path: Path | str, schema: str, state: dict) -> None:
    """Replace the checkpoint at `path` by `state` (JSON values; floats that must come back exactly as `to_hex`).

    The file is written under a temporary name, synchronised and renamed; a kill or a power cut leaves the previous one.
    Its copy follows in the same way.
    """
    document = {"schema": schema, "sha256": _digest(state), "state": state}
    text = json.dumps(document, indent=1, allow_nan=False) + "\n"
    for place in (Path(path), copy_of(path)):
        _replace(place, text)


def copy_of(path: Path | str) -> Path:
    """Where the copy of a checkpoint lies."""
    path = Path(path)
    return path.with_name(f"{path.stem}.copy{path.suffix}")


def restore_checkpoint(path: Path | str) -> bool:
    """Replace a damaged or lost checkpoint by its copy; whether that was needed and possible."""
    if _is_whole(path) or not _is_whole(copy_of(path)):
        return False
    _replace(Path(path), _content(copy_of(path)))
    return True


def remove_checkpoint(path: Path | str) -> None:
    """Delete a checkpoint and its copy."""
    for place in (copy_of(path), Path(path)):  # a kill in between leaves the checkpoint, which counts
        remove_inside(place.parent, place.name)


def _replace(path: Path, text: str | bytes) -> None:
    write_inside(path.parent, path.name, text, lasting=True)


def _content(path: Path | str) -> bytes:
    return read_inside(Path(path).parent, Path(path).name)


def load_checkpoint(path: Path | str, schema: str) -> dict | None:
    """The state stored at `path`; None if the file does not exist.

    Raises
    ------
    InputError
        The file is damaged, was written by another version, or holds other types than those of its schema.
    """
    path = Path(path)
    try:
        document = read_json(path)
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as problem:
        raise _damaged(path, "a JSON document", str(problem)) from problem
    if not isinstance(document, dict) or "state" not in document:
        raise _damaged(path, "an object with the keys schema, sha256, state", type(document).__name__)
    if document.get("schema") != schema:
        raise _damaged(path, f"schema {schema}", f"schema {document.get('schema')}")
    if document.get("sha256") != _digest(document["state"]):
        raise _damaged(path, "contents that fit their checksum", "contents that were altered")
    if schema in BY_SCHEMA:
        refuse_other_types(document["state"], BY_SCHEMA[schema], path)
    return document["state"]


def to_hex(values) -> list | str:
    """Floats as exact text: a number or nested arrays of them, as ``float.hex``."""
    if np.ndim(values) == 0:
        return float(values).hex()
    return [to_hex(value) for value in values]


def from_hex(text) -> np.ndarray | float:
    """The inverse of `to_hex`: a float, or an array of floats."""
    return float.fromhex(text) if isinstance(text, str) else np.array([from_hex(item) for item in text], dtype=float)


def _is_whole(path: Path | str) -> bool:
    try:
        document = read_json(Path(path))
        return document["sha256"] == _digest(document["state"])
    except (OSError, ValueError, TypeError, KeyError):
        return False


def _digest(state: dict) -> str:
    return hashlib.sha256(json.dumps(state, sort_keys=True, allow_nan=False).encode()).hexdigest()


def _damaged(path: Path, expected: str, found: str) -> InputError:
    return InputError(
        "the checkpoint cannot be used",
        file=path,
        expected=expected,
        found=found,
        remedy="run idic identify with --resume, which restores it from its copy; if the copy is damaged as well, "
               "choose another --out and start again",
    )
