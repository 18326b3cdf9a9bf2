"""Meshes of tetrahedra: read from every format with their faces, raised to quadratic ones, seen and identified."""

import sys
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest

sys.path[:0] = [str(Path(__file__).parents[1] / part) for part in ("fe", "twins")]

from fe_bodies import faces_where, grid, where  # noqa: E402
from solid_bar import CELLS, SIZE, side_and_front  # noqa: E402

from idic.fe import cell_type, face_area, inp_text, make_mesh, raise_order  # noqa: E402
from idic.identification import identify  # noqa: E402
from idic.readers import read_mesh_file  # noqa: E402

FORMATS = {".inp": {}, ".vtu": {}, ".msh": {"file_format": "gmsh22", "binary": False}}


def block(cell, n=(2, 1, 1), lengths=(2.0, 1.0, 1.5)):
    """A box with its upper face as a set of faces."""
    mesh = grid(cell, n, lengths)
    return replace(mesh, edge_sets={"FRONT": faces_where(mesh, lambda x, y, z: np.abs(z - lengths[2]) < 1e-9)},
                   node_sets={"LEFT": where(mesh, lambda x, *_: x < 1e-9)}, element_sets={"BODY": np.arange(
                       mesh.n_elements)})


def written(mesh, path):
    """The mesh in a file; formats without surfaces get the faces as cells of their own."""
    if path.suffix == ".inp":
        path.write_text(inp_text(mesh, "block"))
        return path
    solid, flat = {"tet4": ("tetra", "triangle"), "tet10": ("tetra10", "triangle6")}[mesh.blocks[0].cell]
    faces = np.array([mesh.face_nodes(f) for f in mesh.edge_sets["FRONT"]])
    marks = [np.zeros(mesh.n_elements, int), np.ones(len(faces), int)]
    data = {"gmsh:physical": marks, "gmsh:geometrical": marks} if path.suffix == ".msh" else {"FRONT": marks}
    names = {"FRONT": np.array([1, 2])} if path.suffix == ".msh" else {}
    meshio.Mesh(mesh.nodes, [(solid, mesh.blocks[0].connectivity), (flat, faces)], cell_data=data,
                field_data=names).write(path, **FORMATS[path.suffix])
    return path


def volume(mesh):
    xi, w = mesh.blocks[0].kind.quadrature_rule()
    jac = np.einsum("eak,qai->eqki", mesh.nodes[mesh.blocks[0].connectivity], mesh.blocks[0].kind.shape_gradients(xi))
    return np.sum(np.linalg.det(jac) * w)


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("cell", ["tet4", "tet10"])
def test_tetrahedra_and_their_faces_are_read_from_every_format(cell, suffix, tmp_path):
    mesh, _ = read_mesh_file(written(block(cell), tmp_path / f"block{suffix}")).to_mesh(3, 1.0)
    mesh.check_elements()  # middles of edges in another order would turn elements inside out
    assert mesh.blocks[0].cell == cell and mesh.n_elements == 12
    assert volume(mesh) == pytest.approx(3.0)
    assert face_area(mesh, mesh.edge_sets["FRONT"]) == pytest.approx(2.0)
    middles = mesh.nodes[mesh.blocks[0].connectivity[:, 4:]]
    for k, (a, b) in enumerate(cell_type("tet4").edges[:middles.shape[1]]):
        ends = mesh.nodes[mesh.blocks[0].connectivity[:, [a, b]]]
        np.testing.assert_allclose(middles[:, k], ends.mean(axis=1))
    (seen,) = mesh.surface_cells("FRONT")
    assert seen.cell == {"tet4": "tri3", "tet10": "tri6"}[cell] and seen.n_elements == 4


def test_middles_of_edges_are_those_of_the_numbering_that_gmsh_documents(tmp_path):
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    edges = [(0, 1), (1, 2), (2, 0), (3, 0), (2, 3), (1, 3)]  # gmsh manual, node ordering, Tetrahedron10
    nodes = np.vstack([corners, [corners[list(edge)].mean(axis=0) for edge in edges]])
    (tmp_path / "one.msh").write_text("\n".join([
        "$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", "10",
        *(f"{k} {x} {y} {z}" for k, (x, y, z) in enumerate(nodes, 1)), "$EndNodes", "$Elements", "1",
        "1 11 2 1 1 1 2 3 4 5 6 7 8 9 10", "$EndElements", ""]))
    mesh, _ = read_mesh_file(tmp_path / "one.msh").to_mesh(3, 1.0)
    np.testing.assert_allclose(mesh.nodes[mesh.blocks[0].connectivity[0]], cell_type("tet10").reference_nodes)


def test_linear_tetrahedra_become_quadratic_with_their_sets():
    linear, quadratic = block("tet4", (2, 2, 2)), block("tet10", (2, 2, 2))
    assert linear.can_raise_order
    raised = raise_order(linear)
    raised.check_elements()
    assert raised.n_nodes == quadratic.n_nodes
    assert volume(raised) == pytest.approx(volume(linear))
    assert face_area(raised, raised.edge_sets["FRONT"]) == pytest.approx(2.0)
    np.testing.assert_array_equal(np.unique(raised.nodes[raised.node_sets["LEFT"]], axis=0),
                                  np.unique(quadratic.nodes[quadratic.node_sets["LEFT"]], axis=0))


def test_a_solid_seen_from_the_front_is_identified_with_tetrahedra():
    """Images of the bar as hexahedra move it; the ratio of contraction to what its mesh of 1152 differs in."""
    body, _ = side_and_front()
    mesh = grid("tet10", CELLS, SIZE)
    sets = {"LEFT": where(mesh, lambda x, *_: x < 1e-9), "RIGHT": where(mesh, lambda x, *_: x > SIZE[0] - 1e-9)}
    front = faces_where(mesh, lambda x, y, z: z > SIZE[2] - 1e-9)
    mesh = make_mesh(mesh.nodes, [("tet10", mesh.blocks[0].connectivity)], node_sets=sets,
                     element_sets={"BODY": np.arange(mesh.n_elements)}, edge_sets={"FRONT": front})
    start = body.model.parameters.with_values({"BODY.nu": 0.2})
    found = identify(replace(body, model=replace(body.model, mesh=mesh, parameters=start), cameras=())).result
    assert found["status"] == "converged"
    assert found["parameters"]["BODY.nu"]["value"] == pytest.approx(0.3, abs=0.01)
