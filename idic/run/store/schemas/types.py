"""Types that the schemas share, and the check of a content: a RUN may come from somebody else, with checksums that fit.

A file is checked when it is read and stays as it is. Keys that are not listed belong to parts of idic that read them
only to show them.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from idic.errors import InputError

MAX_SHOWN_ERRORS = 3
MAX_WHOLE = 2**53  # of numbers that count something: larger ones are no counts
Number = float | None  # None: not finite, or not determined
Count = Annotated[int, Field(ge=0, le=MAX_WHOLE)]
Std = Annotated[float, Field(ge=0)] | None
Finite = Annotated[float, Field(allow_inf_nan=False)]
Values = dict[str, Number]


def _of_hex(text: str) -> str:
    float.fromhex(text)
    return text


Hex = Annotated[str, AfterValidator(_of_hex)]  # an exact float
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class Part(BaseModel):
    model_config = ConfigDict(extra="allow", strict=True, allow_inf_nan=True)


class Exact(BaseModel):
    """Without other keys: the record is built from it."""

    model_config = ConfigDict(extra="forbid", strict=True)


def refuse_other_types(content: object, kind: type[BaseModel], file: Path | str) -> None:
    """Check a content against its schema.

    Raises
    ------
    InputError
        A key is missing, a value has another type, or a text has no encoding.
    """
    try:
        _adapter(kind).validate_python(content)
        json.dumps(content, ensure_ascii=False).encode()
    except UnicodeEncodeError:
        raise InputError("a text that no file can hold", file=file, expected="whole characters of Unicode",
                         found="a half of a surrogate pair", remedy="do not use this folder") from None
    except ValidationError as problem:
        errors = problem.errors(include_url=False, include_context=False, include_input=False)
        listing = "; ".join(f"{'.'.join(map(str, error['loc'])) or 'the content'}: {error['msg']}"
                          for error in errors[:MAX_SHOWN_ERRORS])
        raise InputError("the file does not hold what idic writes into it", file=file,
                         expected=f"keys and types of {(kind.__doc__ or '').split(':')[0].split(';')[0].strip('`.')}",
                         found=listing,
                         remedy="do not use this folder if it comes from somebody else; otherwise run the command "
                                "again with --resume, or identify into another --out") from None
    except (RecursionError, OverflowError) as problem:
        raise InputError("the file does not hold what idic writes into it", file=file, found=type(problem).__name__,
                         remedy="do not use this folder") from None


@cache
def _adapter(kind: type[BaseModel]) -> TypeAdapter:
    return TypeAdapter(kind)
