"""The command on cameras before a test: `calibrate`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from idic.cli.app import app, terminal, wide_console
from idic.cli.command import user_path
from idic.cli.outcomes import outcome
from idic.errors import InputError

STAGES = ("finding the target in the images", "bundle adjustment", "file and picture")

if TYPE_CHECKING:
    from rich.table import Table

    from idic.run import CalibrationRun


@app.command()
def calibrate(
    images: Annotated[list[Path], typer.Argument(
        metavar="IMAGES...", help="One folder per camera, or image files; names ending in _0 and _1 form a pair.",
        show_default=False)],
    spacing: Annotated[float, typer.Option(metavar="MM", help="Distance of neighbouring corners or dots.")],
    grid: Annotated[str | None, typer.Option(
        metavar="NxM", help="Inner corners of the chessboard, or dots; a dot grid with markers needs none.")] = None,
    target: Annotated[str, typer.Option(help="auto | chessboard | dots")] = "auto",
    intrinsics: Annotated[str, typer.Option(
        "--free", help="Intrinsic values to identify, of fx,fy,skew,cx,cy,k1,k2,k3,p1,p2; without fy: square "
             "pixels.")] = "fx,fy,cx,cy,k1,k2",
    target_std: Annotated[float | None, typer.Option(
        min=0, metavar="MM", show_default="a bend is identified",
        help="Standard deviation of every point of the target from its place: 0 flat and exact; above 0 every point is "
             "identified.")] = None,
    out: Annotated[Path,
                   typer.Option(metavar="FILE",
                                help="Calibration file (JSON); a picture is written next to it.")] = Path(
        "calibration.json"),
) -> None:
    """Calibrate one camera or a pair from images of a dot grid or chessboard."""
    with outcome():
        from idic.calibrate import Lens
        from idic.run import run_calibration

        from idic.cli.progress import progress_view

        with progress_view(terminal(stderr=True), out.parent, STAGES) as view:
            run = run_calibration(images, out, spacing, target, _grid(grid), Lens(_names(intrinsics)), target_std,
                                  view.stage, view.tasks)
        console = wide_console()
        console.print(calibration_table(run))
        for line in closing_lines(run):
            typer.echo(line)
        typer.echo(f"written      {user_path(out)}\npicture      {user_path(out.with_suffix('.png'))}")


def calibration_table(run: CalibrationRun) -> Table:
    """Value ± standard deviation of every camera's free parameters and of the relative pose."""
    from rich.table import Table

    from idic.images import PinholeCamera
    from idic.report import number_with_std

    rig = run.result.rig
    table = Table(box=None, header_style="bold")
    table.add_column("parameter", no_wrap=True)
    for head in [f"{text}" for c in range(len(rig.cameras)) for text in (f"camera {c}", "± std")]:
        table.add_column(head, justify="right", no_wrap=True)
    table.add_column("unit")
    stds: tuple = rig.std or ()
    for name, unit in PinholeCamera.units.items():
        if not any(f"{c}.{name}" in rig.names for c in range(len(rig.cameras))):
            continue
        cells = []
        for c, camera in enumerate(rig.cameras):
            value = _shown(camera)[name] if f"{c}.{name}" in rig.names else None
            cells += ["-", "-"] if value is None else [*number_with_std(value, stds[c].of(name))]
        table.add_row(name, *cells, unit)
    return table


def closing_lines(run: CalibrationRun) -> list[str]:
    """Reprojection error, images without a target, and the notes."""
    result = run.result
    n_points = sum(view.n for row in result.views for view in row if view is not None)
    n_images = sum(pose is not None for pose in result.poses)
    lines = [f"reprojection {result.rms_px:.4f} px rms over {n_points} points of {n_images} "
             f"{'pairs' if len(run.labels) == 2 else 'images'}; {result.noise_px:.4f} px std per coordinate"]
    if run.without_target:
        lines.append(f"no target    in {len(run.without_target)}: {', '.join(run.without_target[:8])}"
                     + (" …" if len(run.without_target) > 8 else ""))
    return lines + [f"note         {note}" for note in result.notes]


def _shown(camera) -> Mapping[str, float]:
    """Values with the pose as angles about x, y, z (R = Rz Ry Rx), as other systems print them."""
    from math import atan2, degrees, hypot

    r = camera.rotation
    return camera.values() | {"rotation_x": degrees(atan2(r[2, 1], r[2, 2])),
                              "rotation_y": degrees(atan2(-r[2, 0], hypot(r[0, 0], r[1, 0]))),
                              "rotation_z": degrees(atan2(r[1, 0], r[0, 0]))}


def _grid(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    match = re.fullmatch(r"\s*(\d{1,4})\s*[xX×,]\s*(\d{1,4})\s*", text)
    if not match or min(int(match[1]), int(match[2])) < 3:
        raise InputError("not a grid", key="--grid", expected="COLUMNSxROWS, at least 3x3, e.g. 11x7", found=text[:80],
                         remedy="count inner corners (one fewer than squares), or dots")
    return int(match[1]), int(match[2])


def _names(text: str) -> tuple[str, ...]:
    from idic.images import PinholeCamera

    names = tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    wrong = [name for name in names if name not in PinholeCamera.intrinsics]
    if wrong or "fx" not in names:
        raise InputError("not intrinsic values of a camera", key="--free",
                         expected=f"fx and any of {', '.join(PinholeCamera.intrinsics)}",
                         found=text, remedy="name them with commas between")
    return tuple(name for name in PinholeCamera.intrinsics if name in names)
