"""The demonstration in 11 small frames that start near the truth: the smallest test with everything a RUN holds."""

from __future__ import annotations

from pathlib import Path

import pytest

from idic.virtual_tests import EXAMPLES, write_example
from idic.virtual_tests import DemoSize, strip

SMALL = DemoSize(0.2, (60, 110), (3, 3, 4), (2, 2, 1), (3, 4, 2), 1)
NEARER = (("55e3", "68e3"), ("0.38", "0.31"), ("260", "203"), ("800", "1450"))


def write_small_strip(folder: Path, size: DemoSize = SMALL) -> Path:
    """The experiment folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(EXAMPLES, "small", lambda reduced, foreign: strip(size))
        write_example("small", folder)
    file = folder / "experiment.toml"
    text = file.read_text()
    for far, near in NEARER:
        assert f"value = {far}" in text
        text = text.replace(f"value = {far}", f"value = {near}")
    file.write_text(text)
    return folder
