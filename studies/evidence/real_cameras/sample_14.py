"""Noise against spatial resolution of the free FE-DIC on DIC Challenge sample 14: table and figure.

    python studies/evidence/real_cameras/sample_14.py DATA [PICTURE]

DATA holds Sample14_*.tif and exact.csv (the horizontal displacement of every column of pixels: a wave of 0.1 px whose
period falls from about 1000 px to 100 px). Noise: scatter of the displacement within a column of nodes, px rms.
Resolution: the period at which nine tenths of the amplitude are kept.
"""

from __future__ import annotations

import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path

import numpy as np

from idic import load_experiment
from idic.measure import Regularisation, dic_stack

TOML = """
[experiment]
images = "frame_*.tif"
mesh = {{ roi_px = [24, 22, 2024, 566], element_px = {element} }}
kind = "plane_stress"
[material.ALL]
law = "elastic"
E = 1000.0
nu = 0.3
[[boundary]]
nodes = "OUTER"
u = "measured"
[options]
element_order = "{order}"
edge_margin_px = 0
"""
LEVELS = (1, 3, 5)
ROWS = [(8, "as_given", "none"), (8, "as_given", "mechanical"), (12, "as_given", "none"), (16, "as_given", "none"),
        (16, "as_given", "mechanical"), (24, "as_given", "none"), (32, "as_given", "none"), (48, "as_given", "none"),
        (64, "as_given", "none"), (16, "quadratic", "none"), (24, "quadratic", "none"), (32, "quadratic", "none"),
        (48, "quadratic", "none"), (64, "quadratic", "none")]
LONGER = [(8, "as_given", length) for length in (50.0, 100.0, 200.0)]
KEPT = 0.9
FINEST = 55.0  # px: half the shortest wave; below, the extrapolation is a matter of noise
WINDOW = 0.6  # half width of the window in which a gain is found, periods


def columns_of(x: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places of the columns of nodes, mean and variance of the values in each."""
    places, index = np.unique(np.round(x, 6), return_inverse=True)
    count = np.bincount(index)
    mean = np.bincount(index, values) / count
    return places, mean, np.bincount(index, (values - mean[index]) ** 2) / (count - 1)


def gains(places: np.ndarray, mean: np.ndarray, exact: np.ndarray) -> list[tuple[float, float]]:
    """(local period in px, amplitude kept) along the wave, between its zeros."""
    column = np.arange(len(exact), dtype=float)
    zeros = column[1:][exact[1:] * exact[:-1] < 0]
    at_columns = np.interp(column, places, mean)
    kept_amplitudes = []
    for first, end in pairwise(zeros):
        period, middle = 2.0 * (end - first), 0.5 * (first + end)
        in_window = (np.abs(column - middle) < WINDOW * period) & (column > places[0]) & (column < places[-1])
        if in_window.sum() > WINDOW * period:  # the last waves lie beyond the last column of coarse meshes
            share = at_columns[in_window] @ exact[in_window] / (exact[in_window] @ exact[in_window])
            kept_amplitudes.append((period, float(share)))
    return kept_amplitudes


def resolution(points: list[tuple[float, float]]) -> float:
    """Period below which less than `KEPT` of the amplitude is left, from a fit of 1 - (l/period)^2 to all of them."""
    period, gain = np.array(sorted(points)).T
    x = period**-2.0
    loss = float(((1.0 - gain) * x).sum() / (x * x).sum())  # 1 - gain = loss / period^2, what short waves lose first
    return float(np.sqrt(max(loss, 0.0) / (1.0 - KEPT)))


def measure(data: Path, element: float, order: str, regularisation) -> dict:
    """One row: noise, error of the column average, amplitude kept at the shortest waves, resolution."""
    with tempfile.TemporaryDirectory() as folder:
        names = ["Sample14_Reference.tif", *(f"Sample14_L{level}_Amp0.1b.tif" for level in LEVELS)]
        for k, name in enumerate(names):
            (Path(folder) / f"frame_{k}.tif").symlink_to((data / name).resolve())
        (Path(folder) / "experiment.toml").write_text(TOML.format(element=element, order=order), encoding="utf-8")
        experiment = load_experiment(folder)
        kind, length = (("mechanical", regularisation) if isinstance(regularisation, float) else (regularisation, None))
        began = time.process_time()
        motion = dic_stack(experiment, Regularisation(kind, length))
        cpu = time.process_time() - began
    exact = np.loadtxt(data / "exact.csv", delimiter=",", skiprows=1)
    x, y = experiment.model.camera.project(experiment.model.mesh.nodes).T
    inner = (x > x.min()) & (x < x.max()) & (y > y.min()) & (y < y.max())
    scatter, error, points = [], [], []
    for k, level in enumerate(LEVELS, 1):
        used = inner & np.isfinite(motion.u_px[k, :, 0])
        places, mean, variance = columns_of(x[used], motion.u_px[k, used, 0])
        scatter.append(np.mean(variance))
        error.append(np.mean((mean - np.interp(places, exact[:, 0], exact[:, level])) ** 2))
        points += gains(places, mean, exact[:, level])
    shortest = sorted(points)[:6]
    return {"element": element, "order": order, "regularisation": kind, "length": motion.length_px,
            "noise": float(np.sqrt(np.mean(scatter))), "error": float(np.sqrt(np.mean(error))),
            "kept": float(np.mean([gain for _, gain in shortest])), "period": float(np.mean([p for p, _ in shortest])),
            "resolution": resolution(points), "converged": int(motion.converged[1:].sum()), "cpu_s": cpu}


def picture(rows: list[dict], path: Path) -> None:
    """Noise over resolution, one line per kind of element and regularisation."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axis = plt.subplots(figsize=(6.0, 3.6), constrained_layout=True)
    lines = {("as_given", "none"): "4-node elements", ("quadratic", "none"): "8-node elements",
             ("as_given", "mechanical"): "4-node, regularised"}
    for (order, kind), label in lines.items():
        points = sorted((r["resolution"], r["noise"], r["element"]) for r in rows
                     if (r["order"], r["regularisation"]) == (order, kind) and r["resolution"] > FINEST)
        axis.loglog([r for r, _, _ in points], [n for _, n, _ in points], "o-", label=label, markersize=4)
        for r, n, element in points:
            axis.annotate(f"{element:g}", (r, n), textcoords="offset points", xytext=(4, 3), fontsize=7)
    axis.set(xlabel="period that keeps nine tenths of its amplitude [px]", ylabel="noise [px]")
    for side, ticks in ((axis.xaxis, (60, 100, 200, 400)), (axis.yaxis, (0.005, 0.01, 0.02, 0.04))):
        side.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
        side.set_minor_formatter("")
    axis.legend()
    figure.savefig(path, dpi=150)


def main() -> None:
    data = Path(sys.argv[1])
    rows = [measure(data, *row) for row in [*ROWS, *LONGER]]
    sys.stdout.write("| element [px] | nodes | regularisation | noise [px] | error of column means [px] | kept at "
                     f"{rows[0]['period']:.0f} px | nine tenths kept from [px] | CPU s |\n" + "| --- " * 8 + "|\n")
    for r in rows:
        kind = "none" if r["regularisation"] == "none" else f"mechanical, {r['length']:.0f} px"
        period = f"{r['resolution']:.0f}" if r["resolution"] > FINEST else f"< {FINEST:g}"
        sys.stdout.write(f"| {r['element']:g} | {4 if r['order'] == 'as_given' else 8} | {kind} | {r['noise']:.4f} | "
                         f"{r['error']:.4f} | {r['kept']:.3f} | {period} | {r['cpu_s']:.0f} |\n")
    if len(sys.argv) > 2:
        picture(rows, Path(sys.argv[2]))


if __name__ == "__main__":
    main()
