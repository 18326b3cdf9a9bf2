"""The checkpoint is the old one or the new one, and comes back with the same bits."""

import json

import numpy as np
import pytest

from idic.errors import InputError
from idic.store.checkpoint import from_hex, load_checkpoint, save_checkpoint, to_hex

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
    assert [p.name for p in tmp_path.iterdir()] == ["state.json"]


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
    assert "without --resume" in problem.value.remedy and str(path) in str(problem.value)
