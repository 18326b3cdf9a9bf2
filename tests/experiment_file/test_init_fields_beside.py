"""`idic init` where the stages lie beside the log of the machine and a mesh."""

from __future__ import annotations

import numpy as np
import pytest

from idic.errors import InputError
from idic.experiment_file import initial_experiment
from idic.experiment_file import load_experiment


def write_folder(folder, rows: int) -> None:
    """Six VIC tables, whose names hold two numbers, and a log at its own rate."""
    x, y = np.meshgrid(np.arange(0.5, 12.0), np.arange(0.5, 36.0))
    at = np.column_stack([x.ravel(), y.ravel()])
    for k in range(6):
        lines = [f"{a},{b},{-3e-4 * k * a},{1e-3 * k * b}" for a, b in at]
        (folder / f"test-{k:02d}_0.csv").write_text("\n".join(['"X", "Y", "U", "V"', *lines]))
    times = np.linspace(0.0, 5.0, rows)
    (folder / "machine.csv").write_text("\n".join(["time_s,force_N", *(f"{t},{100 * t}" for t in times)]))


def test_the_log_of_the_machine_is_no_stage(tmp_path):
    write_folder(tmp_path, 6)
    text = initial_experiment(tmp_path)[0].read_text()
    assert 'fields = "test-*_0.csv"' in text and 'loads = "machine.csv"' in text and 'column = "force_N"' in text
    given = {"experiment.thickness_mm": 2.0, "experiment.fields_noise_um": 0.5}
    np.testing.assert_allclose(load_experiment(tmp_path, given).model.channels[0].values, 100.0 * np.arange(6))


def test_a_log_at_its_own_rate_needs_the_times_of_the_stages(tmp_path):
    write_folder(tmp_path, 51)
    assert "# FILL IN: 51 rows for 6 stages" in initial_experiment(tmp_path)[0].read_text()
    given = {"experiment.thickness_mm": 2.0, "experiment.fields_noise_um": 0.5, "experiment.frame_interval_s": 1.0}
    np.testing.assert_allclose(load_experiment(tmp_path, given).model.channels[0].values, 100.0 * np.arange(6))


def test_a_table_with_times_takes_them(tmp_path):
    write_folder(tmp_path, 51)
    lines = [f"{k},{k}.0,{a},{b},0.0,{1e-3 * k * b}" for k in range(3) for a in np.arange(0.5, 8.0)
             for b in np.arange(0.5, 12.0)]
    (tmp_path / "sub").mkdir()
    (tmp_path / "machine.csv").rename(tmp_path / "sub" / "machine.csv")
    (tmp_path / "sub" / "all.csv").write_text("\n".join(["stage,time_s,x_mm,y_mm,ux_mm,uy_mm", *lines]))
    assert "matched by the times of the stages" in initial_experiment(tmp_path / "sub")[0].read_text()
    given = {"experiment.thickness_mm": 2.0, "experiment.fields_noise_um": 0.5}
    np.testing.assert_allclose(load_experiment(tmp_path / "sub", given).model.channels[0].values, [0.0, 100.0, 200.0])


def test_a_mesh_beside_the_stages_is_laid_onto_them(tmp_path):
    write_folder(tmp_path, 6)
    number = np.arange(1, 9).reshape(4, 2)
    nodes = [f"{number[j, i]}, {100 + 12 * i}, {12 * j}" for j in range(4) for i in range(2)]
    cells = [f"{j + 1}, {number[j, 0]}, {number[j, 1]}, {number[j + 1, 1]}, {number[j + 1, 0]}" for j in range(3)]
    (tmp_path / "strip.inp").write_text("\n".join(["*NODE", *nodes, "*ELEMENT, TYPE=CPS4, ELSET=ALL", *cells,
                                                   "*NSET, NSET=TOP", "7, 8",
                                                   "*NSET, NSET=BOTTOM", "1, 2"]))
    text = initial_experiment(tmp_path)[0].read_text()
    assert 'mesh = "strip.inp"' in text and '\nplacement = "outline"' in text
    there = load_experiment(tmp_path, {"experiment.thickness_mm": 2.0, "experiment.fields_noise_um": 0.5})
    corner = there.model.camera.inverse(there.recording.points.positions_px).min(axis=0)
    np.testing.assert_allclose(corner, [100.5, 0.5], atol=0.5)


@pytest.mark.parametrize("stages, columns", [(2, 12), (4, 2)])
def test_too_few_stages_or_points_for_the_noise_ask_for_it(tmp_path, stages, columns):
    for k in range(stages):
        rows = [f"{x},{y},0.0,{1e-3 * k * y}" for x in range(columns) for y in range(18)]
        (tmp_path / f"stage_{k}.csv").write_text("\n".join(["x_mm,y_mm,ux_mm,uy_mm", *rows]))
    assert "fields_noise_um = 1.0            # FILL IN" in initial_experiment(tmp_path)[0].read_text()
    assert load_experiment(tmp_path).recording.noise.std_gv == 1.0


def test_a_field_of_three_columns_shows_its_noise(tmp_path):
    """Distances of neighbours that do not occur have no part in the covariance."""
    rng = np.random.default_rng(3)
    for k in range(5):
        noise = rng.normal(0.0, 5e-4, (90, 2))
        rows = [f"{x},{y},{noise[3 * y + x, 0]:.7f},{1e-3 * k * y + noise[3 * y + x, 1]:.7f}"
                for y in range(30) for x in range(3)]
        (tmp_path / f"stage_{k}.csv").write_text("\n".join(["x_mm,y_mm,ux_mm,uy_mm", *rows]))
    initial_experiment(tmp_path)[0]
    noise = load_experiment(tmp_path).recording.noise
    assert noise.std_gv == pytest.approx(0.5, rel=0.2)  # 540 numbers, some taken by the fit


def test_points_on_one_line_are_no_field(tmp_path):
    for k in range(4):
        rows = [f"3.0,{y},0.0,{1e-3 * k * y}" for y in range(18)]
        (tmp_path / f"stage_{k}.csv").write_text("\n".join(["x_mm,y_mm,ux_mm,uy_mm", *rows]))
    with pytest.raises(InputError, match="on one line"):
        initial_experiment(tmp_path)[0]


def test_lengths_of_fields_in_px_are_told_in_px(tmp_path):
    for k in range(6):
        rows = [f"{n},{x},{y},{1e-3 * k * x},{-1e-3 * k * y},0.01"
                for n, (x, y) in enumerate((x, y) for x in range(40, 300, 20) for y in range(60, 700, 20))]
        (tmp_path / f"solution_{k}.txt").write_text("\n".join([
            "SUBSET_ID,COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,SIGMA", *rows]))
    text = initial_experiment(tmp_path)[0].read_text()
    assert "the points span 240 x 620 px and end" in text and "multiply the lengths of mesh and geometry by it" in text


@pytest.mark.parametrize("upright", [False, True])
def test_a_beam_in_bending_is_no_compression(tmp_path, upright):
    """Four-point bending: the strain along the beam changes across it, its mean is next to nothing."""
    x, y = (each.ravel() for each in np.meshgrid(np.arange(0.25, 40.0), np.arange(0.25, 10.0)))
    for k in range(4):
        curvature = 4e-4 * k
        u = curvature * (x - 20.0) * (y - 5.0) - 2e-5 * k * x
        v = -0.5 * curvature * (x - 20.0) ** 2
        rows = zip(y, x, v, u, strict=True) if upright else zip(x, y, u, v, strict=True)
        lines = [f"{a},{b},{c:.7f},{d:.7f}" for a, b, c, d in rows]
        (tmp_path / f"s_{k}.csv").write_text("\n".join(["x_mm,y_mm,ux_mm,uy_mm", *lines]))
    (tmp_path / "log.csv").write_text("force_N\n0\n100\n200\n300\n")
    text = initial_experiment(tmp_path)[0].read_text()
    line = next(line for line in text.splitlines() if line.startswith("simulated = "))
    assert "bending, by the strain across the specimen" in line and "compression" not in text, line
    assert f'component = "{"x" if upright else "y"}"' in line and "factor" not in line


@pytest.mark.parametrize("measured", [0, 1, 3])
def test_a_stage_with_hardly_a_point_ends_in_a_file_or_in_one_message(tmp_path, measured):
    """The stage of the largest force has lost the pattern."""
    write_folder(tmp_path, 6)
    file = tmp_path / "test-05_0.csv"
    header, *rows = file.read_text().splitlines()
    lost = [",".join([*row.split(",")[:2], "nan", "nan"]) for row in rows[measured:]]
    file.write_text("\n".join([header, *rows[:measured], *lost]))
    try:
        assert "[experiment]" in initial_experiment(tmp_path)[0].read_text()
    except InputError as problem:
        assert problem.remedy and not (tmp_path / "experiment.toml").exists()
