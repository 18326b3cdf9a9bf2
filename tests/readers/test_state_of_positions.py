"""Positions of the reference and of the deformed state are told apart by the data, and refused where neither fits."""

from __future__ import annotations

import numpy as np
import pytest
from test_field_exports import GRID, displaced

from idic.errors import InputError
from idic.readers import FieldSeries, FieldStack, check_stages

PLACES = GRID + np.random.default_rng(2).normal(0.0, 0.02, GRID.shape)
N_STAGES = 5


def aramis(folder, positions, displacement=None, decimals: int = 6, lost=()) -> None:
    """positions, displacement : stage -> (n, 2) mm; lost : points without a displacement in all stages but the first"""
    for k in range(N_STAGES):
        at = positions(k)
        columns = ["id;x;y;z" if displacement is None else "id;x;y;z;displacement_x;displacement_y;displacement_z"]
        for i, (x, y) in enumerate(at):
            row = f"{i};{x:.{decimals}f};{y:.{decimals}f};0"
            if displacement is not None:
                u, v = displacement(k)[i]
                row += ";;;" if k and i in lost else f";{u:.6f};{v:.6f};0"
            columns.append(row)
        head = ["# Units: length:mm time:s", f"# Stage: {k}", "stage;index;relative_time;date", f'"{k}";{k};{k};"now"',
                "# Name : Surface"]
        (folder / f"s_{k}.csv").write_text("\n".join([*head, *columns]).replace(".", ","))


def table(folder, positions, displacement, named: bool) -> None:
    for k in range(N_STAGES):
        rows = [(f"{i}," if named else "") + f"{x:.6f},{y:.6f},{u:.6f},{v:.6f}"
                for i, ((x, y), (u, v)) in enumerate(zip(positions(k), displacement(k), strict=True))]
        (folder / f"s_{k}.csv").write_text("\n".join([("id," if named else "") + "x_mm,y_mm,ux_mm,uy_mm", *rows]))


def opened(folder) -> FieldStack:
    series = FieldSeries.open(sorted(folder.iterdir()))
    return FieldStack(series, series.measured_points([0]))


def moved(stack: FieldStack, k: int) -> np.ndarray:
    return stack.frame(k).astype(float)[:, :2] * [1.0, -1.0] / 1e3


def in_reference(k):
    return PLACES


def deformed(k):
    return PLACES + displaced(k)


def increment(k):
    return displaced(1) if k else displaced(0)


@pytest.mark.parametrize("positions", [in_reference, deformed])
@pytest.mark.parametrize("lost", [(), (3, 20)])
def test_aramis_columns_of_displacement_give_motion_and_gaps(tmp_path, positions, lost):
    aramis(tmp_path, positions, displaced, lost=lost)
    stack = opened(tmp_path)
    for k in range(1, N_STAGES):
        values = moved(stack, k)
        assert np.flatnonzero(np.isnan(values).any(axis=1)).tolist() == list(lost)
        whole = np.isfinite(values).all(axis=1)
        np.testing.assert_allclose(values[whole], displaced(k)[whole], atol=3e-6)
    assert check_stages(stack, range(N_STAGES)) == ({"no displacement": 2 * (N_STAGES - 1)} if lost else {})


def test_aramis_positions_alone_are_those_of_the_stage(tmp_path):
    aramis(tmp_path, deformed)
    np.testing.assert_allclose(moved(opened(tmp_path), 4), displaced(4), atol=3e-6)


def test_aramis_positions_of_four_digits_decide_too(tmp_path):
    aramis(tmp_path, deformed, displaced, decimals=4)
    np.testing.assert_allclose(moved(opened(tmp_path), 4), displaced(4), atol=2e-4)


def test_aramis_stages_that_do_not_move_are_refused(tmp_path):
    aramis(tmp_path, in_reference)
    with pytest.raises(InputError, match="do not move") as refused:
        check_stages(opened(tmp_path), range(N_STAGES))
    assert "deformed positions" in refused.value.remedy


def test_a_stage_without_the_columns_does_not_decide(tmp_path):
    """The stage after fracture of a real series holds id;x;y;z alone; where it counts it is refused as before."""
    aramis(tmp_path, deformed, displaced)
    last = tmp_path / "s_4.csv"
    last.write_text("\n".join(";".join(row.split(";")[:4]) if row.count(";") == 6 else row
                              for row in last.read_text().splitlines()))
    stack = opened(tmp_path)
    np.testing.assert_allclose(moved(stack, 3), displaced(3), atol=3e-6)
    with pytest.raises(InputError, match="other columns"):
        stack.frame(4)


@pytest.mark.parametrize("named", [True, False])
@pytest.mark.parametrize("positions", [in_reference, deformed])
def test_a_table_of_either_state(tmp_path, positions, named):
    table(tmp_path, positions, displaced, named)
    stack = opened(tmp_path)
    np.testing.assert_allclose(stack.points.positions, PLACES, atol=1e-5)
    np.testing.assert_allclose(moved(stack, 4), displaced(4), atol=1e-5)
    check_stages(stack, range(N_STAGES))


@pytest.mark.parametrize("write", [aramis, lambda *how: table(*how, named=True)])
def test_displacements_against_the_stage_before_are_named_where_positions_show_it(tmp_path, write):
    write(tmp_path, deformed, increment)
    with pytest.raises(InputError, match="counts from the stage before") as refused:
        opened(tmp_path)
    assert "against the first stage" in refused.value.remedy


@pytest.mark.parametrize("write", [aramis, lambda *how: table(*how, named=True)])
def test_positions_that_fit_neither_state_are_refused(tmp_path, write):
    write(tmp_path, lambda k: PLACES + 0.5 * displaced(k), displaced)
    with pytest.raises(InputError, match="contradict each other"):
        opened(tmp_path)


def test_series_of_both_states_are_refused(tmp_path):
    table(tmp_path, lambda k: deformed(k) if k == 2 else in_reference(k), displaced, named=True)
    with pytest.raises(InputError, match="other specimen|of another|contradict"):
        check_stages(opened(tmp_path), range(N_STAGES))
