"""Motion that the camera shows at rest (floor), on the specimen."""

from __future__ import annotations

from matplotlib.colors import Normalize

from idic.report.figures.maps import draw, grid, specimen_window
from idic.report.figures.picture import Picture
from idic.report.figures.style import look, to_picture
from idic.report.result.record import RunRecord


def camera_floor(record: RunRecord) -> Picture | None:
    """Motion that the camera shows in images at rest; None where it is not known, or lost in noise."""
    values = record.camera_floor_px
    if values is None or not values.any():
        return None
    floor, (scale, unit) = record.result["camera_floor"], record.motion_unit
    values = scale * values
    with look():
        figure, axes = grid(1, 1, specimen_window(record))
        drawn = draw(axes[0, 0], record, values, Normalize(0.0, float(values.max())))
        axes[0, 0].set_title(f"rms {scale * floor['px']:.2g} {unit}", fontsize=8.5)
        figure.colorbar(drawn, ax=axes, label=f"floor at rest [{unit}]", shrink=0.85, aspect=15, pad=0.01)
        caption = (
            f"Free motion (rms per component) in images at rest: {', '.join(floor['labels'])}. Rigid motion, image "
            "noise and the leading motions of the loaded specimen are removed. Its causes are light, air, focus or "
            "aliasing, in loaded frames too. A motion of this size is not attributed to a law."
        )
        return to_picture(figure, "camera_floor", "Motion in images at rest", caption, as_photo=True)
