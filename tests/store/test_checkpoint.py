"""The checkpoint is the old one or the new one, and comes back with the same bits."""

import json

import numpy as np
import pytest

from idic.errors import InputError
from idic.run.store.checkpoint import (
    copy_of, remove_checkpoint, restore_checkpoint, from_hex, load_checkpoint, save_checkpoint, to_hex,
)

SCHEMA = "idic.test/1"


def test_floats_come_back_with_the_same_bits(tmp_path):
    theta = np.random.default_rng(0).normal(size=(3, 2)) * 1e-17
    save_checkpoint(tmp_path / "state.json", SCHEMA, {"theta": to_hex(theta), "lam": to_hex(0.1)})
    state = load_checkpoint(tmp_path / "state.json", SCHEMA)
    assert np.array_equal(from_hex(state["theta"]), theta) and from_hex(state["lam"]) == 0.1


def test_no_checkpoint_is_not_an_error(tmp_path):
    assert load_checkpoint(tmp_path / "state.json", SCHEMA) is None


def test_a_failed_write_leaves_the_previous_state(tmp_path):
    path = tmp_path / "state.json"
    save_checkpoint(path, SCHEMA, {"iteration": 1})
    with pytest.raises(ValueError):
        save_checkpoint(path, SCHEMA, {"iteration": float("nan")})
    with pytest.raises(TypeError):
        save_checkpoint(path, SCHEMA, {"iteration": object()})
    assert load_checkpoint(path, SCHEMA) == {"iteration": 1}
    assert sorted(p.name for p in tmp_path.iterdir()) == ["state.copy.json", "state.json"]


@pytest.mark.parametrize("damage", ["truncated", "altered", "other_version", "other_content"])
def test_a_damaged_checkpoint_is_reported_with_a_remedy(tmp_path, damage):
    path = tmp_path / "state.json"
    save_checkpoint(path, SCHEMA, {"iteration": 1, "theta": [1, 2, 3]})
    document = json.loads(path.read_text())
    if damage == "truncated":
        path.write_text(path.read_text()[:-30])
    elif damage == "altered":
        path.write_text(json.dumps({**document, "state": {"iteration": 2}}))
    elif damage == "other_version":
        path.write_text(json.dumps({**document, "schema": "idic.test/2"}))
    else:
        path.write_text("[]")
    with pytest.raises(InputError) as problem:
        load_checkpoint(path, SCHEMA)
    assert "--resume" in problem.value.remedy and str(path) in str(problem.value)


@pytest.mark.parametrize("damage", ["truncated", "altered", "lost"])
def test_the_copy_takes_the_place_of_a_damaged_checkpoint(tmp_path, damage):
    path = tmp_path / "state.json"
    save_checkpoint(path, SCHEMA, {"iteration": 7})
    assert not restore_checkpoint(path)  # nothing to do
    text = path.read_text()
    path.unlink() if damage == "lost" else path.write_text(text[:-9] if damage == "truncated"
                                                           else text.replace("7", "8"))
    assert restore_checkpoint(path) and load_checkpoint(path, SCHEMA) == {"iteration": 7}


def test_a_damaged_copy_is_not_taken(tmp_path):
    path = tmp_path / "state.json"
    save_checkpoint(path, SCHEMA, {"iteration": 7})
    for place in (path, copy_of(path)):
        place.write_text(place.read_text().replace("7", "8"))
    assert not restore_checkpoint(path)
    with pytest.raises(InputError, match="cannot be used"):
        load_checkpoint(path, SCHEMA)


def test_a_removed_checkpoint_does_not_come_back(tmp_path):
    path = tmp_path / "state.json"
    save_checkpoint(path, SCHEMA, {"iteration": 7})
    remove_checkpoint(path)
    assert not restore_checkpoint(path) and not list(tmp_path.iterdir())
