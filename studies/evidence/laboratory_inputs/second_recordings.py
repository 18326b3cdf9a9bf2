"""A second author's recordings: names that cameras give, films, losses, signs and ends, causes that `check` tells."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import tifffile
from outcome import Input, order_of, right_if, warnings_of
from strip import RAMP, force_of, image, log_text, write
from typer.testing import CliRunner

from idic.cli.app import app

N = len(RAMP)
NAMES = {
    "Photron, camera and session in the name": [f"C001H001S{1 + k // 6:04d}{k % 6 + 1:06d}.tif" for k in range(N)],
    "pylon, milliseconds over midnight": [
        f"Basler_acA2440__23456789__2025110{3 + (k >= 5)}_{'235959' if k < 5 else '000000'}{(500 + 100 * k) % 1000:03d}"
        ".tif" for k in range(N)],
    "VIC-Snap, camera at the end": [f"strip-{k:04d}_0.tif" for k in range(N)],
    "photo camera, 9999 then 0001": [f"IMG_{(9994 + k) % 9999 + 1:04d}.tif" for k in range(N)],
    "seconds with decimals": [f"t_{0.5 * k:g}s.tif" for k in range(N)],
    "forces": [f"{250 * k}N.tif" for k in range(N)],
    "Windows copies": ["test.tif", *(f"test ({k}).tif" for k in range(2, N + 1))],
    "Micro-Manager": [f"img_channel000_position000_time{k:09d}_z000.tif" for k in range(N)],
    "time with a zone": [f"2025-11-03T14-05-{3 * k:02d}+0100.tif" for k in range(N)],
    "seconds of an epoch": [f"{1762178709.25 + 0.25 * k:.2f}.tif" for k in range(N)]}


def frames(strain: Sequence[float]) -> list[np.ndarray]:
    """An image of every strain."""
    return [image(e, k) for k, e in enumerate(strain)]


def named(names: Sequence[str], folder: Path) -> tuple[str, str]:
    """The order of time; the files bear no times."""
    write(folder, names, frames(RAMP), log_text(RAMP))
    for name in names:
        os.utime(folder / "images" / name, (1.7e9,) * 2)
    labels = order_of(folder)
    return right_if(labels == list(names), labels)


def counted_down(folder: Path) -> tuple[str, str]:
    """Numbers that fall in time; the files were saved in order: two orders are told, as the motion has no direction."""
    names = [f"shot_{N - k:02d}.tif" for k in range(N)]
    write(folder, names, frames(RAMP), log_text(RAMP))
    for k, name in enumerate(names):
        os.utime(folder / "images" / name, (1.7e9 + 10.0 * k,) * 2)
    warnings = warnings_of(folder)
    return right_if("two orders of the images" in warnings and "shot_12.tif, shot_11.tif" in warnings, warnings)


def listed(folder: Path) -> tuple[str, str]:
    """The log names the images, whose own names say nothing of their order: told, or taken."""
    names = [f"{letter}.tif" for letter in "kdiacjbhlgef"]
    write(folder, names, frames(RAMP), log_text(RAMP))
    rows = log_text(RAMP).splitlines()
    (folder / "loads.csv").write_text("\n".join(["image,force_N,grip_mm", *(
        f"{name},{row.split(',', 1)[1]}" for name, row in zip(names, rows[1:], strict=True))]) + "\n")
    labels = order_of(folder)
    return right_if(labels == names, labels)


def film(shown: Sequence[int], codec: str, suffix: str, folder: Path) -> tuple[str, str]:
    """A film in which some frames are shown twice: these are proposed for exclusion."""
    states = np.linspace(0.0, 0.02, max(shown) + 1)
    write(folder, [], [], log_text(np.linspace(0.0, 0.02, len(shown))))
    stream = cv2.VideoWriter(str(folder / f"test{suffix}"), cv2.VideoWriter_fourcc(*codec), 10.0, (240, 110), True)
    for k in shown:
        stream.write(cv2.cvtColor(image(states[k], k), cv2.COLOR_GRAY2BGR))
    stream.release()
    text = (folder / "experiment.toml").read_text().replace("images/*.tif", f"test{suffix}")
    (folder / "experiment.toml").write_text(text)
    warnings = warnings_of(folder)
    doubles = sum(a == b for a, b in pairwise(shown))
    return right_if(("repeat" in warnings) == bool(doubles) and (not doubles or f"{doubles} " in warnings), warnings)


def told(words: Sequence[str], absent: Sequence[str], folder: Path, strain: Sequence[float] = tuple(RAMP),
         force: np.ndarray | None = None, pictures: Callable[[], list[np.ndarray]] | None = None, text: str = "",
         change: tuple[str, str] = ("", "")) -> tuple[str, str]:
    """`check` says each of these words (of `a|b` one) and none of the absent ones."""
    shown = frames(strain) if pictures is None else pictures()
    write(folder, [f"f{k:02d}.tif" for k in range(len(shown))], shown, text or log_text(strain, force))
    toml = folder / "experiment.toml"
    toml.write_text(toml.read_text().replace(*change) if change[0] else toml.read_text())
    warnings = warnings_of(folder)
    has_all = all(any(part in warnings for part in word.split("|")) for word in words)
    return right_if(has_all and not any(word in warnings for word in absent), warnings)


def lost(folder: Path) -> tuple[str, str]:
    """Two of twelve images were lost; the log counts all twelve: the rows of the ten are taken."""
    kept = [k for k in range(N) if k not in (5, 6)]
    write(folder, [f"f{k:02d}.tif" for k in kept], [image(RAMP[k], k) for k in kept], log_text(RAMP))
    from idic.experiment_file import load_experiment
    force = load_experiment(folder).model.channels[0].values
    return right_if(np.allclose(force, force_of(RAMP[kept]), atol=30.0), np.round(force))


def gone_dark(at: int, level: float) -> list[np.ndarray]:
    """From a frame on the lamp is off, or the specimen has left the view."""
    dark = np.random.default_rng(3).normal(level, 1.5, (N, 110, 240))
    return [image(e, k) if k < at else np.clip(np.rint(dark[k]), 0, 255).astype(np.uint8) for k, e in enumerate(RAMP)]


def user(*words: object) -> tuple[int, str]:
    """Exit code and the words of a command."""
    result = CliRunner().invoke(app, [str(word) for word in words])
    return result.exit_code, result.output


def initialised(make: Callable[[Path], None], wanted: Sequence[str], folder: Path) -> tuple[str, str]:
    """`init` writes an experiment with these words; `check` accepts it, or asks for what it marked FILL IN."""
    folder.mkdir(parents=True)
    make(folder)
    code, output = user("init", folder)
    tomls = sorted(folder.rglob("experiment.toml"))
    text = "\n".join(toml.read_text() for toml in tomls)
    if code or not all(word in text for word in wanted):
        return right_if(False, f"init {code}: {output} {text[:1500]}")
    answers = [user("check", toml.parent) for toml in tomls]
    accepted = all(code == 0 or "FILL IN" in said or "FILL IN" in text for code, said in answers)
    crashed = any(code not in (0, 2) for code, _ in answers)
    return right_if(accepted and not crashed, [said[-600:] for code, said in answers if code])


def two_films(folder: Path, names: Sequence[str] = ("left.avi", "right.avi")) -> None:
    """A film of each camera and the calibration of the pair."""
    for shift, name in enumerate(names):
        stream = cv2.VideoWriter(str(folder / name), cv2.VideoWriter_fourcc(*"MJPG"), 10.0, (240, 110), True)
        for k, e in enumerate(RAMP):
            stream.write(cv2.cvtColor(image(e, k, shift_px=4.0 * shift), cv2.COLOR_GRAY2BGR))
        stream.release()
    storage = cv2.FileStorage(str(folder / "cal.yml"), cv2.FILE_STORAGE_WRITE)
    matrix = np.array([[2400.0, 0, 120], [0, 2400.0, 55], [0, 0, 1]])
    turn = cv2.Rodrigues(np.array([0.0, np.radians(-15.0), 0.0]))[0]
    for name, value in {"M1": matrix, "D1": np.zeros(5), "M2": matrix, "D2": np.zeros(5), "R": turn,
                        "T": np.array([65.0, 0.0, 8.0])}.items():
        storage.write(name, value)
    storage.release()
    (folder / "loads.csv").write_text(log_text(RAMP))


def one_film(folder: Path) -> None:
    """A film and a log of a machine beside it."""
    two_films(folder)
    for name in ("right.avi", "cal.yml"):
        (folder / name).unlink()


def specimens(folder: Path) -> None:
    """A folder of each specimen."""
    for k, name in enumerate(("A 0deg", "B 45deg", "C 90deg")):
        (folder / name / "images").mkdir(parents=True)
        for j, e in enumerate(RAMP):
            tifffile.imwrite(folder / name / "images" / f"{j:03d}.tif", image(e, 20 * k + j))
        (folder / name / "force.csv").write_text(log_text(RAMP))


def stages_and_deck(folder: Path) -> None:
    """An export of VIC-2D and a deck of CalculiX."""
    (folder / "export").mkdir()
    x, y = (v.ravel() for v in np.meshgrid(np.arange(20, 220, 6.0), np.arange(15, 95, 6.0)))
    for k, e in enumerate(RAMP):
        rng = np.random.default_rng(k)
        u, v = e * (x - 20) + rng.normal(0, 0.01, x.shape), -0.3 * e * (y - 55) + rng.normal(0, 0.01, x.shape)
        (folder / "export" / f"strip-{k:04d}_0.csv").write_text('"x", "y", "u", "v", "sigma"\n' + "".join(
            f"{a:g}, {b:g}, {c:.5f}, {d:.5f}, 0.008\n" for a, b, c, d in zip(x, y, u, v, strict=True)))
    (folder / "machine.csv").write_text(log_text(RAMP))


def recordings() -> Iterator[Input]:
    """All of them."""
    for name, names in NAMES.items():
        yield Input("order of frames", name, partial(named, names))
    yield Input("order of frames", "counted down, saved in order", counted_down)
    yield Input("order of frames", "the log names the images", listed)
    doubled = [k * 4 // 5 for k in range(20)]
    yield Input("copies", "a lossless film, 24 shown as 30", partial(film, doubled, "FFV1", ".avi"))
    yield Input("copies", "a lossy film, 24 shown as 30", partial(film, doubled, "mp4v", ".mp4"))
    yield Input("copies", "a lossy film without copies", partial(film, list(range(16)), "mp4v", ".mp4"))
    hold = np.concatenate([RAMP[:7], np.full(5, RAMP[6])])
    relaxed = force_of(hold) * np.concatenate([np.ones(7), 1 - 0.04 * np.arange(1, 6)])
    yield Input("copies", "grips held, the force relaxes", partial(told, [], ["repeat"], strain=hold, force=relaxed))
    yield Input("copies", "two images lost, the log counts on", lost)
    yield Input("sign and end", "force cell not tared", partial(told, [], ["factor"], force=force_of(RAMP) + 400))
    cycle = 0.008 * np.sin(np.arange(N) / 1.7)
    yield Input("sign and end", "tension and compression", partial(
        told, [], ["factor", "exclude_frames"], strain=cycle))
    yield Input("sign and end", "compression positive, not tared", partial(
        told, ["factor = -1"], [], force=-force_of(RAMP) - 250))
    after = np.where(np.arange(N) > 8, 0.0, force_of(RAMP))
    proposal = json.dumps([f"f{k:02d}.tif" for k in range(9, N)])
    yield Input("sign and end", "the lamp fails", partial(told, [proposal], [], pictures=partial(gone_dark, 9, 5.0)))
    yield Input("sign and end", "the specimen leaves the view", partial(
        told, [proposal], ["factor"], force=after, pictures=partial(gone_dark, 9, 40.0)))
    kilo = log_text(RAMP, force_of(RAMP) / 1000).replace("force_N", "Load (kN)")
    yield Input("sign and end", "force in kN by its header", partial(
        told, [], ["factor", "unit of"], text=kilo, change=('column = "force_N"', 'column = "Load (kN)"')))
    yield Input("advice", "pixel size ten times too large", partial(
        told, ["unit of grip_mm|pixel_size"], [], change=("pixel_size_mm = 0.1", "pixel_size_mm = 1.0")))
    yield Input("advice", "mirrored, axes stated so", partial(
        told, ["axes|mirror|sign of grip_mm"], [], change=("pixel_size_mm = 0.1",
                                                           'pixel_size_mm = 0.1\naxes = ["-col", "-row"]')))
    yield Input("init", "two films and a calibration", partial(initialised, two_films, [
        "left.avi", "right.avi", "cal.yml", "[[camera]]"]))
    yield Input("init", "two films, cam0 and cam1", partial(initialised, partial(two_films, names=(
        "cam0.avi", "cam1.avi")), ["cam0.avi", "cam1.avi", "cal.yml", "[[camera]]"]))
    yield Input("init", "a film and a log", partial(initialised, one_film, ["left.avi", "loads.csv"]))
    yield Input("init", "three specimens", partial(initialised, specimens, ["images/*.tif", "force.csv"]))
    yield Input("init", "stages of VIC-2D", partial(initialised, stages_and_deck, ["export/*.csv", "machine.csv"]))

