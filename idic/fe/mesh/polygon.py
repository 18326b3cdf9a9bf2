"""A mesh of a drawn region: outline and holes of straight lines and arcs, triangles or mostly quadrilaterals.

The nodes of the boundary lie on its lines and arcs. Same drawing, same mesh: nothing is random.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from idic.errors import InputError
from idic.fe.mesh.mesh import Mesh, make_mesh
from idic.fe.mesh.outline import Boundary, Segments, cut
from idic.fe.mesh.recombine import recombined, smoothed
from idic.fe.mesh.region import check_crossings, graded_boundary
from idic.fe.mesh.triangulate import triangulate

MAX_NODES = 2_000_000
Filling = tuple[np.ndarray, np.ndarray, np.ndarray]  # nodes, the boundary points first; quads (n, 4); triangles (m, 3)
Mesher = Callable[[Segments, Boundary, float, bool], tuple[Filling, Boundary]]


def fill(segments: Segments, boundary: Boundary, size: float, quads: bool) -> tuple[Filling, Boundary]:
    """The mesher of idic: see `triangulate` and `recombined`."""
    nodes, triangles, boundary = triangulate(segments, boundary, size, square=quads)
    four, three = recombined(nodes, triangles) if quads else (np.zeros((0, 4), dtype=np.int64), triangles)
    return (smoothed(nodes, four, three, len(boundary.points)), four, three), boundary


def mesh_polygon(outline: Sequence, holes: Sequence = (), size: float = 1.0, *, quads: bool = False,
                 names: Mapping[str, Sequence[int]] | None = None, mesher: Mesher = fill) -> Mesh:
    """A mesh of the region inside `outline` and outside of `holes`, with linear elements (`raise_order` makes them
    quadratic).

    Parameters
    ----------
    outline : (n, 2) array, or sequence of entries
        ``[x, y]``: a straight line to this point; ``[xm, ym, x, y]``: an arc through (xm, ym). Not closed by a last
        point that repeats the first one. ``[xc, yc, r]`` is a circle. Any unit, any sense of rotation.
    holes : sequence of the same
    size : float
        Edge length of an element, in the unit of the outline. Edges are shorter at details that are smaller.
    quads : bool
        Quadrilaterals, aligned with x and y, and triangles where none fits; else triangles.
    names : {name: numbers of segments}
        Further sets; segment k runs from point k to point k + 1 of the outline, counted from 1.
    mesher : function
        Fills the region; see `fill`.

    Returns
    -------
    Mesh
        quad4 and tri3 (``mesh.nodes`` (n, 2), ``mesh.blocks``). Edge and node sets: OUTER; EDGE1, EDGE2, … of the
        outline (not of a circle); HOLE1, HOLE2, …; `names`. Element set ALL.

    Raises
    ------
    InputError
        Lines that cross, holes outside, a name without a segment, an element size that does not suit the region.
    """
    segments = Segments.of(outline, holes)
    _check_size(segments, size)
    boundary = graded_boundary(segments, size)
    (nodes, four, three), boundary = mesher(segments, boundary, size, quads)
    used = np.unique(np.concatenate([four.ravel(), three.ravel()]))
    cells = [(cell, np.searchsorted(used, c)) for cell, c in (("quad4", four), ("tri3", three)) if len(c)]
    mesh = make_mesh(nodes[used], cells)
    return _with_sets(mesh, segments, replace(boundary, edges=np.searchsorted(used, boundary.edges)), names or {})


def _check_size(segments: Segments, size: float) -> None:
    area = segments.area()
    suits = area > 0 and 0 < size <= np.sqrt(area) and area / size**2 <= MAX_NODES
    if suits:
        return
    check_crossings(cut(segments, np.inf), segments)  # the area of an outline that crosses itself is no reason
    if area <= 0:
        raise InputError("the outline encloses nothing", expected="an outline larger than its holes",
                         found=f"area {area:g}",
                         remedy="correct the outline or the holes")
    raise InputError("the element size does not suit the drawing",
                     expected=f"{np.sqrt(area / MAX_NODES):.3g} to {np.sqrt(area):.3g}", found=f"{size:g}",
                     remedy="choose another element size")


def _with_sets(mesh: Mesh, segments: Segments, boundary: Boundary, names: Mapping[str, Sequence[int]]) -> Mesh:
    faces = mesh.boundary_faces()
    face_numbers = {tuple(sorted(mesh.face_nodes(face)[:2].tolist())): k for k, face in enumerate(faces)}
    places = [face_numbers.get(tuple(sorted(edge))) for edge in boundary.edges.tolist()]
    if None in places or len(places) != len(faces):
        raise InputError("the outline cannot be meshed", expected="elements that fill the region",
                         found="gaps at its boundary",
                         remedy="choose another element size")
    segment = np.empty(len(faces), dtype=int)
    segment[places] = boundary.segment
    loop, n = segments.loop[segment], int((segments.loop == 0).sum())
    of = {"OUTER": loop == 0}
    if n > 1:
        of |= {f"EDGE{k + 1}": segment == k for k in range(n)}
    of |= {f"HOLE{k}": loop == k for k in range(1, int(segments.loop.max()) + 1)}
    for name, numbers in names.items():
        wrong = [k for k in numbers if not 1 <= k <= n]
        if wrong or not len(numbers) or name in of or name == "ALL":
            raise InputError("not a name of edges", key=name, expected=f"a new name, and segments from 1 to {n}",
                             found=f"{name} = {list(numbers)}", remedy="correct the numbers, or choose another name")
        of[name] = np.isin(segment, np.asarray(numbers) - 1)
    edge_sets = {name: faces[mask] for name, mask in of.items()}
    return replace(mesh, edge_sets=edge_sets,
                   node_sets={name: mesh.face_set_nodes(set_faces) for name, set_faces in edge_sets.items()},
                   element_sets={"ALL": np.arange(mesh.n_elements)})
