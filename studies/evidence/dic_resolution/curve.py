"""Noise against spatial resolution of the free FE-DIC, of square subsets and of public codes: table and figure.

    python studies/evidence/dic_resolution/curve.py STAR SAMPLE_14 [--peers PYTHON] [--picture PNG]

STAR holds the star images of the DIC Challenge 2.0 (Reu et al. 2022, doi:10.1007/s11340-021-00806-6), as pyvale carries
them: a vertical motion of 0.5 px whose vertical period grows from 10 to 300 px. SAMPLE_14 holds Sample14_*.tif and
exact.csv. PYTHON is an interpreter with pyvale or al-dic.

Resolution: the period below which more than a tenth of the amplitude is lost. Noise: the motion of a still image, the
reference with fresh noise, rms over the pixels of the field, of a free FE-DIC over those inside its elements. Both
measured on the same images for every code; the figure of merit is their product (Grediac, Blaysat and Sur 2017,
doi:10.1007/s11340-017-0279-x).
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import map_coordinates, spline_filter
from subsets import subset_motion

import idic
from idic.correlation import build_experiment_reference

KEPT, WINDOW = 0.9, 0.05  # of the amplitude; half width of the window of periods, relative
AFFINE, QUADRATIC = "subsets, affine", "subsets, quadratic"
MARGIN, STEP, STILL_STEP = 60, 8, 16  # px: all codes are compared inside the margin
AMPLITUDE, PERIODS, COLUMNS = 0.5, (10.0, 300.0), 4000  # of the star
STAR_COLUMNS = 2000  # periods to 155 px
KAPPA = 0.843  # of the noise, that the quintic spline leaves (docs/method.md, section 6)
FE_DIC = [(element, order, kind, None) for element in (20, 24, 32, 40, 48) for order, kind in
          (("quadratic", "mechanical"), ("quadratic", "none"))] + \
         [(element, "as_given", "none", None) for element in (16, 24)] + \
         [(element, "quadratic", "mechanical", 32.0) for element in (16, 32)]
WIDE = [(element, "quadratic", "mechanical", None) for element in (64, 80, 96)]
SUBSETS = [(half, False) for half in (8, 10, 14)] + [(half, True) for half in (14, 16, 20)]
WIDE_SUBSETS = [(half, False) for half in (13, 15)] + [(half, True) for half in (36, 44)]
PEERS = [("pyvale-AFFINE", 17), ("pyvale-AFFINE", 21), ("pyvale-AFFINE", 29), ("pyvale-QUAD", 29), ("pyvale-QUAD", 33),
         ("pyvale-QUAD", 41), ("al-dic", 16), ("al-dic", 20), ("al-dic", 28)]
WIDE_PEERS = [("pyvale-AFFINE", 27), ("pyvale-AFFINE", 31), ("pyvale-QUAD", 73), ("pyvale-QUAD", 89), ("al-dic", 28)]


@dataclass(frozen=True, eq=False)
class Test:
    """images : (ny, nx) GV, the reference, the moved ones, a still one; exact, period : of the moved ones, (ny, nx)

    component : 0 column, 1 row, which the motion has; few_waves : see `resolution`
    """

    name: str
    images: list[np.ndarray]
    exact: list[np.ndarray]
    period: list[np.ndarray]
    component: int
    noise_gv: float
    few_waves: bool


@dataclass(frozen=True)
class Row:
    code: str
    size: str
    noise_px: float
    resolution_px: float
    cpu_s: float

    @property
    def product(self) -> float:
        return self.noise_px * self.resolution_px


def read(file: Path) -> np.ndarray:
    return np.asarray(Image.open(file), dtype=float)


def with_still(name: str, images: list, exact: list, period: list, component: int) -> Test:
    """The test with a still image: the noise is what the exact motion leaves between the images."""
    row, column = np.mgrid[:images[0].shape[0], :images[0].shape[1]].astype(float)
    place = [row + (exact[0] if component == 1 else 0.0), column + (exact[0] if component == 0 else 0.0)]
    left = map_coordinates(spline_filter(images[1], 5), place, order=5, prefilter=False) - images[0]
    inner = (slice(MARGIN, -MARGIN), slice(MARGIN, -MARGIN))
    noise = float(np.median(np.abs(left[inner] - np.median(left[inner])))) / 0.6745 / np.sqrt(1.0 + KAPPA)
    still = images[0] + np.sqrt(2.0) * noise * np.random.default_rng(0).standard_normal(images[0].shape)
    return Test(name, [*images, np.clip(np.rint(still), 0, 255)], exact, period, component, noise, len(exact) > 1)


def star(folder: Path) -> Test:
    images = [read(folder / f"DIC_Challenge_Star_Noise_{name}.tiff")[:, :STAR_COLUMNS] for name in ("Ref", "Def")]
    ny, nx = images[0].shape
    period = PERIODS[0] + (PERIODS[1] - PERIODS[0]) * np.arange(nx) / (COLUMNS - 1)
    y = np.arange(ny)[:, None] - (ny - 1) / 2
    return with_still("star", images, [AMPLITUDE * np.cos(2 * np.pi * y / period)], [np.tile(period, (ny, 1))], 1)


def sample_14(folder: Path) -> Test:
    table, levels = np.loadtxt(folder / "exact.csv", delimiter=",", skiprows=1), (1, 3, 5)
    images = [read(folder / "Sample14_Reference.tif"),
              *(read(folder / f"Sample14_L{level}_Amp0.1b.tif") for level in levels)]
    exact, period, column = [], [], np.arange(images[0].shape[1], dtype=float)
    for level in levels:
        wave = np.interp(column, table[:, 0], table[:, level])
        zeros = column[1:][wave[1:] * wave[:-1] < 0]
        middles, periods = np.array([((a + b) / 2, 2 * (b - a)) for a, b in pairwise(zeros)]).T
        exact.append(np.tile(wave, (len(images[0]), 1)))
        period.append(np.tile(np.interp(column, middles, periods), (len(images[0]), 1)))
    return with_still("sample 14", images, exact, period, 0)


def resolution(test: Test, fields: list[np.ndarray], order: int) -> float:
    """Shortest period of which `KEPT` of the amplitude is left; NaN outside of the test.

    Where the waves are few, by the loss (l/period)^order that fits those longer than the shortest best.

    fields : (ny, nx), NaN where not measured; order : 2 of affine subsets, 4 of what reproduces quadratic motion
    """
    moved = [np.isfinite(field) & np.isfinite(exact) for field, exact in zip(fields, test.exact, strict=True)]
    period, exact, values = (np.concatenate([array[mask] for array, mask in zip(arrays, moved, strict=True)])
                             for arrays in (test.period, test.exact, fields))
    if test.few_waves:
        x, power = period ** -float(order), exact * exact
        loss = float(((power - values * exact) * x).sum() / (power * x * x).sum())
        return float((max(loss, 0.0) / (1.0 - KEPT)) ** (1.0 / order))
    ranks = np.argsort(period)
    work, power = (np.concatenate([[0.0], np.cumsum(part[ranks])]) for part in (values * exact, exact * exact))
    periods = np.geomspace(period.min() * (1 + WINDOW), period.max() / (1 + WINDOW), 300)
    first, end = (np.searchsorted(period[ranks], periods * factor) for factor in (1 - WINDOW, 1 + WINDOW))
    gain = (work[end] - work[first]) / np.maximum(power[end] - power[first], 1e-12)
    kept = int(np.argmax(gain >= KEPT))
    if kept == 0:  # all waves, or none
        return float("nan")
    return float(np.exp(np.interp(KEPT, gain[kept - 1:kept + 1], np.log(periods[kept - 1:kept + 1]))))


def inside(field: np.ndarray) -> np.ndarray:
    """The field without the margin of the image."""
    cut = np.full(field.shape, np.nan)
    window = (slice(MARGIN, -MARGIN), slice(MARGIN, -MARGIN))
    cut[window] = field[window]
    return cut


def measured(test: Test, code: str, size: str, fields: Callable[[], list[np.ndarray]]) -> Row:
    """fields : makes those of the moved images and, last, of the still one  # (ny, nx) px, of the test's component"""
    began = time.process_time()
    *moved, still = [inside(field) for field in fields()]
    order = 2 if code in ("al-dic", "pyvale-AFFINE", AFFINE) else 4
    return Row(code, size, float(np.nanstd(still)), resolution(test, moved, order), time.process_time() - began)


def fe_dic(test: Test, element: float, order: str, kind: str, length: float | None) -> Row:
    def fields() -> list[np.ndarray]:
        ny, nx = test.images[0].shape
        experiment = idic.Experiment(images=np.array(test.images).astype(np.uint8),
                                     mesh={"roi_px": [10, 10, nx - 11, ny - 11], "element_px": element},
                                     options={"element_order": order, "edge_margin_px": 0})
        motion = experiment.free_motion(kind, length)
        pixels = build_experiment_reference(motion.experiment, motion.experiment.model.camera).pixel_map
        return [pixels.to_image(pixels.interpolate(u_px)[:, test.component], np.nan) for u_px in motion.u_px[1:]]

    nodes = {"quadratic": "8-node", "as_given": "4-node"}[order]
    name = "default" if (order, kind, length) == ("quadratic", "mechanical", None) else \
        f"{nodes}, {'none' if kind == 'none' else f'{length:g} px'}"
    return measured(test, f"idic, {name}", f"{element:g}", fields)


def on_pixels(test: Test, x: np.ndarray, y: np.ndarray, values: np.ndarray) -> np.ndarray:
    field = np.full(test.images[0].shape, np.nan)
    field[np.rint(y).astype(int), np.rint(x).astype(int)] = values
    return field


def subsets(test: Test, half: int, quadratic: bool) -> Row:
    def fields() -> list[np.ndarray]:
        ny, nx = test.images[0].shape
        motions = []
        for k, image in enumerate(test.images[1:], 1):
            step = max(STILL_STEP if k == len(test.images) - 1 else STEP, half // 2)
            grid = np.mgrid[MARGIN:ny - MARGIN:step, MARGIN:nx - MARGIN:step]
            centres = grid[::-1].reshape(2, -1).T.copy()
            motion = subset_motion(test.images[0], image, centres, half, quadratic)
            motions.append(on_pixels(test, *centres.T, motion[:, test.component]))
        return motions

    return measured(test, QUADRATIC if quadratic else AFFINE, str(2 * half + 1), fields)


def peer(test: Test, python: str, code: str, size: int) -> Row | None:
    """One public code; None where it is not installed or fails."""
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / f"image_{k}.tiff" for k in range(len(test.images))]
        for file, image in zip(files, test.images, strict=True):
            Image.fromarray(image.astype(np.uint8)).save(file)
        script, result = Path(__file__).with_name("peers.py"), Path(folder) / "fields.npz"
        run = subprocess.run([python, str(script), code, str(size), str(STEP), str(MARGIN), str(result),
                              *map(str, files)], capture_output=True, text=True)
        if not result.exists():
            sys.stderr.write(f"{code} {size}: {run.stderr[-300:]}\n")
            return None
        data = np.load(result)
        places, values = (data["x"], data["y"]), data["uv"[test.component]]
    return measured(test, code, str(size), lambda: [on_pixels(test, *places, frame) for frame in values])


def rows_of(test: Test, python: str | None) -> list[Row]:
    wide = test.few_waves  # they begin at 100 px
    rows: list[Row] = []

    def add(row: Row | None) -> None:
        if row is not None:
            rows.append(row)
            sys.stdout.write(f"| {test.name} | {row.code} | {row.size} | {row.noise_px:.5f} | "
                             f"{row.resolution_px:.1f} | {row.product:.4f} |\n")
            sys.stdout.flush()

    for settings in WIDE if wide else FE_DIC:
        add(fe_dic(test, *settings))
    for half, quadratic in WIDE_SUBSETS if wide else SUBSETS:
        add(subsets(test, half, quadratic))
    for code, size in (WIDE_PEERS if wide else PEERS) if python else ():
        add(peer(test, python, code, size))
    return rows


def picture(tables: dict[str, list[Row]], path: Path) -> None:
    """Noise over resolution: a code is best below and left of the others."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, len(tables), figsize=(9.0, 3.6), constrained_layout=True)
    for axis, (name, rows) in zip(np.atleast_1d(axes), tables.items(), strict=True):
        for code in dict.fromkeys(row.code for row in rows):
            points = sorted((row.resolution_px, row.noise_px) for row in rows if row.code == code
                            and np.isfinite(row.resolution_px))
            if points:
                axis.loglog(*np.array(points).T, "o-" if code.startswith("idic") else "s--", markersize=4, label=code)
        axis.set(xlabel="period that keeps nine tenths [px]", ylabel="noise [px]", title=name)
        for side in (axis.xaxis, axis.yaxis):
            side.set_major_formatter("{x:g}")
            side.set_minor_formatter("{x:g}")
            side.set_tick_params(which="both", labelsize=6)
        axis.legend(fontsize=6)
    figure.savefig(path, dpi=150)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("star", type=Path)
    parser.add_argument("sample_14", type=Path)
    parser.add_argument("--peers", help="interpreter with pyvale or al-dic")
    parser.add_argument("--picture", type=Path)
    words = parser.parse_args()
    tests = [star(words.star), sample_14(words.sample_14)]
    sys.stdout.write("".join(f"noise of {test.name}: {test.noise_gv:.2f} GV\n" for test in tests))
    sys.stdout.write("| images | code | size [px] | noise [px] | resolution [px] | product |\n" + "| --- " * 6 + "|\n")
    tables = {test.name: rows_of(test, words.peers) for test in tests}
    if words.picture:
        picture(tables, words.picture)


if __name__ == "__main__":
    main()
