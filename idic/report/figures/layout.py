"""Constrained layout that measures once what stands around its axes."""

from __future__ import annotations

from collections.abc import Callable

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.transforms import Bbox


class MeasuredOnce(ConstrainedLayoutEngine):
    """Matplotlib measures all letters twice, as ticks may change when axes do; here only where they have changed."""

    def execute(self, fig: Figure) -> None:
        """Lay out the figure."""
        axes = list(fig.axes)
        for axis in axes:
            axis.get_tightbbox = _remembered(axis)  # type: ignore[method-assign]
        try:
            super().execute(fig)
        finally:
            for axis in axes:
                del axis.get_tightbbox


def _remembered(axes: Axes) -> Callable:
    """`axes.get_tightbbox` that knows its margins while the labels of the ticks are the same."""
    measure, extents = axes.get_tightbbox, {}

    def tightbbox(renderer, **options) -> Bbox | None:
        locator = axes.get_axes_locator()
        axes.apply_aspect(locator(axes, renderer) if locator else None)
        labels = _tick_labels(axes)
        if labels not in extents:
            box = measure(renderer, **options)
            if box is None:
                return None
            extents[labels] = box.extents - axes.bbox.extents
        return Bbox.from_extents(axes.bbox.extents + extents[labels])

    return tightbbox


def _tick_labels(axes: Axes) -> tuple[str, ...]:
    """Of all that stands at the axes: major and minor labels, and their power of ten."""
    labels: list[str] = []
    for axis in (axes.xaxis, axes.yaxis):
        for formatter, places in ((axis.get_minor_formatter(), axis.get_minorticklocs()),
                                  (axis.get_major_formatter(), axis.get_majorticklocs())):
            labels += [*formatter.format_ticks(places), formatter.get_offset()]
    return tuple(labels)
