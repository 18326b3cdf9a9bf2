"""Which stages of a long series are compared."""

from __future__ import annotations

import numpy as np
import pytest

from idic.errors import InputError
from idic.readers.fields.chosen_stages import change_of_shape
from idic.readers import FieldSeries, StageRule, chosen_stages, mean_strain

GRID = np.stack(np.meshgrid(np.arange(5.0), np.arange(6.0)), axis=-1).reshape(-1, 2)


def turned(points: np.ndarray, degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return points @ np.array([[c, s], [-s, c]])


@pytest.fixture
def series(tmp_path):
    """21 stages, one a second: at rest until 10 s while the specimen sways, then 1e-3 of strain a second."""
    rows = []
    for k in range(21):
        strain, sway = 1e-3 * max(k - 10, 0), 0.05 * np.sin(k)
        at = GRID * [1.0, 1.0 + strain] + sway
        rows += [f"{k},{k}.0,{x:.9f},{y:.9f},{u:.9f},{v:.9f}" for (x, y), (u, v) in zip(GRID, at - GRID, strict=True)]
    (tmp_path / "all.csv").write_text("\n".join(["stage,time_s,x_mm,y_mm,ux_mm,uy_mm", *rows]))
    found = FieldSeries.open([tmp_path / "all.csv"])
    return found, found.measured_points([0])


@pytest.mark.parametrize("rule, kept", [
    (StageRule(strain=1.9e-3), (0, 12, 14, 16, 18, 20)),  # sway is no strain
    (StageRule(time_s=5.0), (0, 5, 10, 15, 20)),
    (StageRule(change_um=8.0), (0, 15, 20)),  # rms of y over six rows is 1.7 mm: 1.7 µm per second
    (StageRule(most=3), (0, 10, 20)),
    (StageRule(strain=1.9e-3, time_s=10.0, most=4), (0, 12, 16, 20)),
])
def test_a_rule_keeps_these_stages(series, rule, kept):
    assert chosen_stages(*series, rule, [0], []) == kept


def test_reference_stages_are_kept_and_excluded_ones_are_not(series):
    assert chosen_stages(*series, StageRule(most=3), [0, 1], [19, 20]) == (0, 1, 9, 18)


def test_time_is_asked_for_where_the_stages_have_none(tmp_path):
    text = "\n".join(["stage,x_mm,y_mm,ux_mm,uy_mm", *(f"{k},{x},{y},0,0" for k in range(3) for x, y in GRID)])
    (tmp_path / "all.csv").write_text(text)
    found = FieldSeries.open([tmp_path / "all.csv"])
    with pytest.raises(InputError, match="without a time"):
        chosen_stages(found, found.measured_points([0]), StageRule(time_s=1.0), [0], [])


def test_a_rigid_motion_is_neither_strain_nor_change_of_shape():
    moved = turned(GRID, 0.01) - GRID + [0.3, -0.2]
    assert np.abs(mean_strain(GRID, moved)).max() < 2e-8  # the square of the angle
    assert change_of_shape(GRID, moved) < 1e-7
    assert change_of_shape(GRID, 1e-3 * GRID) == pytest.approx(1e-3 * np.sqrt(np.sum(np.var(GRID, axis=0))))


def test_the_rule_is_told_in_words():
    rule = StageRule(strain=1e-4, time_s=5.0, most=100)
    assert rule.words == ("one each time that the mean strain has changed by 0.0001 or 5 s have passed, 100 at most, "
                          "evenly spread")
