"""The force under which a grip settles is found where the three that are screened leave something."""

from dataclasses import replace

import numpy as np
import pytest
from side_twins import Side, write_folder

from idic.diagnose import candidate_library
from idic.diagnose import Situation
from idic.diagnose.selection.moves.own_scale import MAX_REFITS, next_scale
from idic.experiment_file import load_experiment, read_toml


@pytest.mark.parametrize("true", [-1.3, -0.45, 0.0, 0.3, 0.9])
def test_the_scale_with_the_least_chi_square_is_found_in_few_refits(true):
    def left(x):
        return 50.0 + 4000.0 * (1.0 - np.exp(-(x - true)**2))  # flat far away

    tried = {0.0: left(0.0)}
    while len(tried) <= MAX_REFITS and (place := next_scale(tried)) is not None:
        assert place not in tried
        tried[place] = left(place)
    assert abs(min(tried, key=tried.get) - true) < 0.05


def test_a_seating_with_another_scale_is_the_same_grip(tmp_path):
    path = write_folder(tmp_path / "test", Side())
    seen = Situation(read_toml(path), load_experiment(path), {}, {}, {}, np.zeros(0), np.zeros(0))
    seating = next(candidate for candidate in candidate_library() if candidate.name == "seating")
    before = seating.variants(seen)[1]
    after = seating.rescaled(before, 0.5)
    own, other = (next(entry for entry in one.edits["boundary"][1]["ux"]["corrections"] if entry["kind"] == "seating")
                  for one in (before, after))
    assert other == own | {"seated_at": 0.5 * own["seated_at"]}
    assert after.new == before.new and after.label.startswith(f"RIGHT settles under the first {other['seated_at']:.3g}")
    assert load_experiment(path,
                           after.edits).model.parameters.free == load_experiment(path,
                                                                                 before.edits).model.parameters.free
    others = [*before.edits["boundary"], {"edges": "TOP", "pressure": {"column": "p_MPa"}}]
    beside = seating.rescaled(replace(before, edits={**before.edits, "boundary": others}), 0.5)
    assert beside.edits["boundary"] == [*after.edits["boundary"], others[-1]]
