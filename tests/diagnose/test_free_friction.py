"""Friction whose size changes during the test is screened with a course that the data give; constant friction stays
constant.

The load cell of the truth shows friction of its own making (`side_twins`); nothing of `idic.correlation.channels` is
used for it.
"""

import numpy as np
import pytest
from side_twins import FORCE_NOISE, TIMES, TRUTH, Side, refit, screening, write_folder

from idic.diagnose.screen.courses import courses_of
from idic.experiment_file import load_experiment

UP = np.where(TIMES < 8.5, 1.0, -1.0) * (TIMES > 0)  # the grip goes up, rests, comes back
LATE = np.where(TIMES > 3.5, np.minimum((TIMES - 3.0) / 3.0, 1.0), 0.0)  # a seal that begins to rub in frame 4
RUBS = 6.0  # N
NAMES = {"friction", "force_drift", "force_offset", "force_scale", "load_cell_curvature", "frame_time_offset"}


def rubbing(course):
    return Side(force=lambda F: F + RUBS * course * UP)


@pytest.fixture(scope="module", params=["late", "constant"])
def scored(request, tmp_path_factory):
    course = LATE if request.param == "late" else np.ones_like(TIMES)
    path = write_folder(tmp_path_factory.mktemp(request.param) / "test", rubbing(course))
    return request.param, path, course, screening(path, NAMES, own_courses=True)[1]


def test_friction_is_named_first_and_freed_where_it_is_not_constant(scored):
    kind, _, _, result = scored
    best = result.ranked[0]
    assert best.candidate.name == "friction" and best.standing == "significant"
    if kind == "constant":
        assert best.variant.new == ("channel.force_N.friction",)
    else:
        assert best.variant.free_course or result.free_course_of(best.variant) is not None


def test_the_course_of_the_friction_comes_back_with_its_band(scored):
    kind, path, course, result = scored
    if kind == "constant":
        pytest.skip("its course is constant")
    own = next(r.variant for r in result.ranked if r.candidate.name == "friction")
    free = own if own.free_course else result.free_course_of(own)
    found = refit(path, free).result["parameters"]
    experiment = load_experiment(path, free.edits)
    (shown,) = courses_of("friction", experiment, load_experiment(path), free.new,
                          {n: found[n]["value"] for n in free.new}, {n: found[n]["std"] for n in free.new})
    assert shown.is_free and shown.unit == "N"
    assert np.abs(shown.value - RUBS * course)[1:].max() < 3.0 * shown.std.max() + 2.0 * FORCE_NOISE
    assert abs(shown.onset[1] - 4) <= 2  # knots are two frames apart
    assert abs(found["BODY.E"]["value"] - TRUTH["E"]) < 3.0 * found["BODY.E"]["std"]
