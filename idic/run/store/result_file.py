"""``RUN/result.json``: replaced atomically, read only with a correct checksum.

Besides the keys of `idic.identification.result` the file holds ``sha256``, the checksum of all other keys: results are
compared and published, and a digit changed by a disk or an editor would go unnoticed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from idic.errors import InputError
from idic.inside import read_inside, write_inside
from idic.plain_values import finite
from idic.run.store.schemas.result import Result
from idic.run.store.schemas.types import refuse_other_types

RESULT_FILE = "result.json"
_SEAL = "sha256"


def write_result(run: Path | str, result: Mapping) -> None:
    """Write ``RUN/result.json`` with its checksum."""
    content = finite(dict(result))
    content.pop(_SEAL, None)
    write_json(Path(run) / RESULT_FILE, content | {_SEAL: _digest(content)})


def read_result(run: Path | str) -> dict:
    """The content of ``RUN/result.json``, without its checksum.

    Raises
    ------
    InputError
        The result is missing or altered, or holds other types than those of its schema.
    """
    file = Path(run) / RESULT_FILE
    try:
        content = read_json(file)
    except (FileNotFoundError, NotADirectoryError):
        raise InputError("there is no result", file=run, expected=f"a RUN folder with {RESULT_FILE}", found="none",
                         remedy="run idic identify first, or finish the run with --resume") from None
    except ValueError as problem:
        raise _altered(file, f"{type(problem).__name__}: {problem}") from problem
    if not isinstance(content, dict) or _SEAL not in content:
        raise _altered(file, "no checksum")
    if content.pop(_SEAL) != _digest(content):
        raise _altered(file, "contents with another checksum")
    refuse_other_types(content, Result, file)
    return content


def read_json(path: Path) -> Any:
    """The value of a JSON file that may come from somebody else.

    Raises
    ------
    ValueError
        The content is no JSON, holds NaN, or is nested deeper than Python reads.
    FileNotFoundError, InputError
        As of `open_inside`.
    """
    try:
        return json.loads(read_inside(path.parent, path.name), parse_constant=_no_number)
    except RecursionError:
        raise ValueError("lists nested too deeply") from None


def _no_number(text: str) -> float:
    raise ValueError(f"{text} is no number of JSON")


def write_json(path: Path, content: dict) -> None:
    """Replace a JSON file atomically; NaN becomes null."""
    write_inside(path.parent, path.name, json.dumps(finite(content), indent=1, allow_nan=False) + "\n", lasting=True)


def _digest(content: Mapping) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _altered(file: Path, found: str) -> InputError:
    return InputError("the result was altered", file=file,
                      expected="contents that fit their checksum", found=found,
                      remedy="run idic identify with --resume: the result is written again")
