"""The picture of a calibration: residuals on the image, rms per image, and the poses of the target."""

from __future__ import annotations

import numpy as np
from matplotlib.ticker import MaxNLocator

from idic.calibrate import Calibration
from idic.report.figures.picture import CYCLE, Colour, Picture
from idic.report.figures.style import look, new_figure, to_picture

ARROW_SHARE = 0.08  # of the image width: the length of an arrow of three standard deviations


def calibration_picture(result: Calibration) -> Picture:
    """One row of maps per camera with coverage and residuals, then the rms per image, then the poses from the side."""
    n = len(result.rig.cameras)
    with look():
        figure = new_figure(4.6 * n if n > 1 else 7.0, 7.4)
        axes = figure.subplot_mosaic([[f"map{c}" for c in range(n)], ["rms"] * n, ["poses"] * n],
                                     height_ratios=[2.2, 1.0, 1.3])
        for c in range(n):
            _residuals(axes[f"map{c}"], result, c)
        _rms(axes["rms"], result)
        _poses(axes["poses"], result)
        return to_picture(figure, "calibration", "Calibration",
                          "Residuals seen minus projected; rms per image; target seen along y of camera 0.")


def _residuals(axis, result, camera):
    width, height = result.rig.image_size_px[camera]
    pairs = [(row[camera].points_px, errors[camera])
             for row, errors in zip(result.views, result.residuals_px, strict=True)
             if row[camera] is not None]
    points, errors = np.vstack([p for p, _ in pairs]), np.vstack([e for _, e in pairs])
    scale = ARROW_SHARE * width / max(3.0 * result.noise_px, 1e-12)
    axis.quiver(points[:, 0], points[:, 1], errors[:, 0], errors[:, 1], angles="xy", scale_units="xy",
                scale=1.0 / scale,
                color=CYCLE[camera], width=0.002)
    axis.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal", xlabel="column (px)",
             ylabel="row (px)")
    axis.set_title(f"camera {camera}: residuals × {scale:.0f}, rms {np.sqrt((errors**2).sum(axis=1).mean()):.3f} px;\n"
                   f"points span {result.coverage(camera):.0%} of the image")


def _rms(axis, result):
    n = len(result.rig.cameras)
    for c in range(n):
        values = [np.nan if errors[c] is None else np.sqrt((errors[c] ** 2).sum(axis=1).mean())
                  for errors in result.residuals_px]
        axis.bar(np.arange(len(values)) + (c - (n - 1) / 2) * 0.8 / n, values, 0.8 / n, color=CYCLE[c],
                 label=f"camera {c}")
    axis.axhline(result.rms_px, color=Colour.GREY, lw=0.8)
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    axis.set(xlabel="image", ylabel="rms (px)",
             title=f"Reprojection error per image; line: all, {result.rms_px:.3f} px")
    if n > 1:
        axis.legend(ncols=2)


def _poses(axis, result):
    """Target and cameras from above: the line of sight z of camera 0 to the right, its x downwards."""
    corners = result.points_mm.min(axis=0), result.points_mm.max(axis=0)
    middle = 0.5 * (corners[0][1] + corners[1][1])
    line = np.array([[corners[0][0], middle, 0.0], [corners[1][0], middle, 0.0]])
    for pose in result.poses:
        if pose is not None:
            ends = line @ pose.rotation.T + pose.translation_mm
            axis.plot(ends[:, 2], ends[:, 0], color=Colour.GREY, lw=0.9)
    for c, camera in enumerate(result.rig.cameras):
        centre, sight = camera.centre_mm, camera.rotation[2]
        reach = 0.2 * np.nanmean([np.linalg.norm(p.translation_mm) for p in result.poses if p is not None])
        axis.plot(*zip(centre[[2, 0]], (centre + reach * sight)[[2, 0]], strict=True), color=CYCLE[c], lw=1.2)
        axis.plot(*centre[[2, 0]], "o", color=CYCLE[c], label=f"camera {c}")
    axis.invert_yaxis()
    axis.set(xlabel="z of camera 0 (mm)", ylabel="x (mm)", aspect="equal",
             title=f"Poses of the target, tilted by {np.nanmin(result.tilts_deg):.0f} to "
                   f"{np.nanmax(result.tilts_deg):.0f}°")
    axis.grid(color=Colour.FAINT)
    axis.legend(loc="best")
