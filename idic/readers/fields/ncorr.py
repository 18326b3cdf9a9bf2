"""Stages as Ncorr saves them: a MATLAB file whose structure `data_dic_save` holds the displacements of every image.

    data_dic_save.dispinfo          type, spacing (px left out between points), pixtounits, units, imgcorr (steps)
    data_dic_save.displacements(k)  plot_u_ref_formatted, …  against the reference image, in `units`: after Format
    Displacements
                                    plot_u_dic, …            px, against the reference of its step; 0 outside the region

Rows and v count downwards; a stage has them upwards. The first stage, the reference image, moves nowhere; Ncorr does
not save it. Ncorr writes version 7.3 (HDF5), where arrays are transposed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from idic.errors import InputError
from idic.readers.containers.references import is_hdf5, refuse_references
from idic.readers.fields.stages.failed_points import MAX_LENGTH, OUTSIDE
from idic.readers.fields.stages.stage import KEY, Stage

if TYPE_CHECKING:
    import h5py  # loaded where such a file is read

SUFFIXES = (".mat",)
_EXPECTED = "a structure data_dic_save with displacements and dispinfo"
_PIXELS = ("", "pixel", "pixels", "px")
_REGULAR = "regular"


@dataclass(frozen=True, eq=False)
class _Saved:
    """What is read of a file. fields : (u, v) of every image in `unit`; scale : unit per px"""

    step_px: float
    scale: float
    unit: str
    fields: list[tuple[np.ndarray, np.ndarray]]


def read_ncorr(path: Path) -> dict[float | None, Stage]:
    """All stages of a file by their numbers; 0 is the reference image.

    Raises
    ------
    InputError
        The file is damaged, not one of Ncorr, or its displacements are not against the reference image.
    """
    saved = _content(path)
    fields, shape = saved.fields, saved.fields[0][0].shape
    if any(part.shape != shape or part.ndim != 2 for pair in fields for part in pair):
        raise _foreign(path, "displacements of one grid", ", ".join(str(u.shape) for u, _ in fields[:4]))
    measured = [np.isfinite(u) & np.isfinite(v) & ((u != 0.0) | (v != 0.0)) for u, v in fields]
    rows, columns = np.nonzero(np.logical_or.reduce(measured))
    points = saved.scale * saved.step_px * np.column_stack([columns, -rows]).astype(float)
    ids = (rows * shape[1] + columns).astype(np.int64)
    stages: dict[float | None, Stage] = {0.0: Stage(points, np.zeros_like(points), saved.unit, ids)}
    for k, ((u, v), is_measured) in enumerate(zip(fields, measured, strict=True), 1):
        moved = np.column_stack([u[rows, columns], -v[rows, columns]])
        is_shown = is_measured[rows, columns]
        n_lost = int((~is_shown).sum())
        stages[float(k)] = Stage(points, np.where(is_shown[:, None], moved, np.nan), saved.unit, ids,
                                 failed={OUTSIDE: n_lost} if n_lost else {})
    return stages


def _content(path: Path) -> _Saved:
    refuse_references(path, KEY)
    try:
        info, displacements = _of_hdf5(path) if is_hdf5(path) else _of_mat(path)
        formatted = [_pair(image, "ref_formatted") for image in displacements]
        raw = [_pair(image, "dic") for image in displacements]
        step, scale = float(np.ravel(info["spacing"])[0]) + 1.0, info.get("pixtounits")
        scale = np.ravel([] if scale is None else scale)
    except Exception as problem:  # noqa: BLE001  (a damaged file makes SciPy and h5py raise all kinds)
        raise _foreign(path, _EXPECTED, str(problem) or type(problem).__name__) from None
    if not 0.0 < step < MAX_LENGTH or not all(0.0 < value < MAX_LENGTH for value in scale):
        raise _foreign(path, "a spacing and a scale above 0", f"{step - 1.0:g}, {', '.join(f'{s:g}' for s in scale)}")
    if not displacements:
        raise _foreign(path, _EXPECTED, "no image")
    unit = str(info.get("units") or "").strip().lower()
    factor, name = (float(scale[0]), "px" if unit in _PIXELS else unit) if len(scale) else (1.0, "px")
    if all(pair is not None for pair in formatted):
        return _Saved(step, factor, name, formatted)
    steps = np.size(info.get("imgcorr", 0))
    if str(info.get("type") or _REGULAR) != _REGULAR or steps > 1 or any(pair is None for pair in raw):
        raise InputError("displacements that are not against the reference image", file=path, key=KEY,
                         expected="formatted displacements",
                         found=f"{info.get('type')} analysis in {steps} steps, not formatted",
                         remedy="in Ncorr: Analysis > Format Displacements, then save again")
    return _Saved(step, factor, name, [(factor * u, factor * v) for u, v in raw])


def _pair(image: dict[str, Any], kind: str) -> tuple[np.ndarray, np.ndarray] | None:
    """u and v of an image; None where they are missing or empty."""
    components = [np.asarray(image[name], float) for name in (f"plot_u_{kind}", f"plot_v_{kind}")
                  if image.get(name) is not None]
    return (components[0], components[1]) if len(components) == 2 and all(part.size for part in components) else None


def _of_mat(path: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """dispinfo and displacements of a file of version 5 or 7."""
    content = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False, variable_names=["data_dic_save"])
    saved = content["data_dic_save"]
    return vars(saved.dispinfo), [vars(image) for image in np.atleast_1d(saved.displacements)]


def _of_hdf5(path: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The same of version 7.3: a structure is a group, an array of structures a group of arrays of references."""
    import h5py

    with h5py.File(path, "r") as file:
        saved = file["data_dic_save"]
        info = {name: _value(saved["dispinfo"][name]) for name in ("type", "spacing", "pixtounits", "units")
                if name in saved["dispinfo"]}
        if "imgcorr" in saved["dispinfo"]:
            info["imgcorr"] = np.zeros(max((len(_parts(file, node)) for node in saved["dispinfo"]["imgcorr"].values()),
                                           default=1))
        columns = {name: [_value(part) for part in _parts(file, node)] for name, node in saved["displacements"].items()
                   if name in ("plot_u_dic", "plot_v_dic", "plot_u_ref_formatted", "plot_v_ref_formatted")}
    n = max((len(column) for column in columns.values()), default=0)
    return info, [{name: column[k] for name, column in columns.items()} for k in range(n)]


def _parts(file: h5py.File, node: h5py.Dataset) -> Sequence[h5py.Dataset]:
    """The values of a field of an array of structures; of one structure it is the value itself."""
    import h5py

    return [file[reference] for reference in np.ravel(node[()])] if node.dtype == h5py.ref_dtype else [node]


def _value(node: h5py.Dataset) -> Any:
    """A matrix, a text, or None for an empty one."""
    if node.attrs.get("MATLAB_empty", 0):
        return None
    values = np.asarray(node[()])
    text = node.attrs.get("MATLAB_class", b"") == b"char"
    return "".join(map(chr, values.ravel())) if text else values.T


def _foreign(path: Path, expected: str, finding: str) -> InputError:
    return InputError("not a readable file of Ncorr", file=path, key=KEY, expected=expected, found=finding,
                      remedy="save it again in Ncorr (File > Save Data), or export a table")
