"""What a reader declares of a format; `init`, messages and docs/formats.md are made of it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from idic.errors import InputError

IMAGES, HEIGHTS, LOADS, FIELDS, MESH, CALIBRATION = "images", "heights", "loads", "fields", "mesh", "calibration"
INSTALL = "python -m pip install 'idic[instruments]'"


@dataclass(frozen=True)
class Format:
    """A kind of file that idic reads.

    kind : where it is used, one of `IMAGES` …; name : program or instrument; suffixes : in lower case, none where the
    content tells the format; library : that decodes it, "" where idic does
    contents : what is taken from a file besides its values; user_input : what the user states; tests : with which files
    is_film : a file holds all images; is_extra : the library comes with ``idic[instruments]``
    """

    kind: str
    name: str
    suffixes: tuple[str, ...]
    library: str
    contents: str
    user_input: str
    tests: str
    is_film: bool = False
    is_extra: bool = False

    @contextmanager
    def decoded(self, path: Path) -> Iterator[None]:
        """A ``with`` block in which the library is imported and reads a file.

        Raises
        ------
        InputError
            The library is not installed, or cannot read the file.
        """
        key = IMAGES if self.kind == HEIGHTS else self.kind
        try:
            yield
        except InputError:
            raise
        except ImportError as problem:
            raise InputError(f"{self.name} ({path.suffix}) is read by {self.library}; "
                             f"{problem.name or self.library} is not installed: {INSTALL}", file=path, key=key,
                             expected=self.library, found=str(problem), remedy=f"install it: {INSTALL}") from None
        except (Exception, SystemExit) as problem:
            raise InputError(f"{self.name} ({path.suffix}): the file cannot be read", file=path, key=key,
                             expected=f"a file that {self.library} reads",
                             found=f"{type(problem).__name__}: {problem}" if str(problem) else type(problem).__name__,
                             remedy="copy the file again (it is truncated, damaged or of another format), or export "
                             "it in another format") from problem
