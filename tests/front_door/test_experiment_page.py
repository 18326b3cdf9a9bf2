"""The page that explains experiment.toml names every key of the schema, and its snippet is read."""

import re
import typing
from pathlib import Path

import pytest
from pydantic import BaseModel

from idic.experiment_file import ExperimentFile
from idic.experiment_file.schema.boundary import SimulatedTable

PAGE = Path(__file__).resolve().parents[2] / "docs" / "experiment-file.md"
NOT_WRITTEN = {"further_cameras"}  # written as further [[camera]] tables


def models_in(annotation):
    """Every table that a type of the schema mentions."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in typing.get_args(annotation):
        yield from models_in(part)


def keys_of(model, seen):
    seen.add(model)
    for name, entry in model.model_fields.items():
        yield name
        for part in models_in(entry.annotation):
            if part not in seen:
                yield from keys_of(part, seen)


def test_the_page_names_every_key():
    words = set(re.findall(r"\w+", PAGE.read_text(encoding="utf-8")))
    keys = set(keys_of(ExperimentFile, set())) | set(SimulatedTable.model_fields)
    assert len(keys) > 100
    assert keys - NOT_WRITTEN <= words


@pytest.mark.parametrize("number, name, default", [
    (0.6, "lowpass_px", None), (4, "border_px", None), (3, "edge_margin_px", 3), (40, "max_iterations", 40),
    (0.02, "tolerance", 0.02), ("quintic", "interpolation", "quintic"), ("auto", "search", "auto"),
])
def test_the_defaults_of_the_page_are_those_of_the_schema(number, name, default):
    row = next(line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith(f"| `{name}`"))
    assert row.rstrip(" |").rpartition("|")[2].strip().startswith(str(number))
    assert ExperimentFile.model_fields["options"].default.model_dump()[name] == default
