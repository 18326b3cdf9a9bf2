"""Draws of a whole field test: images of a foreign mesh, noise, a foreign subset DIC, its export, `idic identify`.

    python studies/evidence/fields_draws.py --draws 200 --processes 8 --out draws.csv

A polymer strip with a hole is stretched by 0.9 % (9 stages, E, nu). Its images come from another, finer mesh
and from code that shares nothing with what identifies (`idic.virtual_tests.rendering`); they get noise and are rounded
to 8 bits. A subset DIC (`idic_studies.subset_dic`) measures 17 px subsets, 8 px apart; they are written as a VIC export
beside the log of the machine, whose force has noise, too. idic gets these files and what a user writes: a mesh of the
view, ends that move as measured, the width of the subsets. Nothing tells it the noise. Every draw has noise of
its own in all images, the reference included, and in the force. With `--images N` the images of the first N draws are
identified, too.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from pathlib import Path

import numpy as np

from idic.images import Camera
from idic.run import identify_run
from idic.virtual_tests import DemoSize
from idic_studies.examples.open_hole_strip import POLYMER, polymer, write_clean
from idic_studies.subset_dic import subset_displacements, subset_grid

SIZE = DemoSize(0.1, (200, 300), (3, 3, 3), (4, 6, 3), (7, 9, 5), 1)
FORCE_NOISE_N, GRIP_MM = 1.0, 0.25
HALF, STEP, MARGIN_PX = 8, 8, 2
START = {"E": 1900.0, "nu": 0.38}
QUANTILE_95 = 1.959964
NAMES = tuple(START)

FIELDS = """
[experiment]
fields = "stages/*.csv"
fields_subset_mm = {subset}
loads = "loads.csv"
mesh = {{ roi_mm = [{left:.4f}, {low}, {right:.4f}, {high}], holes_mm = [[0, 0, {radius}]], element_mm = {element} }}
kind = "plane_stress"
thickness_mm = {thickness}
[material.ALL]
law = "elastic"
kinematics = "finite"
{start}
[[boundary]]
nodes = "LEFT"
u = "measured"
[[boundary]]
nodes = "RIGHT"
u = "measured"
[[channel]]
column = "force_N"
simulated = {{ reaction = "RIGHT", component = "x" }}
"""


def specimen(camera: Camera) -> np.ndarray:
    """Pixels of the strip, `MARGIN_PX` from its edges  # (ny, nx) bool"""
    ny, nx = SIZE.shape
    column, row = np.meshgrid(np.arange(nx), np.arange(ny))
    x, y = camera.inverse(np.column_stack([column.ravel(), row.ravel()]).astype(float)).T
    margin = MARGIN_PX * SIZE.pixel
    inside = ((np.abs(x) < 0.5 * DemoSize.LENGTH - margin) & (np.abs(y) < 0.5 * DemoSize.WIDTH - margin)
              & (np.hypot(x, y) > DemoSize.RADIUS + margin))
    return inside.reshape(ny, nx)


def write_export(folder: Path, images: np.ndarray, force: np.ndarray, camera: Camera, element_mm: float,
                 order: int = 3) -> None:
    """The export of the subset DIC, the log and the experiment.toml."""
    centres = subset_grid(specimen(camera), HALF, STEP)
    moved = subset_displacements(list(images), centres, HALF, order)
    at = camera.inverse(centres.astype(float))
    later = camera.inverse((centres + moved).reshape(-1, 2)).reshape(moved.shape)
    (folder / "stages").mkdir(parents=True)
    for k, place in enumerate(later):
        rows = [f"{x:.5f}, {y:.5f}, {u:.6f}, {v:.6f}, {sigma:g}"
                for (x, y), (u, v), sigma in zip(at, np.nan_to_num(place - at),
                                                 np.where(np.isfinite(place[:, 0]), 0.01, -1.0), strict=True)]
        (folder / "stages" / f"stage_{k:03d}.csv").write_text("\n".join(['"X", "Y", "U", "V", "sigma"', *rows]))
    (folder / "loads.csv").write_text("\n".join(["frame,force_N", *(f"{k},{f:.4f}" for k, f in enumerate(force))]))
    x_left, x_right = at[:, 0].min(), at[:, 0].max()
    start = "\n".join(f"{name} = {{ value = {value}, identify = true }}" for name, value in START.items())
    (folder / "experiment.toml").write_text(FIELDS.format(
        subset=(2 * HALF + 1) * SIZE.pixel, left=x_left, right=x_right, low=-0.5 * DemoSize.WIDTH,
        high=0.5 * DemoSize.WIDTH, radius=DemoSize.RADIUS,
        element=element_mm, thickness=DemoSize.THICKNESS, start=start))


def draw(clean: str, camera: Camera, element_mm: float, noise_gv: float, order: int, of_images: bool,
         seed: int) -> dict:
    """One draw: seed, name -> value and standard deviation by the fields, and by the images (`image_` before).

    clean : file of the images without noise, GV, and of the force, N; order : of the splines of the subset DIC
    """
    images, force = (np.load(clean)[name] for name in ("images", "force"))
    rng = np.random.default_rng((24, seed))
    noisy = np.clip(np.rint(images + rng.normal(0.0, noise_gv, images.shape)), 0, 255)
    read = force + rng.normal(0.0, FORCE_NOISE_N, len(force))
    began = time.process_time()
    with tempfile.TemporaryDirectory() as scratch:
        write_export(Path(scratch) / "fields", noisy, read, camera, element_mm, order)
        entries = _identified(Path(scratch) / "fields", Path(scratch) / "run", "")
        if of_images:
            write_images(Path(scratch) / "images", noisy, read, camera, element_mm)
            entries |= _identified(Path(scratch) / "images", Path(scratch) / "run_images", "image_")
    return {"seed": seed, "cpu_s": round(time.process_time() - began, 1), **entries}


def write_images(folder: Path, images: np.ndarray, force: np.ndarray, camera: Camera, element_mm: float) -> None:
    """The same images as a test of their own: the same mesh, the same ends."""
    import tifffile

    (folder / "images").mkdir(parents=True)
    for k, image in enumerate(images):
        tifffile.imwrite(folder / "images" / f"frame_{k:03d}.tif", image.astype(np.uint8))
    (folder / "loads.csv").write_text("\n".join(["frame,force_N", *(f"{k},{f:.4f}" for k, f in enumerate(force))]))
    fields = (folder.parent / "fields" / "experiment.toml").read_text()
    scale = (f"[camera]\npixel_size_mm = {SIZE.pixel}\norigin_px = {camera.project(np.zeros((1, 2)))[0].tolist()}\n"
             "axes = [\"+col\", \"-row\"]\n[material.ALL]")
    text = fields.replace('fields = "stages/*.csv"', 'images = "images/*.tif"').replace("[material.ALL]", scale)
    text = "\n".join(line for line in text.splitlines() if not line.startswith("fields_subset_mm"))
    (folder / "experiment.toml").write_text(text)


def _identified(folder: Path, out: Path, prefix: str) -> dict:
    result = identify_run(folder, out)
    identified = {f"{prefix}status": result["status"], f"{prefix}chi2": result["residual"].get("image_chi2_dof")}
    entries = result["parameters"]
    for name in NAMES:
        entry = entries[f"ALL.{name}"]
        identified |= {f"{prefix}{name}": entry["value"], f"{prefix}{name}_std": entry["std"],
                  f"{prefix}{name}_noise": entry["std_noise"]}
    return identified


def told(rows: list[dict]) -> str:
    """Coverage, scatter and bias of the draws, and fields against images."""
    lines = [f"{len(rows)} draws, {sum(row['status'] == 'converged' for row in rows)} converged, "
             f"mean chi2 {np.mean([row['chi2'] for row in rows]):.3f}, {np.mean([row['cpu_s'] for row in rows]):.0f} "
             "CPU s a draw"]
    for prefix in ("", "image_"):
        draws = [row for row in rows if f"{prefix}E" in row]
        if not draws:
            continue
        lines.append(f"by images, {len(draws)} draws:" if prefix else "by fields:")
        for name in NAMES:
            value, std, noise = (np.array([row[f"{prefix}{name}{end}"] for row in draws], float)
                                 for end in ("", "_std", "_noise"))
            error = value - POLYMER[f"sheet.{name}"]
            coverage, by_noise = (100.0 * np.mean(np.abs(error) < QUANTILE_95 * deviation)
                                  for deviation in (std, noise))
            lines.append(f"  {name:18} held {coverage:5.1f} % (by std_noise {by_noise:5.1f} %), std {std.mean():.4g} "
                         "of "
                         f"noise {noise.mean():.4g}, scatter {value.std(ddof=1):.4g}, mean error {error.mean():+.4g}")
    pairs = [row for row in rows if "image_E" in row]
    if pairs:
        lines.append("fields less images, over the root of the sum of both variances:")
        for name in NAMES:
            difference = np.array([(row[name] - row[f"image_{name}"])
                                   / np.hypot(row[f"{name}_std"], row[f"image_{name}_std"]) for row in pairs])
            lines.append(f"  {name:18} within 2: {100.0 * np.mean(np.abs(difference) < 2.0):5.1f} %, mean "
                         f"{difference.mean():+.2f}, rms {np.sqrt(np.mean(difference**2)):.2f}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--element", type=float, default=1.0, help="mm")
    parser.add_argument("--noise", type=float, default=4.0, help="of the images, grey values of 256")
    parser.add_argument("--order", type=int, default=3, help="of the splines that the subset DIC interpolates by")
    parser.add_argument("--images", type=int, default=0, help="of so many draws the images, too")
    parser.add_argument("--minutes", type=float, default=1e9, help="no draw is begun after so many")
    parser.add_argument("--out", type=Path, default=Path("draws.csv"))
    chosen, began = parser.parse_args(), time.monotonic()
    rows: list[dict] = []
    with tempfile.TemporaryDirectory() as folder:
        test, clean = polymer(SIZE, GRIP_MM), Path(folder) / "clean.npz"
        rendered = write_clean(Path(folder), test)
        np.savez(clean, images=np.array([rendered.frame(k) for k in range(rendered.n_frames)]),
                 force=np.asarray(test.columns[0].values))
        job = partial(_in_time, began + 60.0 * chosen.minutes, str(clean), test.camera, chosen.element,
                      chosen.noise, chosen.order)
        with ProcessPoolExecutor(chosen.processes) as pool:
            for task in as_completed([pool.submit(job, k < chosen.images, chosen.first + k)
                                      for k in range(chosen.draws)]):
                if (row := task.result()) is None:
                    continue
                rows.append(row)
                with chosen.out.open("w", newline="") as stream:
                    writer = csv.DictWriter(stream, max(map(list, rows), key=len))
                    writer.writeheader()
                    writer.writerows(sorted(rows, key=lambda row: row["seed"]))
                if len(rows) % 20 == 0:
                    print(told(rows), flush=True)
    print(told(rows), flush=True)


def _in_time(end: float, *arguments) -> dict | None:
    return None if time.monotonic() > end else draw(*arguments)


if __name__ == "__main__":
    main()
