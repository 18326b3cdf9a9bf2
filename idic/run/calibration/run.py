"""From images of a target to cameras with deviations, a file and a picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from idic.calibrate import Calibration, Lens, MIN_VIEWS, calibrate
from idic.errors import InputError
from idic.inside import write_inside
from idic.readers import KINDS, find_target, kind_of, write_rig
from idic.report import calibration_picture
from idic.run.calibration.images import camera_stacks

PROBES = 3  # images that tell the kind of the target


@dataclass(frozen=True, eq=False)
class CalibrationRun:
    """A finished calibration with what was read.

    Attributes
    ----------
    result : Calibration
    kind : "chessboard" | "dots"
    labels : per camera the names of the images
    without_target : tuple of str
        Names of the images in which no target was found.
    """

    result: Calibration
    kind: str
    labels: tuple[tuple[str, ...], ...]
    without_target: tuple[str, ...]


def run_calibration(arguments: list[Path], out: Path, spacing_mm: float, kind: str = "auto",
                    grid: tuple[int, int] | None = None,
                    lens: Lens | None = None, target_std_mm: float | None = None,
                    stage: Callable[[str], None] = lambda text: None,
                    tasks: Callable[[str, int, int], None] = lambda label, count, total: None) -> CalibrationRun:
    """Find the target in every image, calibrate, write ``out`` (JSON) and a picture of the same name (PNG).

    Parameters
    ----------
    arguments : paths
        See `idic.run.calibration.images.camera_stacks`.
    out : path
        The calibration file; nothing is written where something fails.
    spacing_mm : float
        Distance of neighbouring corners or dots.
    stage, tasks : callable
        Take the name of every step that begins, and (label, count, total) while images are searched.

    Raises
    ------
    InputError
        Bad images, no target, too few views.
    NotConverged
        The adjustment does not settle.
    """
    if not spacing_mm > 0:
        raise InputError("not a spacing", key="--spacing", expected="mm between neighbouring points, > 0",
                         found=spacing_mm,
                         remedy="measure it over the whole target and divide")
    if kind not in ("auto", *KINDS):
        raise InputError("no such target", key="--target", expected="auto, " + ", ".join(KINDS), found=kind,
                         remedy="use one of these words")
    if not out.parent.is_dir():
        raise InputError("no such folder", file=out.parent, key="--out", expected="an existing folder",
                         found="nothing there",
                         remedy="make the folder, or choose another path")
    stacks = camera_stacks(arguments)
    n_images = stacks[0].n_frames
    if n_images < MIN_VIEWS:
        raise InputError("too few images", key="IMAGES", expected=f"at least {MIN_VIEWS}, better 15 to 30",
                         found=n_images,
                         remedy="record the target at different tilts and places")
    stated_kind = kind
    if kind == "auto":
        kind = kind_of((stack.frame(k) for k in range(min(PROBES, n_images)) for stack in stacks), grid)
    if kind == "chessboard" and grid is None:
        raise InputError("a chessboard needs its grid", key="--grid", expected="COLUMNSxROWS of inner corners",
                         found="none",
                         remedy="count the corners where four squares meet, e.g. --grid 11x7")
    views, without = [], []
    stage("finding the target in the images")
    for k in range(n_images):
        tasks("images", k, n_images)
        row = tuple(find_target(stack.frame(k), kind, grid) for stack in stacks)
        without += [stack.labels[k] if len(stacks) == 1 else f"camera {c}: {stack.labels[k]}"
                    for c, (stack, target) in enumerate(zip(stacks, row, strict=True)) if target is None]
        views.append(row)
    if all(target is None for row in views for target in row):
        size = f" with {grid[0]} x {grid[1]} {'inner corners' if kind == 'chessboard' else 'points'}" if grid else ""
        raise InputError("no target in any image", key="IMAGES", found="none",
                         remedy="check --target and --grid (inner corners, "
                         "one fewer than squares); without hollow dots the target must be seen whole",
                         expected={"dots": "a dot grid",
                                   "auto": "a chessboard or dot grid"}.get(stated_kind, "a chessboard") + size)
    stage("bundle adjustment")
    sizes = tuple((stack.shape[1], stack.shape[0]) for stack in stacks)
    result = calibrate(tuple(views), sizes, spacing_mm, lens, target_std_mm)
    stage("file and picture")
    about = {"written_by": "idic calibrate", "target": kind, "spacing_mm": spacing_mm, "n_views": len(views),
             "rms_px": result.rms_px, "noise_px": result.noise_px}
    picture = calibration_picture(result)
    write_rig(out, result.rig, about)
    write_inside(out.parent, out.with_suffix(".png").name, picture.png)
    return CalibrationRun(result, kind, tuple(stack.labels for stack in stacks), tuple(without))
