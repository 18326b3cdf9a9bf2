"""Texts without what differs from run to run: folders of the machine, durations, memory, dates."""

from __future__ import annotations

import re
import sys
from html.parser import HTMLParser
from pathlib import Path

SKIPPED_TAGS = frozenset({"style", "script"})
INLINE_TAGS = frozenset({"a", "b", "code", "em", "i", "small", "strong", "sub", "sup"})
SPACED_TAGS = frozenset({"span"})  # apart from their neighbours in the same paragraph
NUMBER = re.compile(r"[-+−]?\d+(?:[.,]\d+)*(?:[eE][-+−]?\d+)?")
AMOUNT = r"[\d.,]+ (?:ms|s|min|h|kB|MB|GB|TB)\b"
SPACES = re.compile(r"[ ━─]+")
VARIABLE = (  # pattern, what stands in its place
    (re.compile(r"\d{4}-\d\d-\d\d(?:[ T]\d\d:\d\d(?::\d\d(?:\.\d+)?)?)?"), "<date>"),
    (re.compile(rf"(\d iterations?, ){AMOUNT}"), r"\1<cost>"),  # summary of an identification
    (re.compile(rf"((?:time|wall|simulations|passes|memory)[^.;]*? ){AMOUNT}"), r"\1<cost>"),  # a section on cost
    (re.compile(rf"(this machine has ){AMOUNT}"), r"\1<cost>"),
)


class PageText(HTMLParser):
    """The visible paragraphs of a page, with the descriptions of its pictures."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self._paragraphs: list[str] = []
        self._pieces: list[str] = []
        self._skipped = 0

    def handle_starttag(self, tag, attrs):
        if tag in SKIPPED_TAGS:
            self._skipped += 1
        elif tag == "img":
            self._break()
            self._pieces.append(f"[picture: {dict(attrs).get('alt', '')}]")
            self._break()
        elif tag in SPACED_TAGS:
            self._pieces.append(" ")
        elif tag not in INLINE_TAGS:
            self._break()

    def handle_endtag(self, tag):
        if tag in SKIPPED_TAGS:
            self._skipped -= 1
        elif tag in SPACED_TAGS:
            self._pieces.append(" ")
        elif tag not in INLINE_TAGS:
            self._break()

    def handle_data(self, data):
        if not self._skipped:
            self._pieces.append(data)

    def paragraphs(self) -> list[str]:
        """Those read so far."""
        self._break()
        return self._paragraphs

    def _break(self) -> None:
        text = " ".join("".join(self._pieces).split())
        self._pieces = []
        if text:
            self._paragraphs.append(text)


def page_paragraphs(html: str) -> list[str]:
    """Visible paragraphs of a page."""
    page = PageText()
    page.feed(html)
    return page.paragraphs()


def normal(text: str, folder: Path) -> str:
    """The text as any machine would have written it; folder : of the case."""
    places = {str(folder): "<case>", str(folder.resolve()): "<case>", sys.executable: "<python>",
              sys.prefix: "<prefix>", str(Path.home()): "<home>"}
    for place in sorted(places, key=len, reverse=True):
        text = re.sub(rf"{re.escape(place)}(?![\w-])", places[place], text)
    for pattern, replacement in VARIABLE:
        text = pattern.sub(replacement, text)
    return text


def without_numbers(text: str) -> str:
    """The words of a text alone; columns have no width then."""
    return SPACES.sub(" ", NUMBER.sub("#", text)).strip()
