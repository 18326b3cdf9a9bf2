"""gmsh as the mesher of a drawn region, where it is installed: it keeps the boundary edges and fills the inside.

gmsh (https://gmsh.info, Geuzaine and Remacle 2009, doi 10.1002/nme.2579) is under the GPL and needs libraries of a
desktop; idic does not depend on it. `pip install idic[mesh]`
"""

from __future__ import annotations

import threading

import numpy as np

from idic.errors import InputError
from idic.fe import Boundary, Filling, Segments

FRONTAL, FRONTAL_QUADS, BLOSSOM = 6, 8, 1  # numbers of gmsh's algorithms
_LOCK = threading.Lock()  # gmsh has one model per process


def has_gmsh() -> bool:
    """Whether gmsh can be imported here."""
    try:
        import gmsh  # noqa: F401
    except (ImportError, OSError):  # OSError: a library of the desktop is missing
        return False
    return True


def fill_with_gmsh(segments: Segments, boundary: Boundary, size: float, quads: bool) -> tuple[Filling, Boundary]:
    """As `idic.fe.mesh.polygon.fill`, by gmsh.

    Raises
    ------
    InputError
        gmsh is not installed, or it does not mesh the region.
    """
    if not has_gmsh():
        raise InputError("gmsh is not installed", expected="the package gmsh and its libraries", found="no gmsh",
                         remedy='pip install "idic[mesh]", or leave out mesher = "gmsh"')
    import gmsh

    with _LOCK:
        gmsh.initialize(["-noenv"], interruptible=False)  # no settings from files of the user
        try:
            gmsh.option.setNumber("General.Terminal", 0)
            _model(gmsh, segments, boundary, size, quads)
            gmsh.model.mesh.generate(2)
            filling = _result(gmsh, boundary)
        except Exception as problem:  # noqa: BLE001  gmsh raises nothing more special
            raise InputError("gmsh does not mesh the drawing", expected="a region that gmsh meshes", found=str(problem),
                             remedy='leave out mesher = "gmsh"') from None
        finally:
            gmsh.finalize()
    return filling, boundary


def _model(gmsh, segments: Segments, boundary: Boundary, size: float, quads: bool) -> None:
    geo = gmsh.model.geo
    for k, ((x, y), point_size) in enumerate(zip(boundary.points, _sizes(boundary, size), strict=True), 1):
        geo.addPoint(float(x), float(y), 0.0, float(point_size), k)
    for k, (a, b) in enumerate(boundary.edges.tolist(), 1):
        geo.addLine(a + 1, b + 1, k)
        geo.mesh.setTransfiniteCurve(k, 2)
    loops = segments.loop[boundary.segment]
    for k in range(int(loops.max()) + 1):
        geo.addCurveLoop((np.flatnonzero(loops == k) + 1).tolist(), k + 1, reorient=True)
    geo.addPlaneSurface(list(range(1, int(loops.max()) + 2)), 1)
    geo.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.option.setNumber("Mesh.MaxNumThreads2D", 1)
    gmsh.option.setNumber("Mesh.Algorithm", FRONTAL_QUADS if quads else FRONTAL)
    if quads:
        gmsh.option.setNumber("Mesh.RecombinationAlgorithm", BLOSSOM)
        gmsh.model.mesh.setRecombine(2, 1)


def _sizes(boundary: Boundary, size: float) -> np.ndarray:
    """The shortest edge at every boundary point  # (n,)"""
    sizes = np.full(len(boundary.points), float(size))
    for ends in boundary.edges.T:
        np.minimum.at(sizes, ends, boundary.lengths)
    return sizes


def _result(gmsh, boundary: Boundary) -> Filling:
    """Nodes with the boundary points first, quads, triangles; counter-clockwise."""
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    order = np.argsort(tags)  # the points come first: they were made first
    nodes = coordinates.reshape(-1, 3)[order, :2]
    if len(nodes) < len(boundary.points) or not np.allclose(nodes[: len(boundary.points)], boundary.points, rtol=1e-9):
        raise ValueError("the boundary points were moved")
    cells = {4: np.zeros((0, 4), dtype=np.int64), 3: np.zeros((0, 3), dtype=np.int64)}
    kinds, _, connectivities = gmsh.model.mesh.getElements(2)
    for kind, connectivity in zip(kinds, connectivities, strict=True):
        corners = {2: 3, 3: 4}[int(kind)]
        corner_numbers = np.searchsorted(tags[order], connectivity.reshape(-1, corners)).astype(np.int64)
        x, y = np.moveaxis(nodes[corner_numbers], -1, 0)
        clockwise = (x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1) < 0
        corner_numbers[clockwise] = corner_numbers[clockwise][:, ::-1]
        cells[corners] = corner_numbers
    return nodes, cells[4], cells[3]
