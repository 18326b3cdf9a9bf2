"""Warmth of which there is no log: where a lamp warms the specimen for a while, the diagnosis gives the course of the
temperature; warming in proportion to time keeps its one unknown.

The truth expands on a finer mesh, with smaller increments (`material_twins`).
"""

import material_twins
import numpy as np
import pytest
from material_twins import BODY, TIMES, Truth, write_folder
from side_twins import screening

from idic.diagnose import SUPPOSED_EXPANSION_PER_K
from idic.diagnose.screen.courses import courses_of
from idic.diagnose.screen.free_courses import free_edits
from idic.errors import InputError
from idic.experiment_file import load_experiment, read_toml
from idic.identification import identify

BUMP = 5e-4 * np.exp(-((TIMES - 10.0) / 4.0) ** 2)
WARMTH = {"a while": BUMP - BUMP[0], "evenly": 4e-4 * TIMES / TIMES[-1]}
NAMES = {"thermal_expansion", "force_drift", "force_offset", "magnification", "grip_slip", "creep"}


@pytest.fixture(scope="module", params=list(WARMTH))
def scored(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("warm") / "test"
    with pytest.MonkeyPatch.context() as patched:
        body = Truth("elastic", BODY, "elastic", warmth=WARMTH[request.param])
        patched.setitem(material_twins.TRUTHS, "warmed", body)
        path = write_folder(folder, "warmed")
    return request.param, path, screening(path, NAMES, own_courses=True)[1]


def test_a_supposed_course_is_freed_and_a_logged_one_is_not(scored):
    _, path, result = scored
    warm = [one.variant for one in result.trials if one.candidate.name == "thermal_expansion"]
    free = next(v for v in warm if v.free_course and v.new)
    assert all(name.startswith("temperature_knot[") for name in free.new) and free.exact
    plain = next(v for v in warm if not v.free_course)
    logged = {**plain.edits, "boundary": [*plain.edits["boundary"][:-1], {"temperature": {"column": "oven_C"}}]}
    assert free_edits(read_toml(path), logged, plain) is None
    for wrong in ({"nodes": "LEFT"}, {"unit": "C"}, {"knots": 0}):
        with pytest.raises(InputError):
            load_experiment(path, {"boundary": [*plain.edits["boundary"][:-1],
                                                {"temperature": {"course": "free"} | wrong}]})


def test_warmth_comes_first_and_keeps_a_course_that_suffices(scored):
    kind, _, result = scored
    best = max(result.ranked, key=lambda r: r.gain)
    assert best.candidate.name == "thermal_expansion" and best.standing == "significant"
    assert best.variant.free_course == (kind == "a while")


def test_the_course_comes_back_with_its_band(scored):
    kind, path, result = scored
    if kind == "evenly":
        pytest.skip("its course is in proportion to time")
    best = max(result.ranked, key=lambda r: r.gain).variant
    again = identify(load_experiment(path, best.edits)).result["parameters"]
    experiment = load_experiment(path, best.edits)
    (shown,) = courses_of("thermal_expansion", experiment, load_experiment(path), best.new,
                          {n: again[n]["value"] for n in best.new}, {n: again[n]["std"] for n in best.new})
    assert shown.is_free and shown.unit == "K"
    strain, std = SUPPOSED_EXPANSION_PER_K * shown.value, SUPPOSED_EXPANSION_PER_K * shown.std
    places = [int(name[name.index("[") + 1:-1]) for name in best.new]
    assert np.abs(strain - WARMTH[kind])[places].max() < 4.0 * std.max()
    for name in ("E", "nu"):
        entry = again[f"BODY.{name}"]
        assert abs(entry["value"] - BODY[name]) < 3.5 * entry["std"]  # of one draw: nu is 3.2 off
