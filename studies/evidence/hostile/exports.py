"""Exports of other DIC systems, spoilt: read as fields, or an experiment written for them and checked."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

from idic.readers import FieldSeries, FieldStack, check_stages
from idic_studies.evidence.hostile.bases import Base
from idic_studies.evidence.hostile.counting import Case, Scene, command

STAGES = 3
INIT_SHARE = 0.15  # of the cases: through `idic init` and `idic check`
GRID = np.stack(np.meshgrid(np.arange(9) * 1.5, np.arange(7) * 1.5), axis=-1).reshape(-1, 2)
ARAMIS = ("# Units: length:mm time:s\n# Stage: 1\nstage;index;relative_time;date\n1;1;1.0;now\n# Name : Surface\n"
          "id;x;y;z;displacement_x;displacement_y;displacement_z")
TEXTS: dict[str, tuple[str, str, Callable]] = {
    "vic": ("X,Y,Z,U,V,W,sigma", ",", lambda i, x, u: (*x, 0.0, *u, 0.0, 0.01)),
    "dice": ("SUBSET_ID,COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,SIGMA,MATCH", ",",
             lambda i, x, u: (i, *x, *u, 0.01, 0)),
    "pyvale": ("subset_x,subset_y,disp_u,disp_v,converged,cost_zncc,", ",", lambda i, x, u: (*x, *u, 1, 0.99)),
    "aramis": (ARAMIS, ";", lambda i, x, u: (i, *(x + u), 0.0, *u, 0.0)),
    "al-dic": ("node_id,x_px,y_px,disp_u,disp_v", ",", lambda i, x, u: (i, *x, *u)),
    "table": ("stage,id,x_mm,y_mm,ux_mm,uy_mm", ",", lambda i, x, u: (1, i, *x, *u)),
}
WORDS = ["", "-1", "---", "nan", "inf", "-inf", "1e400", "0", "x", '"', "True", ";", ",", "1,5", "9" * 5000, "\x00",
         "#", "1e300", "-1e300", "\ud7ff", "../secret/secret.txt", "1e-320", "=1+1"]


def exports(base: Base) -> Case:
    """Three stages of a format, one of them spoilt, or all alike."""
    def case(scene: Scene) -> str:
        folder = scene.work / "stages"
        folder.mkdir()
        writers = (*TEXTS, "array", "matlab")
        kind = writers[int(scene.rng.integers(len(writers)))]
        if kind == "array":
            _write_array(scene, folder)
        elif kind == "matlab":
            _write_matlab(scene, folder)
        else:
            _write_texts(scene, folder, kind)
        return _read(scene, folder)
    return case


def _read(scene: Scene, folder: Path) -> str:
    if scene.rng.random() < INIT_SHARE:
        answer = command("init", folder)
        return command("check", folder, "--no-picture") if answer == "done" else answer
    series = FieldSeries.open(sorted(folder.iterdir()), pixel_size_mm=0.05 if scene.rng.integers(10) else None)
    stack = FieldStack(series, series.measured_points([0]))
    check_stages(stack, range(stack.n_frames))
    series.log()
    for k in range(stack.n_frames):
        if np.isinf(stack.frame(k)).any():
            raise ValueError("an infinite displacement was read")
    return "read"


# texts ------------------------------------------------------------------------------------------------
def _write_texts(scene: Scene, folder: Path, kind: str) -> None:
    header, mark, cells = TEXTS[kind]
    spoilt = int(scene.rng.integers(-1, STAGES))  # -1: every stage
    for k in range(STAGES):
        moved = 1e-3 * k * GRID + [0.02 * k, -0.01 * k]
        lines = [header, *(mark.join(map(str, cells(i, x, u))) for i, (x, u) in enumerate(zip(GRID, moved,
                                                                                               strict=True)))]
        if k == spoilt or spoilt < 0:
            for _ in range(int(scene.rng.integers(1, 3))):
                SPOILINGS[int(scene.rng.integers(len(SPOILINGS)))](scene.rng, lines, mark)
        (folder / f"stage_{k}.csv").write_text("\n".join(lines), encoding="utf-8", errors="replace")


def _word(rng: np.random.Generator) -> str:
    return WORDS[int(rng.integers(len(WORDS)))]


def _cells(rng, lines: list[str], mark: str) -> None:
    for _ in range(int(rng.choice((1, 2, 5, 60)))):
        row = int(rng.integers(len(lines))) if lines else 0
        cells = lines[row].split(mark)
        cells[int(rng.integers(len(cells)))] = _word(rng)
        lines[row] = mark.join(cells)


def _column(rng, lines: list[str], mark: str) -> None:
    word, place = _word(rng), int(rng.integers(lines[-1].count(mark) + 1))
    lines[1:] = [mark.join(word if j == place else cell for j, cell in enumerate(line.split(mark)))
                 for line in lines[1:]]


def _header(rng, lines: list[str], mark: str) -> None:
    cells = lines[0].split(mark)
    choice = rng.integers(4)
    if choice == 0:
        rng.shuffle(cells)
    elif choice == 1:
        cells.append(cells[int(rng.integers(len(cells)))])
    elif choice == 2:
        del cells[int(rng.integers(len(cells)))]
    else:
        cells[int(rng.integers(len(cells)))] = _word(rng)
    lines[0] = mark.join(cells)


def _rows(rng, lines: list[str], mark: str) -> None:
    rows = rng.integers(1, max(2, len(lines)), int(rng.integers(0, len(lines) + 1)))
    lines[1:] = [lines[k] for k in rows if k < len(lines)]


def _bytes(rng, lines: list[str], mark: str) -> None:
    text = "\n".join(lines)
    start, n = int(rng.integers(len(text) + 1)), int(rng.integers(1, 80))
    lines[:] = (text[:start] + "".join(map(chr, rng.integers(0, 1200, n))) + text[start + n:]).split("\n")


def _wide(rng, lines: list[str], mark: str) -> None:
    row = int(rng.integers(len(lines)))
    lines[row] += mark * int(rng.integers(1, 30_000))


def _scaled(rng, lines: list[str], mark: str) -> None:
    """One column of numbers times an absurd factor."""
    factor = 10.0 ** float(rng.integers(-300, 300))
    place = int(rng.integers(lines[-1].count(mark) + 1))

    def product(cell: str) -> str:
        try:
            return repr(float(cell) * factor)
        except (ValueError, OverflowError):
            return cell

    lines[1:] = [mark.join(product(cell) if j == place else cell for j, cell in enumerate(line.split(mark)))
                 for line in lines[1:]]


def _gaps(rng, lines: list[str], mark: str) -> None:
    """Points without a value, as systems write them."""
    word, share = ("nan", "", "0", "-1", "NaN")[int(rng.integers(5))], rng.random()
    place = int(rng.integers(lines[-1].count(mark) + 1))
    lines[1:] = [mark.join(word if j == place and rng.random() < share else cell
                           for j, cell in enumerate(line.split(mark))) for line in lines[1:]]


def _noisy(rng, lines: list[str], mark: str) -> None:
    """Numbers with noise of any size: points that move past each other, fall together, lie on a line."""
    size, place = 10.0 ** float(rng.uniform(-6, 3)), int(rng.integers(lines[-1].count(mark) + 1))

    def moved(cell: str) -> str:
        try:
            return repr(float(cell) + size * float(rng.normal()))
        except ValueError:
            return cell

    lines[1:] = [mark.join(moved(cell) if j == place else cell for j, cell in enumerate(line.split(mark)))
                 for line in lines[1:]]


SPOILINGS = (_gaps, _noisy, _gaps, _noisy, _cells, _column, _header, _rows, _bytes, _wide, _scaled)


# binary files ---------------------------------------------------------------------------------------
def _write_array(scene: Scene, folder: Path) -> None:
    rng = scene.rng
    shape = [2, 7, 9, STAGES]
    grid = np.stack(np.meshgrid(np.arange(9.0), np.arange(7.0)), 0)[..., None] * (10.0 + 0.1 * np.arange(STAGES))
    grid = grid[None]
    choice = int(rng.integers(6))
    if choice == 0:
        grid = np.zeros([int(n) for n in rng.integers(0, 5, int(rng.integers(0, 7)))])
    elif choice == 1:
        values = (np.nan, np.inf, -np.inf, 1e300, -1e16, 1e-320, 0.0)
        for _ in range(int(rng.integers(1, 200))):
            grid.ravel()[int(rng.integers(grid.size))] = values[int(rng.integers(len(values)))]
    elif choice == 2:
        grid = grid.astype(("f2", "f4", "i1", "u8", "c16", "?", "S3", "U2", "M8[s]")[int(rng.integers(9))],
                           casting="unsafe", copy=True)
    elif choice == 3:
        grid = np.moveaxis(grid, int(rng.integers(5)), int(rng.integers(5)))
    elif choice == 4:
        grid = np.full([1, *shape], (np.nan, np.inf, 1e308, 0.0)[int(rng.integers(4))])
    np.save(folder / "fields.npy", grid)
    if choice == 5:
        _spoil_bytes(rng, folder / "fields.npy", 300)


def _write_matlab(scene: Scene, folder: Path) -> None:
    """As Ncorr writes: HDF5 with references; groups and data sets of other shapes and types."""
    rng, values = scene.rng, (np.nan, np.inf, -1.0, 0.0, 1e300, 1.0)
    with h5py.File(folder / "ncorr.mat", "w") as file:
        for name in ("data_dic_save", "reference_save", "current_save", "#refs#"):
            if rng.integers(8):
                group = file.create_group(name)
                for key in ("displacements", "dispinfo", "imgcorr", "roi", "gs", "units", "spacing", "pixtounits",
                            "u", "v", "plot_u_dic", "x", "y"):
                    if rng.integers(2):
                        shape = [int(n) for n in rng.integers(0, 6, int(rng.integers(0, 4)))]
                        kind = ("f8", "u2", "u1", "S4")[int(rng.integers(4))]
                        data = np.full(shape, values[int(rng.integers(6))]) if kind == "f8" else np.zeros(shape, kind)
                        group.create_dataset(key, data=data)
                        group[key].attrs["MATLAB_class"] = np.bytes_(("double", "struct", "cell", "char")[
                            int(rng.integers(4))])
    if rng.integers(3) == 0:
        _spoil_bytes(rng, folder / "ncorr.mat", None)


def _spoil_bytes(rng: np.random.Generator, file: Path, within: int | None) -> None:
    content = bytearray(file.read_bytes())
    for _ in range(int(rng.integers(1, 30))):
        content[int(rng.integers(min(len(content), within or len(content))))] = int(rng.integers(256))
    if rng.integers(3) == 0:
        content = content[: int(rng.integers(len(content)))]
    file.write_bytes(bytes(content))
