"""The identified model compared with a free FE-DIC: displacements from the images alone, on the same mesh."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import Normalize

from idic.report.figures import maps
from idic.report.figures.profiles import is_profile
from idic.report.figures.picture import Picture
from idic.report.figures.style import DIVERGING, SEQUENTIAL, look, show_pixels, to_picture
from idic.report.free_section import free_motion
from idic.report.result.record import RunRecord


def free_dic(record: RunRecord) -> Picture | None:
    """Residual of the model, residual of the free FE-DIC, distance between their displacements, for some frames."""
    if is_profile(record):
        return free_motion(record)
    free_fit, data = record.free_fields, record.residuals
    if free_fit is None or data is None or not free_fit.frames or free_fit.frames != data.frames:
        return None
    units = maps.noise_units(record)
    scale = np.ones(len(free_fit.frames)) if units is None else units
    name = record.value_unit if units is None else "σ"
    reach = maps.RESIDUAL_RANGE if units is not None else float(np.nanpercentile(np.abs(data.identified), 99))
    motion, motion_name = record.motion_unit
    distance = motion * np.hypot(free_fit.difference_px[..., 0], free_fit.difference_px[..., 1])
    used = maps.used_nodes(record)
    largest = float(np.nanpercentile(distance[:, used], 99)) if np.isfinite(distance[:, used]).any() else 1.0
    window = maps.residual_window(data.identified)
    with look():
        figure, axes = maps.grid(3, len(free_fit.frames), window)
        for column, frame in enumerate(free_fit.frames):
            for row, stack in enumerate((data.identified, free_fit.residuals)):
                image = show_pixels(axes[row, column], stack[column] / scale[column], window, cmap=DIVERGING,
                                    interpolation="nearest", norm=Normalize(-reach, reach))
                maps.bare(axes[row, column], window)
                rms = np.sqrt(np.nanmean((stack[column] / scale[column]) ** 2))
                head = (f"frame {frame},  ",) if row == 0 else ()
                maps.entitle(axes[row, column], *head, f"rms {rms:.2f} {name}")
            drawn = maps.draw(axes[2, column], record, distance[column], Normalize(0.0, largest or 1.0), SEQUENTIAL)
            maps.bare(axes[2, column], window)
            distances = distance[column, used]
            maps.entitle(axes[2, column], "rms ", f"{np.sqrt(np.nanmean(distances**2)):.3f} {motion_name}")
        for row, text in enumerate(("identified", "free FE-DIC" if motion_name == "px" else "free fit", "distance")):
            axes[row, 0].set_ylabel(text)
        figure.colorbar(image, ax=axes[:2], label=f"residual / {name}" if units is not None else f"residual [{name}]",
                        shrink=0.8, aspect=25, pad=0.01, extend="both")
        figure.colorbar(drawn, ax=axes[2], label=f"[{motion_name}]", shrink=0.85, aspect=12, pad=0.01, extend="max")
        return to_picture(figure, "free_dic", "Identified model and free FE-DIC", _caption(record), as_photo=True)


def _caption(record: RunRecord) -> str:
    free_fit, floor = record.free_fields, None if record.practice is None else record.practice.floor.free_px
    frames = {entry["frame"]: entry for entry in record.result.get("frames", ()) if entry.get("chi2_dof") is not None}
    pairs = [f"frame {k}: {frames[k]['chi2_dof']:.3f} and {chi2:.3f}"
             for k, chi2 in zip(free_fit.frames, free_fit.chi2_dof, strict=True) if k in frames]
    text = ("The free FE-DIC finds displacements on the same mesh without law and force, starting from the simulated "
            "ones. No law can reduce its residual. Where the distance exceeds the noise, the model moves differently "
            "from the specimen.")
    if floor is not None:
        scale, name = record.motion_unit
        text += f" Noise alone gives a distance of {np.sqrt(2.0) * scale * floor:.2g} {name}."
    return text + (f" χ² per pixel, identified and free: {'; '.join(pairs)}." if pairs else "")
