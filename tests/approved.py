"""Whole texts that a reader has approved, as files; ``IDIC_APPROVE=1 python -m pytest ...`` writes them anew.

A text here holds nothing of time, place or machine, and numbers of few digits.
"""

from __future__ import annotations

import os
from difflib import unified_diff
from pathlib import Path


def assert_approved(text: str, file: Path) -> None:
    """The text is the one of the file, line by line."""
    lines = [line.rstrip() for line in text.strip().splitlines()]
    if os.environ.get("IDIC_APPROVE"):
        file.parent.mkdir(exist_ok=True)
        file.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return
    approved = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
    difference = "\n".join(unified_diff(approved, lines, "approved", "now", lineterm="", n=1))
    assert lines == approved, (f"{file.name} has changed:\n{difference}\n"
                               "read it; where it is right, run the test with IDIC_APPROVE=1")
