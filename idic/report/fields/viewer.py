"""The numbers of the field viewer: nodal fields as 16-bit integers, mesh, reference image, gauges; drawn by
fields.js.j2.

The page holds displacement, deformation gradient, stress and state at the corner nodes of the elements. Strain of any
measure and axes follows from the deformation gradient in the browser.
"""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.colors import to_hex
from matplotlib.image import imsave

from idic.measure import FieldSeries, readings
from idic.report.figures.picture import JPEG_QUALITY
from idic.report.figures.style import DIVERGING, SEQUENTIAL
from idic.report.result.fit_words import against_free, in_words_of
from idic.report.result.record import RunRecord

MAX_VALUES = 1_200_000  # of all frames: 3 MB of the page
MIN_FRAMES = 3
MAX_IMAGE_PX = 900  # longer side of the reference image behind the fields
N_COLOURS = 33
_LARGEST = 32_000  # of the integers; below -_LARGEST: not known
_UNKNOWN = -32_768
_DEPTH = {"u_z": "displacement z, out of the plane", "z": "shape: z of the surface"}
_DIGITS = 7  # of the numbers of a gauge


def viewer_data(record: RunRecord) -> str:
    """The JSON text that the viewer reads; "" where the page shows no fields or they are too many for a page."""
    series = record.series
    if series is None or record.nodes_px is None or len(series.frames) < 2:
        return ""
    selected = _kept_frames(series)
    if selected is None:
        return ""
    corners = series.surface.corners
    nodes, places = series.surface.plane.nodes[corners], record.nodes_px[series.surface.index][corners]
    content = {
        "unit": series.unit, "stress_unit": series.stress_unit, "kind": series.kind, "time_label": record.time_label,
        "frames": [series.frames[k] for k in selected],
        "times": [_short(record.abscissa[series.frames[k]]) for k in selected],
        "labels": [_label(record, series.frames[k]) for k in selected],
        "nodes": _list(nodes), "nodes_px": _list(places, 5), "affine": _list(_affine(nodes, places), 8),
        "triangles": _triangles(series, corners).ravel().tolist(),
        "arrays": {name: _packed(values) for name, values in _arrays(series, selected, corners).items()},
        "states": [[name, name.replace("_", " ")] for name in series.states],
        "depth": [[name, _DEPTH[name]] for name in series.depth],
        "smoothed": None if series.smoothed is None else _short(series.smoothed),
        "failed": _failed(record),
        "floor": {name: _short(value) for name, value in series.floor.items()},
        "image": _image(record.reference) if record.value_unit == "grey values" else None,
        "gauges": _gauges(record, selected),
        "sequential": _colours(SEQUENTIAL), "diverging": _colours(DIVERGING),
    }
    return json.dumps(content, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def _failed(record: RunRecord) -> str:
    """That the free FE-DIC is no measurement; "" where it is one."""
    free_fit = against_free(record.result)
    return "" if free_fit is None or not free_fit.failed else in_words_of(
        record.result,
        f"a free FE-DIC did not find the motion (χ² = {free_fit.free_chi2:.3g}, model {free_fit.model_chi2:.3g}): its "
                       "field is no measurement")


def _kept_frames(series: FieldSeries) -> Sequence[int] | None:
    """Numbers of the frames that the page has room for, the first and the last among them; None: hardly any."""
    values = 8 + 8 * (series.measured is not None) + 3 * (series.stress is not None)
    values += len(series.states) + len(series.depth) + len(series.measured_depth)
    noise = 0 if series.noise is None else 6 * len(series.noise)
    noise += 0 if series.depth_noise is None else len(series.depth_noise)
    room = int((MAX_VALUES / max(len(series.surface.corners), 1) - noise) / values)
    n = len(series.frames)
    if room < min(MIN_FRAMES, n):
        return None
    return [int(k) for k in np.unique(np.linspace(0, n - 1, min(room, n)).round().astype(int))]


def _arrays(series: FieldSeries, selected: Sequence[int], corners: np.ndarray) -> dict[str, np.ndarray]:
    """Name -> (frames, corner nodes, components)"""
    def at(values: np.ndarray) -> np.ndarray:
        return values[selected][:, corners].reshape(len(selected), len(corners), -1)

    arrays = {"u": at(series.simulated), "F": at(series.F)}
    if series.measured is not None and series.F_measured is not None:
        arrays |= {"u_measured": at(series.measured), "F_measured": at(series.F_measured)}
        if series.noise is not None and series.F_noise is not None:
            arrays |= {"u_noise": series.noise[:, corners],
                      "F_noise": series.F_noise[:, corners].reshape(len(series.noise), len(corners), 4)}
    if series.stress is not None:
        arrays["stress"] = at(series.stress[:, :, [0, 1, 0], [0, 1, 1]])
    arrays |= {f"depth.{name}": at(values) for name, values in series.depth.items()}
    arrays |= {f"depth.{name}_measured": at(values) for name, values in series.measured_depth.items()}
    if series.depth_noise is not None:
        arrays["depth_noise"] = series.depth_noise[:, corners, None]
    return arrays | {f"state.{name}": at(values) for name, values in series.states.items()}


def _packed(values: np.ndarray) -> dict:
    """Each component over its own range in 16 bits, little-endian, base64."""
    is_finite = np.isfinite(values)
    flat = np.where(is_finite, values, 0.0)
    low = np.where(is_finite, values, np.inf).min(axis=(0, 1))
    high = np.where(is_finite, values, -np.inf).max(axis=(0, 1))
    low, high = np.where(np.isfinite(low), low, 0.0), np.where(np.isfinite(high), high, 0.0)
    middle, step = (low + high) / 2.0, np.maximum((high - low) / 2.0 / _LARGEST, 1e-300)
    integers = np.where(is_finite, np.rint((flat - middle) / step), _UNKNOWN).astype("<i2")
    return {"data": base64.b64encode(integers.tobytes()).decode("ascii"), "shape": list(values.shape),
            "middle": [float(f"{m:.12g}") for m in middle], "step": [float(f"{s:.12g}") for s in step]}


def _triangles(series: FieldSeries, corners: np.ndarray) -> np.ndarray:
    """Corner triangles of the elements, in numbers of the corner nodes  # (n, 3)"""
    place = np.full(series.surface.n_nodes, -1)
    place[corners] = np.arange(len(corners))
    parts = []
    for block in series.surface.plane.blocks:
        conn = place[block.connectivity]
        parts += [conn[:, [0, 1, 2]]] + ([conn[:, [0, 2, 3]]] if block.kind.n_corners == 4 else [])
    return np.concatenate(parts)


def _affine(nodes: np.ndarray, places: np.ndarray) -> np.ndarray:
    """px = A x + b of the mesh as the camera sees it, by least squares  # (2, 3)"""
    return np.linalg.lstsq(np.column_stack([nodes, np.ones(len(nodes))]), places, rcond=None)[0].T


def _image(image: np.ndarray | None) -> dict | None:
    """The reference image as a JPEG of moderate size, and how many of its pixels one of it stands for."""
    if image is None:
        return None
    times = -(-max(image.shape) // MAX_IMAGE_PX)
    rows, columns = (n // times * times for n in image.shape)
    small = np.asarray(image, dtype=float)[:rows, :columns].reshape(rows // times, times, columns // times, times)
    small = np.nanmean(small, axis=(1, 3))
    low, high = np.nanpercentile(small, (0.5, 99.5))
    buffer = io.BytesIO()
    imsave(buffer, np.nan_to_num(small, nan=low), format="jpeg", cmap="gray", vmin=low, vmax=max(high, low + 1e-12),
           pil_kwargs={"quality": JPEG_QUALITY, "optimize": True})
    return {"uri": "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode("ascii"), "times": times}


def _gauges(record: RunRecord, selected: Sequence[int]) -> list[dict]:
    """The declared gauges; all but lines with what they read, as in the tables."""
    gauges = []
    for gauge in record.gauges:
        reads = {}
        if gauge.kind != "line":
            for reading in readings(record.series, gauge):
                parts = (reading.simulated, reading.measured, reading.std)
                reads[reading.quantity] = [None if part is None else _list(part[selected]) for part in parts]
        gauges.append({"name": gauge.name, "kind": gauge.kind, "points": [list(point) for point in gauge.points_mm],
                      "radius": gauge.radius_mm, "samples": gauge.samples, "reads": reads})
    return gauges


def _label(record: RunRecord, frame: int) -> str:
    entries = record.result.get("frames", ())
    return str(entries[frame].get("label", "")) if frame < len(entries) else ""


def _colours(name: str) -> list[str]:
    colours = matplotlib.colormaps[name]
    return [to_hex(colours(k / (N_COLOURS - 1))) for k in range(N_COLOURS)]


def _list(values: np.ndarray, digits: int = _DIGITS) -> list:
    """Numbers of some digits in nested lists, None where not known."""
    if np.ndim(values) > 1:
        return [_list(row, digits) for row in values]
    return [float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in np.asarray(values, dtype=float)]


def _short(value: float) -> float:
    return float(f"{float(value):.{_DIGITS}g}")
