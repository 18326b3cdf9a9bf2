"""Stages as Ncorr saves them: a MATLAB file whose structure `data_dic_save` holds the displacements of every image.

    data_dic_save.dispinfo          spacing (px left out between points), pixtounits, units
    data_dic_save.displacements(k)  plot_u_dic, plot_v_dic (px on the grid of points, 0 or NaN outside the region)

Rows and v count downwards; a stage has them upwards. The first stage, the reference image, moves nowhere; Ncorr does not
save it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

from idic.errors import InputError
from idic.readers.fields.stage import KEY, Stage

SUFFIXES = (".mat",)
_HDF5 = b"MATLAB 7.3"
_EXPECTED = "a structure data_dic_save with displacements and dispinfo"
_PIXELS = ("", "pixel", "pixels", "px")


def read_ncorr(path: Path) -> dict[float | None, Stage]:
    """All stages of a file by their numbers; 0 is the reference image.

    Raises
    ------
    InputError
        The file is of MATLAB's version 7.3, damaged, or not one of Ncorr.
    """
    saved = _content(path)
    info = saved.dispinfo
    step, factor = float(info.spacing) + 1.0, float(info.pixtounits)
    unit = str(info.units).strip().lower()
    fields = [(np.asarray(one.plot_u_dic, float), np.asarray(one.plot_v_dic, float))
              for one in np.atleast_1d(saved.displacements)]
    shape = fields[0][0].shape
    if any(part.shape != shape or part.ndim != 2 for pair in fields for part in pair):
        raise _foreign(path, "displacements of one grid", ", ".join(str(u.shape) for u, _ in fields[:4]))
    seen = [np.isfinite(u) & np.isfinite(v) & ((u != 0.0) | (v != 0.0)) for u, v in fields]
    rows, columns = np.nonzero(np.logical_or.reduce(seen))
    points = factor * step * np.column_stack([columns, -rows]).astype(float)
    ids = (rows * shape[1] + columns).astype(np.int64)
    name = "px" if unit in _PIXELS else unit
    stages: dict[float | None, Stage] = {0.0: Stage(points, np.zeros_like(points), name, ids)}
    for k, ((u, v), there) in enumerate(zip(fields, seen, strict=True), 1):
        moved = factor * np.column_stack([u[rows, columns], -v[rows, columns]])
        stages[float(k)] = Stage(points, np.where(there[rows, columns][:, None], moved, np.nan), name, ids)
    return stages


def _content(path: Path) -> Any:
    if path.read_bytes()[:len(_HDF5)] == _HDF5:
        raise InputError("a MATLAB file of version 7.3", file=path, key=KEY, expected="a file of version 7 or 5",
                         found="version 7.3 (HDF5)",
                         remedy="in MATLAB: load it, then save('fields.mat', 'data_dic_save', '-v7')")
    try:
        saved = loadmat(path, squeeze_me=True, struct_as_record=False, variable_names=["data_dic_save"])["data_dic_save"]
        complete = all(hasattr(saved.dispinfo, name) for name in ("spacing", "pixtounits", "units")) and all(
            hasattr(one, name) for one in np.atleast_1d(saved.displacements) for name in ("plot_u_dic", "plot_v_dic"))
    except Exception as problem:  # noqa: BLE001  (a damaged file makes SciPy raise all kinds)
        raise _foreign(path, _EXPECTED, str(problem) or type(problem).__name__) from None
    if not complete or not len(np.atleast_1d(saved.displacements)):
        raise _foreign(path, _EXPECTED, "a part of it is missing")
    return saved


def _foreign(path: Path, expected: str, found: str) -> InputError:
    return InputError("not a readable file of Ncorr", file=path, key=KEY, expected=expected, found=found,
                      remedy="save it again in Ncorr (File > Save Data), or export a table")
