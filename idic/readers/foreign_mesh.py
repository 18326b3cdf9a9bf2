"""Reads a mesh file by meshio with a time limit: some of its readers wait for ever for the rest of a damaged file."""

from __future__ import annotations

import contextlib
import ctypes
import io
import threading
import warnings
from pathlib import Path

import meshio
import numpy as np

from idic.errors import InputError
from idic.readers.containers.references import refuse_references

SECONDS, SECONDS_PER_BYTE = 10.0, 5e-6  # the slowest readers take 1 µs per byte; small files 0.02 s
_LZ4, _HEAD_BYTES = b"vtkLZ4DataCompressor", 1000  # in the first line of a VTU file
_AFTER_THE_STOP_S = 1.0  # until the reader notices that it is to end


def read_by_meshio(path: Path) -> meshio.Mesh:
    """The mesh of a file with the suffix of a format of meshio.

    Raises
    ------
    InputError
        meshio does not know what the file holds, the file is cut off, or endless.
    """
    if path.suffix.lower() == ".vtu" and _LZ4 in path.read_bytes()[:_HEAD_BYTES]:
        raise InputError("a compression that idic does not read", file=path, key="mesh",
                         expected="data without compression, or with zlib or LZMA", found="LZ4",
                         remedy="save the file with zlib, the default of VTK and ParaView")
    refuse_references(path, "mesh")
    attempt, quiet = _Attempt(path), io.StringIO()
    with contextlib.redirect_stdout(quiet), contextlib.redirect_stderr(quiet), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the error below reports the fault once
        attempt.start()
        attempt.join(SECONDS + SECONDS_PER_BYTE * path.stat().st_size)
        if attempt.is_alive():
            attempt.stop()
    if attempt.mesh is None:
        raise InputError("the mesh cannot be read", file=path, key="mesh", expected=f"a {path.suffix} file",
                         found=f"{attempt.reason}{' '.join(quiet.getvalue().split()) if attempt.exited else ''}",
                         remedy=attempt.remedy) from None
    return attempt.mesh


class _Attempt(threading.Thread):
    """The reading; afterwards `mesh`, or None and the `reason`."""

    def __init__(self, path: Path):
        super().__init__(daemon=True)
        self.path, self.mesh, self.exited = path, None, False
        self.reason = "a file whose end is not found"
        self.remedy = ("export the mesh as .inp, .msh or .vtu: meshio, which reads this format, does not know what the "
                       "file holds, or it is incomplete")

    def run(self) -> None:
        try:
            mesh = _series(self.path) or meshio.read(self.path)
            check_indices(mesh)
        except _Stopped:
            return
        except (Exception, SystemExit) as error:  # noqa: BLE001  (meshio raises all kinds, and exits)
            self.exited = isinstance(error, SystemExit)
            self.reason = f"{type(error).__name__}: {'' if self.exited else error}"
            if isinstance(error, ModuleNotFoundError):  # of HDF5 and netCDF
                self.remedy = f"install {error.name} (pip install {error.name}), or export the mesh as .vtu"
            return
        self.mesh = mesh

    def stop(self) -> None:
        """End the reading: an exception in its thread."""
        ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(self.ident), ctypes.py_object(_Stopped))
        self.join(_AFTER_THE_STOP_S)


def _series(path: Path) -> meshio.Mesh | None:
    """The mesh of an XDMF file with a series of results on it; None where the file holds none."""
    if path.suffix.lower() not in (".xdmf", ".xmf") or b'"Temporal"' not in path.read_bytes().replace(b"'", b'"'):
        return None
    with meshio.xdmf.TimeSeriesReader(path) as reader:
        points, cells = reader.read_points_cells()
    return meshio.Mesh(points, cells)


class _Stopped(BaseException):
    """The time of a reading is over."""


def check_indices(mesh: meshio.Mesh) -> None:
    """ValueError unless all cells and sets refer to nodes and cells of the file."""
    if not mesh.cells or np.ndim(mesh.points) != 2 or not 1 <= mesh.points.shape[1] <= 3:
        raise ValueError("the file holds no nodes or no elements")
    references = [(f"{block.type} elements", block.data, len(mesh.points)) for block in mesh.cells]
    references += [(f"node set {name}", ids, len(mesh.points)) for name, ids in mesh.point_sets.items()]
    for name, parts in mesh.cell_sets.items():
        references += [(f"element set {name}", ids, len(block.data))
                       for ids, block in zip(parts, mesh.cells, strict=True)
                       if ids is not None and not name.startswith("gmsh:")]  # those are numbers of entities
    for subject, numbers, n in references:
        indices = np.asarray(numbers)
        if indices.size and not (np.issubdtype(indices.dtype, np.integer) and indices.min() >= 0 and indices.max() < n):
            raise ValueError(f"{subject} refer to numbers beyond the {n} that the file holds")
