"""Spoilt stages of measured fields are read or refused with what was expected, found and is to do; nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from idic.errors import InputError
from idic.readers import FieldSeries, FieldStack, check_stages, loops_of, notched_axis

X = np.stack(np.meshgrid(np.arange(6) * 1.5, np.arange(5) * 1.5), axis=-1).reshape(-1, 2)
ARAMIS = ("# Units: length:mm time:s\n# Stage: 1\nstage;index;relative_time;date\n1;1;1.0;now\n# Name : Surface\n"
          "id;x;y;z;displacement_x;displacement_y;displacement_z")
KINDS = {
    "vic": ("X,Y,Z,U,V,W,sigma", ",", lambda i, x, u: (*x, 0.0, *u, 0.0, 0.01)),
    "dice": ("SUBSET_ID,COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,SIGMA,MATCH", ",",
             lambda i, x, u: (i, *x, *u, 0.01, 0)),
    "pyvale": ("subset_x,subset_y,disp_u,disp_v,converged,cost_zncc,", ",", lambda i, x, u: (*x, *u, 1, 0.99)),
    "aramis": (ARAMIS, ";", lambda i, x, u: (i, *(x + u), 0.0, *u, 0.0)),
    "al-dic": ("node_id,x_px,y_px,disp_u,disp_v", ",", lambda i, x, u: (i, *x, *u)),
    "table": ("stage,id,x_mm,y_mm,ux_mm,uy_mm", ",", lambda i, x, u: (1, i, *x, *u)),
}
WORDS = ["", "-1", "---", "nan", "inf", "-inf", "1e400", "0", "x", '"', "True", ";", ",", "1,5", "9" * 30, "\x00", "#"]


def text_of(kind: str, k: int) -> list[str]:
    header, mark, cells = KINDS[kind]
    moved = 1e-3 * k * X + [0.02 * k, -0.01 * k]
    return [header, *(mark.join(map(str, cells(i, x, u))) for i, (x, u) in enumerate(zip(X, moved, strict=True)))]


def spoil_cells(rng, lines, mark):
    for _ in range(int(rng.integers(1, 40))):
        row = int(rng.integers(0, len(lines)))
        cells = lines[row].split(mark)
        cells[int(rng.integers(0, len(cells)))] = str(rng.choice(WORDS))
        lines[row] = mark.join(cells)


def spoil_column(rng, lines, mark):
    word, at = str(rng.choice(WORDS)), int(rng.integers(0, lines[-1].count(mark) + 1))
    for row in range(1, len(lines)):
        lines[row] = mark.join(word if j == at else cell for j, cell in enumerate(lines[row].split(mark)))


def spoil_rows(rng, lines, mark):
    kept = rng.integers(1, len(lines), int(rng.integers(0, len(lines))))
    lines[1:] = [lines[k] for k in kept]


def spoil_bytes(rng, lines, mark):
    text = "\n".join(lines)
    start, n = int(rng.integers(0, len(text))), int(rng.integers(1, 60))
    lines[:] = [text[:start] + "".join(map(chr, rng.integers(0, 500, n))) + text[start + n:]]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("spoil", [spoil_cells, spoil_column, spoil_rows, spoil_bytes])
def test_a_spoilt_stage_is_read_or_refused(tmp_path, kind, spoil):
    outcomes = {"read": 0, "refused": 0}
    for seed in range(25):
        rng = np.random.default_rng(seed)
        for k in range(3):
            lines = text_of(kind, k)
            if k == seed % 3:
                spoil(rng, lines, KINDS[kind][1])
            (tmp_path / f"{seed}_{k}.csv").write_text("\n".join(lines), encoding="utf-8")
        try:
            series = FieldSeries.open(sorted(tmp_path.glob(f"{seed}_*.csv")), pixel_size_mm=0.05)
            stack = FieldStack(series, series.measured_points([0]))
            check_stages(stack, range(stack.n_frames))
            series.log()
            outcomes["read"] += 1
            moved = stack.frame(stack.n_frames - 1)
            assert not np.isinf(moved).any()
        except InputError as error:
            outcomes["refused"] += 1
            assert error.expected and error.found and error.remedy and error.file, str(error)
    assert outcomes["refused"] > 0


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300, -1e16])
@pytest.mark.parametrize("part", [np.s_[...], np.s_[..., 0], np.s_[..., -1], np.s_[0, 0, 2, 3, 1]])
def test_positions_of_no_place_are_read_as_lost_points_or_refused(tmp_path, value, part):
    grid = np.stack(np.meshgrid(np.arange(8.0), np.arange(6.0)), 0)[None, ..., None] * (10.0 + 0.1 * np.arange(3))
    grid[part] = value
    np.save(tmp_path / "fields.npy", grid)
    _read_or_refused(tmp_path)


@pytest.mark.parametrize("shape", [(0, 2, 3, 3, 4), (4, 2, 0, 3, 2), (4, 2, 3, 0, 2), (1, 2, 1, 1, 2), (1, 2, 3, 3, 1)])
def test_arrays_of_no_points_or_one_image_are_refused(tmp_path, shape):
    np.save(tmp_path / "fields.npy", np.zeros(shape))
    with pytest.raises(InputError):
        _read(tmp_path)


@pytest.mark.parametrize("ids", [0, 1000])
def test_a_stage_without_a_point_of_the_reference_is_refused(tmp_path, ids):
    for k in range(3):
        rows = [f"{k},{i + ids * k},{x},{y},{0.01 * k * x},0" for i, (x, y) in enumerate(X)]
        (tmp_path / f"s_{k}.csv").write_text("\n".join(["stage,id,x_mm,y_mm,ux_mm,uy_mm", *rows]))
    if not ids:
        _read(tmp_path)
    else:
        with pytest.raises(InputError):
            _read(tmp_path)


def test_a_stage_with_another_number_of_coordinates_is_refused(tmp_path):
    """Found by the campaign: the trees of nearest points raised."""
    for k in range(3):
        lines = text_of("vic", k)
        if k == 2:
            lines[0] = lines[0].replace("Z", "").replace("W", "")
        (tmp_path / f"s_{k}.csv").write_text("\n".join(lines))
    with pytest.raises(InputError, match="other columns than the first"):
        _read(tmp_path)


def test_a_stage_of_aramis_with_a_short_row_is_refused(tmp_path):
    for k in range(3):
        (tmp_path / f"s_{k}.csv").write_text("\n".join(text_of("aramis", k)).replace("1;1;1.0;now", "1"))
    with pytest.raises(InputError, match="not a number"):
        _read(tmp_path)


def test_a_damaged_header_of_numpy_is_refused(tmp_path):
    """Its text is parsed as Python: a bracket that is never closed raises an error of the tokenizer."""
    np.save(tmp_path / "fields.npy", np.zeros((1, 2, 3, 4, 2)))
    content = (tmp_path / "fields.npy").read_bytes()
    damaged = content.replace(b"(1, 2, 3, 4, 2)", "(((¨, 2, 3, 4 ".encode())
    assert len(damaged) == len(content) and damaged != content
    (tmp_path / "fields.npy").write_bytes(damaged)
    with pytest.raises(InputError, match="not a readable NumPy file"):
        _read(tmp_path)


@pytest.mark.parametrize("factor", [0.0, 1e-72])
def test_points_on_a_line_have_no_outline(factor):
    """Found by the campaign: Qhull finds no triangle, and the places along a side were counted beyond memory."""
    assert len(loops_of(X * [factor, 1.0], 1.5)) == 0
    assert notched_axis(X * [1.0, 1e200], 1e-100) is None


def _read(folder):
    series = FieldSeries.open(sorted(folder.iterdir()), unit="mm")
    stack = FieldStack(series, series.measured_points([0]))
    check_stages(stack, range(stack.n_frames))


def _read_or_refused(folder):
    try:
        _read(folder)
    except InputError as problem:
        assert problem.expected and problem.remedy
