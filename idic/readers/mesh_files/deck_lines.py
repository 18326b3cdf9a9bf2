"""The lines of an input deck with those of the files that it includes; every line knows its place."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple, NoReturn

from idic.errors import InputError
from idic.readers.delimited.text_files import text_of
from idic.path_names import path_inside

_MAX_DEPTH = 20  # of files that include each other


class Place(NamedTuple):
    """A line of a file, in messages."""

    file: Path
    number: int


class DeckLine(NamedTuple):
    """A line of a deck."""

    place: Place
    text: str


class DeckLines:
    """The lines of a deck in the order in which they are read.

    Parameters
    ----------
    path : the deck
    included : callable(text) -> name of the file that a line includes, or None

    Attributes
    ----------
    files : the deck and every file that was included
    """

    def __init__(self, path: Path, included: Callable[[str], str | None]):
        self.path, self.included, self.files = path, included, [path]

    def __iter__(self) -> Iterator[DeckLine]:
        return self.lines_of(self.path, ())

    def lines_of(self, path: Path, outer: tuple[Path, ...]) -> Iterator[DeckLine]:
        for number, text in enumerate(_text(path).splitlines(), 1):
            name = self.included(text)
            if name is None:
                yield DeckLine(Place(path, number), text)
            else:
                yield from self.include(name, Place(path, number), (*outer, path))

    def include(self, name: str, place: Place, outer: tuple[Path, ...] = ()) -> Iterator[DeckLine]:
        """The lines of a file that the line at `place` names, relative to the deck.

        Raises
        ------
        InputError
            The file lies outside the folder of the deck, is not there or includes itself.
        """
        path = path_inside(self.path.parent, name, file=place.file, key=f"line {place.number}")
        if not path.is_file():
            fail(place, "an included file is not there", str(path), f"no file {name}",
                 "copy it next to the mesh file, under the name that the deck gives it")
        if path in outer or len(outer) > _MAX_DEPTH:
            fail(place, "files include each other without an end", "every file once", name, "remove the line")
        if path not in self.files:
            self.files.append(path)
        yield from self.lines_of(path, outer)


def fail(place: Place | None, message: str, expected: str, finding: str, remedy: str = "correct the mesh file",
         file: Path | None = None) -> NoReturn:
    """Raise the InputError of a line, or of a whole file."""
    raise InputError(message, file=file if place is None else place.file,
                     key="mesh" if place is None else f"line {place.number}", expected=expected, found=finding,
                     remedy=remedy)


def _text(path: Path) -> str:
    """The file as text, as editors save it; bytes that are no letters may stand in names and comments."""
    data = path.read_bytes()
    try:
        return text_of(data, path, "mesh")[0]
    except InputError:
        return data.decode("utf-8", errors="replace")
