"""docs/formats.md is what the readers declare; every suffix on it is one that idic recognises."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

from idic.errors import InputError
from idic.readers import FORMATS, Log, open_stack

DOCS = Path(__file__).parents[2] / "docs"
MAX_WORDS = 900


def test_the_page_is_the_text_that_the_readers_declare():
    spec = importlib.util.spec_from_file_location("formats", DOCS / "formats.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    page = (DOCS / "formats.md").read_text(encoding="utf-8")
    assert page == module.page(), "run: python docs/formats.py"
    assert len(page.replace("|", " ").split()) <= MAX_WORDS


@pytest.mark.parametrize("suffix", sorted({suffix for entry in FORMATS if entry.kind in ("images", "heights", "loads")
                                           for suffix in entry.suffixes}))
def test_a_suffix_of_the_page_is_known_to_its_reader(suffix, tmp_path):
    """A file of noise is refused as damaged, not as of an unknown format."""
    path = tmp_path / f"a{suffix}"
    path.write_bytes(bytes(range(256)) * 4)
    kinds = {entry.kind for entry in FORMATS if suffix in entry.suffixes}
    with pytest.raises(InputError) as refusal:
        Log.read(path) if "loads" in kinds else open_stack([path], with_gaps="heights" in kinds)
    assert "not an image format" not in refusal.value.what
