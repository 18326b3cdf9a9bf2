"""Bricks with mid-side nodes: files of CalculiX and gmsh, sets of faces, bricks of a file raised on request."""

from __future__ import annotations

import meshio
import numpy as np
import pytest

from experiment_file.small_experiment import change, load_experiment, write_experiment
from fe.fe_bodies import grid
from idic.errors import InputError
from idic.fe import ABAQUS_TYPES, CELL_TYPES, raise_order
from idic.fe.mesh.element import HEX_EDGES
from idic.readers import read_mesh_file


def inp(mesh):
    """A file with the elements in two lines each, as every program writes them, and a *SURFACE on the side z = 1."""
    block = mesh.blocks[0]
    lines = ["*NODE", *(f"{k + 1}, " + ", ".join(f"{x:.9g}" for x in at) for k, at in enumerate(mesh.nodes)),
             "*ELEMENT, TYPE=C3D20R, ELSET=BODY"]
    for k, nodes in enumerate(block.connectivity + 1):
        words = [str(k + 1), *map(str, nodes)]
        lines += [", ".join(words[:15]) + ",", ", ".join(words[15:])]
    top = [(e, f) for e, f in mesh.boundary_faces() if np.allclose(mesh.nodes[mesh.face_nodes((e, f)), 2], 1.0)]
    return "\n".join([*lines, "*SURFACE, NAME=FRONT, TYPE=ELEMENT", *(f"{e + 1}, S{f + 1}" for e, f in top), ""])


@pytest.mark.parametrize("suffix", ["inp", "msh", "vtu"])
def test_a_file_of_quadratic_bricks_is_read(suffix, tmp_path):
    mesh = grid("hex20", (2, 1, 1))
    file = tmp_path / f"mesh.{suffix}"
    if suffix == "inp":
        file.write_text(inp(mesh))
    else:
        meshio.Mesh(mesh.nodes,
                    [("hexahedron20", mesh.blocks[0].connectivity)]).write(file, "gmsh" if suffix == "msh" else "vtu")
    found, _ = read_mesh_file(file).to_mesh(3, 1.0)
    assert found.blocks[0].cell == "hex20" and found.n_elements == 2
    assert np.allclose(found.nodes[found.blocks[0].connectivity], mesh.nodes[mesh.blocks[0].connectivity])


def test_the_camera_sees_the_eight_nodes_of_each_face(tmp_path):
    (tmp_path / "mesh.inp").write_text(inp(grid("hex20", (2, 1, 1))))
    mesh, _ = read_mesh_file(tmp_path / "mesh.inp").to_mesh(3, 1.0)
    (block,) = mesh.surface_cells("FRONT")
    assert block.cell == "quad8" and block.connectivity.shape == (2, 8)
    at = mesh.nodes[block.connectivity]
    assert np.allclose(at[:, :, 2], 1.0)
    assert np.allclose(at[:, 4:], 0.5 * (at[:, :4] + at[:, [1, 2, 3, 0]]))


def test_linear_bricks_are_raised_only_where_it_is_asked_for():
    linear, straight = grid("hex8", (2, 2, 1)), grid("hex20", (2, 2, 1))
    assert linear.can_raise_order and not linear.is_raised_by_default
    raised = raise_order(linear)
    places = lambda mesh: {tuple(np.round(x, 9)) for x in mesh.nodes}  # noqa: E731
    assert places(raised) == places(straight) and raised.blocks[0].cell == "hex20"
    for nodes in raised.blocks[0].connectivity:
        middle = [raised.nodes[nodes[list(edge)]].mean(axis=0) for edge in HEX_EDGES]
        assert np.allclose(raised.nodes[nodes[8:]], middle)


def test_wedges_are_refused_with_the_kinds_that_there_are(tmp_path):
    folder = write_experiment(tmp_path / "test")
    meshio.Mesh(np.eye(6, 3), [("wedge", [[0, 1, 2, 3, 4, 5]])]).write(folder / "mesh.vtu")
    change(folder, "experiment.toml", 'mesh = "mesh.inp"', 'mesh = "mesh.vtu"')
    change(folder, "experiment.toml", 'kind = "plane_stress"', 'kind = "solid"\nsurface = "FRONT"')
    with pytest.raises(InputError, match="hex20"):
        load_experiment(folder)


def test_every_cell_has_its_name_for_abaqus_and_for_paraview():
    from idic.run.reporting.paraview import VTK_NAMES

    bodies = {name for name, cell in CELL_TYPES.items() if cell.dim > 1}
    assert bodies == set(ABAQUS_TYPES) == set(VTK_NAMES)


@pytest.mark.parametrize("kind", ["CPS8", "M3D9"])
def test_quadrilaterals_with_a_node_in_the_middle_are_read_without_it(tmp_path, kind):
    places = [(0, 0), (2, 0), (2, 1), (0, 1), (1, 0), (2, 0.5), (1, 1), (0, 0.5), (1, 0.5)]
    n = 9 if kind == "M3D9" else 8
    (tmp_path / "a.inp").write_text("*NODE\n" + "".join(f"{k}, {x}, {y}\n" for k, (x, y) in enumerate(places[:n], 1))
                                    + f"*ELEMENT, TYPE={kind}, ELSET=BODY\n1, {', '.join(map(str, range(1, n + 1)))}\n")
    mesh, notes = read_mesh_file(tmp_path / "a.inp").to_mesh(2, 1.0)
    np.testing.assert_array_equal(mesh.nodes, places[:8])
    assert any("quad9" in note for note in notes) == (n == 9)
