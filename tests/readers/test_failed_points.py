"""Failed points of exports are gaps with a reason, whatever flag says so, and never displacements."""

from __future__ import annotations

import meshio
import numpy as np
import pytest
from experiment_file.point_plate import write_point_plate
from test_field_exports import GRID, displaced

from idic.errors import InputError
from idic.readers import FieldSeries, FieldStack, check_stages

LOST = 7  # the point that fails
FAR = 67.0  # a displacement that is none


def exported(folder, header: str, rows, lost, n_stages: int = 3, suffix: str = ".csv") -> FieldStack:
    """Stages whose first is whole; rows, lost : (point, place, displacement) -> line of a measured and a failed one"""
    for k in range(n_stages):
        lines = [(lost if k and i == LOST else rows)(i, GRID[i], displaced(k)[i]) for i in range(len(GRID))]
        (folder / f"stage_{k}{suffix}").write_text("\n".join([header, *lines]))
    series = FieldSeries.open(sorted(folder.iterdir()), pixel_size_mm=0.05)
    return FieldStack(series, series.measured_points([0]))


def assert_one_gap(stack: FieldStack, reason: str, factor: float = 1.0, upwards=(1.0, 1.0)) -> None:
    for k in (1, 2):
        moved = stack.frame(k).astype(float)[:, :2] * [1.0, -1.0] / 1e3
        assert np.flatnonzero(np.isnan(moved).any(axis=1)).tolist() == [LOST]
        whole = np.arange(len(GRID)) != LOST
        np.testing.assert_allclose(moved[whole], factor * displaced(k)[whole] * upwards, atol=2e-6)
    assert dict(check_stages(stack, range(3))) == {reason: 2}


def line(*cells: object) -> str:
    return ",".join(map(str, cells))


@pytest.mark.parametrize("head, sound, failed, reason", [
    ("COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,GAMMA,MATCH", (0.01, 0), (-1, -1), "match below 0"),
    ("COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,SIGMA,MATCH", (0.01, 0), (0.02, -1), "match below 0"),
    ("COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,SIGMA,MATCH", (0.01, 0), (-1, -1), "sigma below 0"),
    ("COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,GAMMA,BETA", (0.01, 0), (-1, -1), "gamma below 0"),
    ("ss_x,ss_y,displacement_u,displacement_v,converged,cost", (1, 0.99), (1, 0.3), "cost below 0.9"),
    ("ss_x,ss_y,displacement_u,displacement_v,converged,cost", (1, 0.99), (0, 0.99), "converged below 0.5"),
    ("subset_x,subset_y,disp_u,disp_v,converged,cost_zncc", (1, 0.99), (1, 0.27), "cost_zncc below 0.9"),
    ("subset_x,subset_y,disp_u,disp_v,converged,cost_zncc", ("True", 0.99), ("False", 0.99), "converged below 0.5"),
    ("x,y,u,v,sigma,exx", (0.0, 0.01), (-1, 0), "sigma below 0"),
])
def test_a_flag_makes_a_gap_in_pixels(tmp_path, head, sound, failed, reason):
    stack = exported(tmp_path, head, lambda i, x, u: line(*x, *u, *sound), lambda i, x, u: line(*x, FAR, FAR, *failed))
    assert_one_gap(stack, reason, 0.05, (1.0, -1.0))


@pytest.mark.parametrize("head, sound, failed, reason", [
    ("MODEL_COORDINATES_X,MODEL_COORDINATES_Y,MODEL_DISPLACEMENT_X,MODEL_DISPLACEMENT_Y,MATCH", (0,), (-1,),
     "match below 0"),
    ("X,Y,U,V,sigma", (0.01,), (-1,), "sigma below 0"),
    ("x_mm,y_mm,ux_mm,uy_mm,converged", (1,), (0,), "converged below 0.5"),
])
def test_a_flag_makes_a_gap_in_millimetres(tmp_path, head, sound, failed, reason):
    stack = exported(tmp_path, head, lambda i, x, u: line(*x, *u, *sound), lambda i, x, u: line(*x, FAR, FAR, *failed))
    assert_one_gap(stack, reason)


@pytest.mark.parametrize("mark", ["-999", "9999.0", "-1e5"])
def test_a_number_beyond_all_displacements_is_a_mark_of_failure(tmp_path, mark):
    stack = exported(tmp_path, "x_mm,y_mm,ux_mm,uy_mm", lambda i, x, u: line(*x, *u),
                     lambda i, x, u: line(*x, mark, mark))
    assert_one_gap(stack, f"displacement {float(mark):g}")


def test_the_largest_displacement_of_a_corner_is_no_mark(tmp_path):
    points = [(x, y) for x in range(8) for y in range(8)]
    for k in range(3):
        (tmp_path / f"s{k}.csv").write_text("x_mm,y_mm,ux_mm,uy_mm\n" + "".join(
            f"{x},{y},{0.01 * k * x:g},{0.01 * k * y:g}\n" for x, y in points))
    series = FieldSeries.open(sorted(tmp_path.iterdir()))
    assert np.isfinite(FieldStack(series, series.measured_points([0])).frame(2)).all()


@pytest.mark.parametrize("cells", [("", ""), ("NaN", "nan"), ("---", "---"), ("-", ""), ("inf", "0.1"), ("n/a", "N/A")])
def test_cells_without_a_number_are_gaps(tmp_path, cells):
    stack = exported(tmp_path, "x_mm,y_mm,ux_mm,uy_mm", lambda i, x, u: line(*x, *u), lambda i, x, u: line(*x, *cells))
    assert_one_gap(stack, "no displacement")


def test_a_stress_called_sigma_is_no_flag(tmp_path):
    stack = exported(tmp_path, "x_mm,y_mm,ux_mm,uy_mm,sigma", lambda i, x, u: line(*x, *u, -50.0 + i),
                     lambda i, x, u: line(*x, *u, -50.0))
    assert not check_stages(stack, range(3)) and np.isfinite(stack.frame(2)).all()


@pytest.mark.parametrize("n_lost", [1, 12])
def test_failed_points_at_one_place_are_left_out_and_counted(tmp_path, n_lost):
    """VIC-3D writes them at the origin, also those at the end of the file: no point occurs twice, no file is cut."""
    for k in range(3):
        rows = [line(0, 0, 0, 0, 0, 0, -1) if k and i >= len(GRID) - n_lost else
                line(*GRID[i], 0.0, *displaced(k)[i], 0.0, 0.01) for i in range(len(GRID))]
        (tmp_path / f"s_{k}.csv").write_text("\n".join(["X,Y,Z,U,V,W,sigma", *rows]))
    series = FieldSeries.open(sorted(tmp_path.iterdir()))
    stack = FieldStack(series, series.measured_points([0]))
    assert dict(check_stages(stack, range(3))) == {"sigma below 0": 2 * n_lost}
    assert np.isfinite(stack.frame(2)).all(axis=1).sum() == len(GRID) - n_lost


def test_a_reference_with_points_at_one_place_counts_the_others(tmp_path):
    for k in range(2):
        rows = [line(0, 0, 0, 0, -1) if i % 4 == 0 else line(*GRID[i], *displaced(k)[i], 0.0) for i in range(len(GRID))]
        (tmp_path / f"s_{k}.csv").write_text("\n".join(["X,Y,U,V,sigma", *rows]))
    series = FieldSeries.open(sorted(tmp_path.iterdir()))
    assert len(series.measured_points([0])) == 36


def test_measured_points_at_one_place_are_refused_as_before(tmp_path):
    rows = [line(*GRID[i], *displaced(1)[i], 0.0) for i in [*range(len(GRID)), 3]]
    (tmp_path / "s.csv").write_text("\n".join(["X,Y,U,V,sigma", *rows]))
    with pytest.raises(InputError, match="a point occurs twice"):
        FieldSeries.open([tmp_path / "s.csv"])


def test_a_file_in_which_all_points_failed_names_the_flag(tmp_path):
    rows = [line(*x, 0, 0, -1) for x in GRID]
    for k in range(2):
        (tmp_path / f"s_{k}.csv").write_text("\n".join(["X,Y,U,V,sigma", *rows]))
    series = FieldSeries.open(sorted(tmp_path.iterdir()))
    with pytest.raises(InputError, match="48 sigma below 0"):
        series.measured_points([0])


def with_zeros(folder, is_outside, shift=(2.4, -1.3), factor: float = 1.0):
    for k in range(3):
        u = np.where(is_outside[:, None], 0.0, factor * displaced(k) + (k > 0) * np.array(shift))
        rows = [line(*x, f"{a:.6f}", f"{b:.6f}") for x, (a, b) in zip(GRID, u, strict=True)]
        (folder / f"s_{k}.csv").write_text("\n".join(["x_mm,y_mm,ux_mm,uy_mm", *rows]))
    series = FieldSeries.open(sorted(folder.iterdir()))
    stack = FieldStack(series, series.measured_points([0]))
    return np.isnan(stack.frame(2)).any(axis=1), check_stages(stack, range(3))


@pytest.mark.parametrize("factor", [1.0, 0.0])
def test_zeros_outside_the_region_are_gaps(tmp_path, factor):
    is_outside = GRID[:, 0] < 5.0
    gaps, failed = with_zeros(tmp_path, is_outside, factor=factor)
    assert gaps.tolist() == is_outside.tolist()
    assert dict(failed) == {"exactly zero, outside the region": 2 * int(is_outside.sum())}


def test_a_clamped_edge_of_exact_zeros_is_measured(tmp_path):
    """A node map of finite elements: the motion begins at zero, without a jump."""
    for k in range(3):
        uy = 1e-3 * k * (GRID[:, 1] - GRID[0, 1])
        rows = [line(*x, 0.0, f"{v:.6f}") for x, v in zip(GRID, uy, strict=True)]
        (tmp_path / f"s_{k}.csv").write_text("\n".join(["x_mm,y_mm,ux_mm,uy_mm", *rows]))
    series = FieldSeries.open(sorted(tmp_path.iterdir()))
    stack = FieldStack(series, series.measured_points([0]))
    assert np.isfinite(stack.frame(2)).all() and not check_stages(stack, range(3))


def test_small_motions_with_few_digits_are_measured(tmp_path):
    for k in range(3):
        rows = [line(*x, f"{1e-3 * k * (x[0] > 6):.3f}", "0.000") for x in GRID]
        (tmp_path / f"s_{k}.csv").write_text("\n".join(["x_mm,y_mm,ux_mm,uy_mm", *rows]))
    series = FieldSeries.open(sorted(tmp_path.iterdir()))
    assert np.isfinite(FieldStack(series, series.measured_points([0])).frame(2)).all()


def test_flags_and_gaps_of_a_vtu_file(tmp_path):
    for k in range(3):
        u = np.column_stack([displaced(k), np.zeros(len(GRID))])
        u[LOST] = FAR if k else 0.0
        converged = np.where((np.arange(len(GRID)) == LOST) & (k > 0), 0.0, 1.0)
        meshio.Mesh(np.column_stack([GRID, np.zeros(len(GRID))]), [("vertex", np.arange(len(GRID))[:, None])],
                    point_data={"displacement": u, "converged": converged}).write(tmp_path / f"s{k}.vtu")
    series = FieldSeries.open(sorted(tmp_path.iterdir()), unit="mm")
    assert_one_gap(FieldStack(series, series.measured_points([0])), "converged below 0.5")


# pyvale 2026 -------------------------------------------------------------------------------------------
PYVALE = '"subset_x","subset_y","disp_u","disp_v","disp_mag","converged","cost_zncc","ftol","xtol","num_iter",'


@pytest.mark.parametrize("header, end", [(PYVALE, ""), (PYVALE, ","), (PYVALE[:-1], ","), (PYVALE[:-1], "")])
def test_a_separator_at_the_end_of_header_or_rows_is_no_column(tmp_path, header, end):
    stack = exported(tmp_path, header, lambda i, x, u: line(*x, *u, 0.1, 1, 0.99, 1e-4, 1e-4, 6) + end,
                     lambda i, x, u: line(*x, "nan", "nan", "nan", 0, "nan", "nan", "nan", 40) + end)
    assert stack.series.format == "pyvale"
    assert_one_gap(stack, "converged below 0.5", 0.05, (1.0, -1.0))


def test_a_stereo_export_of_pyvale_is_read_in_millimetres(tmp_path):
    header = PYVALE + ",".join(f'"stereo_{name}"' for name in (
        "disp_u_px", "disp_v_px", "disp_mag_px", "disp_u_mm", "disp_v_mm", "disp_w_mm", "x_mm", "y_mm", "z_mm",
        "converged", "cost_zncc")) + ","

    def row(i, x, u, cost=0.99):
        return line(20 * i, 0, 9, 9, 9, 1, 0.99, 0, 0, 5, 8, 8, 8, *u, 0.0, *x, 100.0, 1, cost)

    stack = exported(tmp_path, header, row, lambda i, x, u: row(i, x, [FAR, FAR], 0.1))
    assert_one_gap(stack, "stereo_cost_zncc below 0.9")


def test_check_shows_how_many_points_failed_and_why(tmp_path):
    from typer.testing import CliRunner

    from idic.cli.app import app

    x, y = (each.ravel() for each in np.meshgrid(np.arange(-12, 12.1, 0.8), np.arange(-6, 6.1, 0.8)))
    rng = np.random.default_rng(3)
    for k in range(5):
        u = 1e-4 * k * np.column_stack([x, -0.3 * y]) + rng.normal(0.0, 4e-4, (len(x), 2))
        rows = [line(*place, 0, 0, -1) if k and i % 50 == 0 else line(*place, *motion, 0.001)
                for i, (place, motion) in enumerate(zip(np.column_stack([x, y]), u, strict=True))]
        (tmp_path / f"s_{k}.csv").write_text("\n".join(["X,Y,U,V,sigma", *rows]))
    (tmp_path / "log.csv").write_text("force_N\n" + "\n".join(str(280.0 * k) for k in range(5)) + "\n")
    write_point_plate(tmp_path, "s_*.csv", 0.4, 4)
    shown = CliRunner().invoke(app, ["check", str(tmp_path)])
    n = 4 * len(range(0, len(x), 50))
    words = " ".join(shown.output.split())
    assert shown.exit_code == 0, shown.output
    assert f"{n} points of 5 stages were not measured and are gaps" in words and f"{n} sigma below 0" in words
