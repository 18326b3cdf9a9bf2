"""Recordings with one thing to be seen each: order, copies and losses, late cameras, signs and ends of tests."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import tifffile
from outcome import Input, order_of, right_if, warnings_of
from strip import LENGTH_MM, RAMP, force_of, image, log_text, write

N = len(RAMP)
MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")
NAMES = {  # image names in the order of time
    "24-hour clock over midnight": [f"cam_{(23 * 60 + 50 + 3 * k) // 60 % 24:02d}-{(50 + 3 * k) % 60:02d}-00.tif"
                                    for k in range(N)],
    "12-hour clock over noon": [f"{(11 * 60 + 45 + 5 * k) // 60 % 12 or 12:02d}.{(45 + 5 * k) % 60:02d}.00 "
                                f"{'AM' if 45 + 5 * k < 60 else 'PM'}.tif" for k in range(N)],
    "day before month": [f"shot {day:02d}-{month:02d}-2025.tif" for day, month in
                         ((28, 1), (30, 1), (2, 2), (5, 2), (9, 2), (27, 2), (1, 3), (3, 3), (20, 3), (1, 4), (4, 4),
                          (9, 5))],
    "names of months": [f"{month}_10.tif" for month in MONTHS],
    "numbers without zeros": [f"img{k}.tif" for k in range(1, N + 1)],
    "signed, from the trigger": [f"shot{k:+d}.tif" for k in range(-5, N - 5)],
    "m for minus": [f"t{'m' if k < 0 else 'p'}{abs(k):03d}.tif" for k in range(-4, N - 4)],
    "counter that wraps": [f"c_{(995 + k) % 1000:03d}.tif" for k in range(N)],
    "two counters": [f"run{2 + k // 6}_{k % 6}.tif" for k in range(N)],
    "step before time": [f"load{9 - k // 3}_{k:02d}.tif" for k in range(N)],
    "hashes, saved in order": [f"{hash_name}.tif" for hash_name in
                               ("9f2c", "03ab", "e871", "55d0", "b1f9", "1c3e", "c4a2", "7b70", "2d11", "f00d", "4e5a",
                                "8888")],
    "hexadecimal": [f"frame_{k:02X}.tif" for k in range(4, N + 4)]}


def ordered(names: Sequence[str], folder: Path) -> tuple[str, str]:
    """The order is that of time, or it is refused until it is stated."""
    write(folder, names, [image(e, k) for k, e in enumerate(RAMP)], log_text(RAMP))
    for k, name in enumerate(names):
        os.utime(folder / "images" / name, (1.7e9 + 10.0 * k,) * 2)
    labels = order_of(folder)
    return right_if(labels == list(names), labels)


def told(strain, words: str, folder: Path, images=None, force=None, absent: str = "") -> tuple[str, str]:
    """`check` tells these words, and not others."""
    images = [image(e, k) for k, e in enumerate(strain)] if images is None else images()
    write(folder, [f"f{k:02d}.tif" for k in range(len(images))], images, log_text(strain, force))
    warnings = warnings_of(folder)
    is_told = all(word in warnings for word in words.split("|"))
    return right_if(is_told and not (absent and absent in warnings), warnings)


def copies(shown: Sequence[int], folder: Path) -> tuple[str, str]:
    """The frames that repeat the one before are those that are proposed for exclusion."""
    states = np.linspace(0.0, 0.02, max(shown) + 1)
    exposures = [image(e, k) for k, e in enumerate(states)]
    write(folder, [f"f{k:02d}.tif" for k in range(len(shown))], [exposures[k] for k in shown],
          log_text(np.linspace(0.0, 0.02, len(shown))))
    repeats = [f"f{k:02d}.tif" for k in range(1, len(shown)) if shown[k] == shown[k - 1]]
    warnings = warnings_of(folder)
    return right_if(json.dumps(repeats) in warnings if repeats else "repeat" not in warnings, warnings)


def late(frames: float, folder: Path) -> tuple[str, str]:
    """A second camera so many frames late."""
    moments = np.arange(16.0)
    strain = np.interp(moments, [0, 4, 10, 20], [0.0, 0.0, 0.012, 0.05])
    write(folder, [f"f{k:02d}.tif" for k in range(16)], [image(e, k) for k, e in enumerate(strain)], log_text(strain))
    (folder / "second").mkdir()
    for k, e in enumerate(np.interp(moments + frames, [0, 4, 10, 20], [0.0, 0.0, 0.012, 0.05])):
        tifffile.imwrite(folder / "second" / f"f{k:02d}.tif", image(e, 100 + k))
    text = (folder / "experiment.toml").read_text()
    camera = "pixel_size_mm = 0.1\norigin_px = [20.0, 95.0]\nnoise_std_gv = 1.5\n"
    head, _, rest = text.partition("[camera]\n")
    rest = rest[rest.index("[material"):]
    head = head.replace("roi_px = [20, 15, 220, 95], element_px = 20", "roi_mm = [0, 0, 20, 8], element_mm = 2")
    (folder / "experiment.toml").write_text(
        f'{head}[[camera]]\nname = "first"\n{camera}[[camera]]\nname = "second"\nimages = "second/*.tif"\n'
        f"{camera}{rest}")
    warnings = warnings_of(folder)
    return right_if(("moment than first" in warnings) == bool(frames), warnings)


def broken(folder: Path, last: int = 8, rest: float = 0.0) -> tuple[str, str]:
    """The strip breaks in the middle; the frames after it are proposed for exclusion."""
    strain = np.where(np.arange(N) > last, 0.0, RAMP)
    force = np.where(np.arange(N) > last, rest, force_of(RAMP))
    write(folder, [f"f{k:02d}.tif" for k in range(N)],
          [image(e, k, gap_px=12.0 if k > last else 0.0) for k, e in enumerate(strain)],
          log_text(RAMP, force))
    warnings = warnings_of(folder)
    return right_if(json.dumps([f"f{k:02d}.tif" for k in range(last + 1, N)]) in warnings, warnings)


def recordings() -> Iterator[Input]:
    """All of them."""
    for name, names in NAMES.items():
        yield Input("order of frames", name, partial(ordered, names))
    yield Input("copies", "a film of a third of the rate", partial(copies, [k // 3 for k in range(18)]))
    yield Input("copies", "one image stored twice", partial(copies, [0, 1, 2, 3, 4, 5, 5, 7, 8, 9, 10, 11]))
    yield Input("copies", "two hang-ups", partial(copies, [0, 1, 1, 1, 4, 5, 6, 7, 8, 8, 10, 11]))
    yield Input("copies", "none", partial(copies, list(range(12))))
    for frames in (0.0, -0.7, 1.3, -3.0):
        yield Input("late camera", f"{frames:+.1f} frames", partial(late, frames))
    yield Input("sign and end", "force of another sign", partial(told, RAMP, "factor = -1", force=-force_of(RAMP)))
    yield Input("sign and end", "sound", partial(told, RAMP, "", absent="factor"))
    yield Input("sign and end", "compression", partial(told, -RAMP, "", absent="factor"))
    yield Input("sign and end", "broken, force 0 after it", broken)
    yield Input("sign and end", "broken in the last frame", partial(broken, last=10))
    yield Input("sign and end", "load cell fails", partial(told, RAMP, "load cell", force=np.where(
        np.arange(N) > 7, 0.0, force_of(RAMP))))
    yield Input("sign and end", "grip of another sign", partial(unit_of_grip, -1.0, word="sign of grip_mm"))
    yield Input("sign and end", "torn half through", partial(told, RAMP, "", absent="exclude_frames", force=np.where(
        np.arange(N) > 7, 0.6, 1.0) * force_of(RAMP)))
    yield Input("sign and end", "unloaded at the end", partial(told, np.append(RAMP[:-1], 0.0), "",
                                                               absent="exclude_frames"))
    yield Input("sign and end", "grip in another unit", partial(unit_of_grip, 1e3))


def unit_of_grip(factor: float, folder: Path, word: str = "unit of grip_mm") -> tuple[str, str]:
    """The log of the grip is so many times the motion."""
    rows = log_text(RAMP).splitlines()
    changed = [rows[0], *(",".join([*row.split(",")[:2], f"{factor * LENGTH_MM * e:.3f}"])
                          for row, e in zip(rows[1:], RAMP, strict=True))]
    write(folder, [f"f{k:02d}.tif" for k in range(N)], [image(e, k) for k, e in enumerate(RAMP)],
          "\n".join(changed) + "\n")
    warnings = warnings_of(folder)
    return right_if(word in warnings, warnings)
