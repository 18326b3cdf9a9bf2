"""Files with one thing to be seen each: clock times, axes of images, failed points, units, decks, devices."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import tifffile
from decks import decks
from outcome import Input, right_if
from strip import RAMP, force_of, image, write

from idic.experiment_file import load_experiment
from idic.readers import open_stack

N = len(RAMP)
FIELD_TOML = """[experiment]
fields = "stages/*.csv"
mesh = { around_points_mm = 0.5, element_mm = 4 }
kind = "plane_stress"
MORE
[material.SPECIMEN]
law = "elastic"
E = 70e3
nu = { value = 0.3, identify = true }
[[boundary]]
nodes = "LEFT"
u = "measured"
[[boundary]]
nodes = "RIGHT"
u = "measured"
"""


def clock(rows: list[str], header: str, times: list[str], folder: Path) -> tuple[str, str]:
    """Images of known times are matched with a log of clock times: the force of every image is that of its time."""
    write(folder, [f"f{k:02d}.tif" for k in range(N)], [image(e, k) for k, e in enumerate(RAMP)],
          header + "\n" + "\n".join(rows) + "\n", more='image_times = "times.csv"')
    (folder / "times.csv").write_text("time\n" + "\n".join(times) + "\n", encoding="utf-8")
    force = load_experiment(folder).model.channels[0].values
    return right_if(np.allclose(force, force_of(RAMP), atol=1.0), np.round(force, 1))


def clocks() -> Iterator[Input]:
    """Logs of ten rows per image, in the times of a clock."""
    def stamps(form: Callable[[float], str], start: float, step: float, number: int) -> list[str]:
        return [form(start + step * k) for k in range(number)]

    def day(t: float) -> tuple[int, int, float]:
        return int(t // 3600) % 24, int(t // 60) % 60, round(t % 60, 3)

    forms: dict[str, tuple[Callable[[float], str], float, str, str]] = {
        "hh:mm:ss": (lambda t: "{:02d}:{:02d}:{:04.1f}".format(*day(t)), 36000.0, ",", "."),
        "over midnight": (lambda t: "{:02d}:{:02d}:{:04.1f}".format(*day(t)), 86370.0, ",", "."),
        "decimal comma": (lambda t: "{:02d}:{:02d}:{:04.1f}".format(*day(t)).replace(".", ","), 3600.0, ";", ","),
        "date and time": (lambda t: "2025-11-0{:d} {:02d}:{:02d}:{:04.1f}".format(2 + int(t // 86400), *day(t)),
                          86370.0, ",", "."),
        "day.month.year": (lambda t: "03.11.2025 {:02d}:{:02d}:{:04.1f}".format(*day(t)), 40000.0, ";", "."),
        "am and pm": (lambda t: "{:d}:{:02d}:{:04.1f} {}".format(day(t)[0] % 12 or 12, *day(t)[1:],
                                                                "AM" if t % 86400 < 43200 else "PM"),
                      43180.0, ",", "."),
        "minutes and seconds": (lambda t: f"{int(t // 60):02d}:{t % 60:04.1f}", 20.0, ",", ".")}
    for name, (form, start, separator, mark) in forms.items():
        fine = np.interp(np.arange(0, 5 * (N - 1) + 0.1, 0.5), 5 * np.arange(N), RAMP)
        rows = [separator.join([stamp, f"{f:.2f}".replace(".", mark), f"{20 * e:.5f}".replace(".", mark)])
                for stamp, f, e in zip(stamps(form, start, 0.5, len(fine)), force_of(fine), fine, strict=True)]
        yield Input("clock times", name, partial(clock, rows, separator.join(["time", "force_N", "grip_mm"]),
                                                 stamps(form, start, 5.0, N)))


def tiff(save: Callable[[Path], None], number: int, values: Callable[[list[np.ndarray]], bool],
         folder: Path) -> tuple[str, str]:
    """A file holds so many images with these values."""
    folder.mkdir(parents=True)
    save(folder / "a.tif")
    stack = open_stack([folder / "a.tif"], with_gaps=True)
    pictures = [np.asarray(stack.frame(k)) for k in range(stack.n_frames)]
    return right_if(len(pictures) == number and values(pictures), (len(pictures), pictures[0].shape))


def tiffs() -> Iterator[Input]:
    """What laboratories save as TIFF."""
    stack = np.random.default_rng(0).integers(0, 200, (6, 40, 50)).astype(np.uint8)
    deep = np.random.default_rng(1).integers(0, 4095, (40, 50)).astype(np.uint16)
    heights = np.random.default_rng(2).normal(0, 1, (40, 50)).astype(np.float32)
    holes = heights.copy()
    holes[3:6, 4:9] = -9999.0
    colours = np.stack([np.arange(256, dtype=np.uint16) * 257] * 3)
    red = colours.copy()
    red[:, 250:] = [[65535], [0], [0]]
    write = tifffile.imwrite

    def pyramid(path: Path) -> None:
        with tifffile.TiffWriter(path) as stream:
            stream.write(deep, subifds=1)
            stream.write(deep[::2, ::2], subfiletype=1)

    cases: dict[str, tuple[Callable, int, Callable]] = {
        "pages in time": (lambda p: write(p, stack), 6, lambda v: (v[3] == stack[3]).all()),
        "ImageJ, one page": (lambda p: write(p, stack, imagej=True, truncate=True, metadata={"axes": "TYX"}), 6,
                             lambda v: (v[5] == stack[5]).all()),
        "ImageJ, T and Z": (lambda p: write(p, stack.reshape(3, 2, 40, 50), imagej=True, metadata={"axes": "TZYX"}),
                            0, lambda v: True),
        "ImageJ, C": (lambda p: write(p, stack.reshape(3, 2, 40, 50), imagej=True, metadata={"axes": "TCYX"}), 0,
                      lambda v: True),
        "OME, T": (lambda p: write(p.with_name("a.ome.tif"), stack, metadata={"axes": "TYX"}) or
                   p.with_name("a.ome.tif").rename(p), 6, lambda v: (v[2] == stack[2]).all()),
        "16 bit": (lambda p: write(p, deep), 1, lambda v: (v[0] == deep).all()),
        "16 bit, deflated": (lambda p: write(p, deep, compression="deflate", predictor=True), 1,
                             lambda v: (v[0] == deep).all()),
        "big-endian": (lambda p: write(p, deep, byteorder=">"), 1, lambda v: (v[0] == deep).all()),
        "tiles": (lambda p: write(p, deep, tile=(16, 16)), 1, lambda v: (v[0] == deep).all()),
        "grey palette": (lambda p: write(p, stack[0], photometric="palette", colormap=colours), 1,
                         lambda v: (v[0] == stack[0]).all()),
        "palette with an overlay": (lambda p: write(p, stack[0], photometric="palette", colormap=red), 1,
                                    lambda v: (v[0] == stack[0]).all()),
        "white is zero": (lambda p: write(p, stack[0], photometric="miniswhite"), 1,
                          lambda v: (v[0] == 255 - stack[0]).all() or (v[0] == stack[0]).all()),
        "colour": (lambda p: write(p, np.stack([stack[0]] * 3, axis=-1)), 1, lambda v: np.abs(
            v[0].astype(float) - stack[0]).max() <= 1),
        "grey with alpha": (lambda p: write(p, np.stack([stack[0], np.full_like(stack[0], 255)], axis=-1),
                                            photometric="minisblack", extrasamples=["unassalpha"]), 1,
                            lambda v: (v[0] == stack[0]).all()),
        "a pyramid": (pyramid, 1, lambda v: (v[0] == deep).all()),
        "double precision": (lambda p: write(p, heights.astype(float)), 1, lambda v: np.allclose(v[0], heights)),
        "an empty page at the end": (lambda p: write(p, np.concatenate([stack, 0 * stack[:1]])), 7,
                                     lambda v: (v[5] == stack[5]).all()),
        "heights with a nodata tag": (lambda p: write(p, holes, extratags=[(42113, "s", 0, "-9999", True)]), 1,
                                      lambda v: np.isnan(v[0][3:6, 4:9]).all() and np.isfinite(v[0]).sum() == 1985)}
    for name, (save, number, values) in cases.items():
        yield Input("axes of files", name, partial(tiff, save, number, values))


def field(table: Callable[[int, np.ndarray, np.ndarray, np.ndarray, np.ndarray], str], more: str, failed: int,
          folder: Path) -> tuple[str, str]:
    """Stages of 40 x 16 points; points 0 to 6 of the last stage failed: mean strain 0.4 % per stage along x."""
    (folder / "stages").mkdir(parents=True)
    x, y = (v.ravel() for v in np.meshgrid(np.arange(40) * 0.5, np.arange(16) * 0.5))
    for k in range(4):
        rng = np.random.default_rng(k)
        u, v = (0.004 * k * x + rng.normal(0, 2e-4, x.shape), -0.0012 * k * y + rng.normal(0, 2e-4, x.shape))
        (folder / "stages" / f"s_{k}.csv").write_text(table(k, x, y, u, v), encoding="utf-8")
    (folder / "experiment.toml").write_text(FIELD_TOML.replace("MORE", more))
    experiment = load_experiment(folder)
    values = np.asarray(experiment.recording.stack.frame(3))
    measured = np.isfinite(values).all(axis=1)
    at = experiment.recording.points.positions_px[:, 0]
    strain = 1e-3 * np.polyfit(at[measured] * experiment.recording.points.pitch_mm, values[measured, 0], 1)[0]
    return right_if((~measured).sum() == failed and abs(strain - 0.012) < 3e-4, ((~measured).sum(), strain))


def fields() -> Iterator[Input]:
    """Exports with failed points, units and directions."""
    def rows(header: str, row: Callable[..., str]) -> Callable:
        return lambda k, x, y, u, v: "\n".join([header, *(row(i, k == 3 and i < 7, *p) for i, p in enumerate(
            zip(x, y, u, v, strict=True)))]) + "\n"

    named = '\n[fields.columns]\nx = "px"\ny = "py"\nux = "dx"\nuy = "dy"\nunit = "mm"\n'
    cases: dict[str, tuple[Callable, str, int]] = {
        "empty cells": (rows("x_mm,y_mm,ux_mm,uy_mm", lambda i, bad, x, y, u, v: f"{x},{y},,"
                             if bad else f"{x},{y},{u},{v}"), "", 7),
        "NaN": (rows("x_mm,y_mm,ux_mm,uy_mm", lambda i, bad, x, y, u, v: f"{x},{y},NaN,nan"
                     if bad else f"{x},{y},{u},{v}"), "", 7),
        "rows left out": (lambda k, x, y, u, v: "\n".join(
            ["x_mm,y_mm,ux_mm,uy_mm", *(f"{a},{b},{c},{d}" for i, (a, b, c, d)
                                        in enumerate(zip(x, y, u, v, strict=True)) if not (k == 3 and i < 7))]) + "\n",
                          "", 7),
        "pyvale, converged 0": (rows("subset_x,subset_y,disp_u,disp_v,disp_mag,converged,cost_zncc,ftol,xtol,num_iter,",
                                     lambda i, bad, x, y, u, v: f"{20 * x},{160 - 20 * y},{20 * u},{-20 * v},0,"
                                     f"{'0' if bad else '1'},{'0.1' if bad else '0.99'},0,0,9"),
                                "[camera]\npixel_size_mm = 0.05", 7),
        "VIC, sigma -1": (rows('"X","Y","Z","U","V","W","sigma"', lambda i, bad, x, y, u, v:
                               "0,0,0,0,0,0,-1" if bad else f"{x},{y},0,{u},{v},0,0.01"), 'fields_unit = "mm"', 7),
        "DICe, MATCH -1": (rows("COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,GAMMA,MATCH",
                                lambda i, bad, x, y, u, v: f"{20 * x},{160 - 20 * y},{'67' if bad else 20 * u},"
                                f"{'68' if bad else -20 * v},{'-1' if bad else '0.01'},{'-1' if bad else '0'}"),
                           "[camera]\npixel_size_mm = 0.05", 7),
        "named columns with a quality": (rows("px,py,dx,dy,zncc", lambda i, bad, x, y, u, v:
                                              f"{x},{y},{'9' if bad else u},{v},{'0.2' if bad else '0.98'}"),
                                         named + 'quality = "zncc"\nquality_min = 0.7\n', 7),
        "named columns with a flag": (rows("px;py;dx;dy;ok", lambda i, bad, x, y, u, v:
                                           f"{x};{y};{'9' if bad else u};{v};{'0' if bad else '1'}"),
                                      named + 'flag = "ok"\n', 7),
        "decimal commas": (lambda k, x, y, u, v: "x_mm;y_mm;ux_mm;uy_mm\n" + "".join(
            f"{a};{b};{c:.6f};{d:.6f}\n".replace(".", ",") for a, b, c, d in zip(x, y, u, v, strict=True)), "", 0),
        "metres": (rows("x [m],y [m],ux [m],uy [m]", lambda i, bad, x, y, u, v:
                        f"{1e-3 * x:.7f},{1e-3 * y:.7f},{1e-3 * u:.9f},{1e-3 * v:.9f}"), "", 0),
        "displaced positions": (rows("x_mm,y_mm,ux_mm,uy_mm", lambda i, bad, x, y, u, v:
                                     f"{x + u:.5f},{y + v:.5f},{u:.6f},{v:.6f}"), "", 0)}
    for name, (table, more, failed) in cases.items():
        yield Input("failed points and units", name, partial(field, table, more, failed))


def files() -> Iterator[Input]:
    """All of them."""
    yield from clocks()
    yield from tiffs()
    yield from fields()
    yield from decks()
