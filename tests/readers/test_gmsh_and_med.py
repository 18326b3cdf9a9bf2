"""Files of gmsh and Salome: groups of every sign and name, parametric nodes, elements that are turned or fold over."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from idic.errors import InputError
from idic.fe import cell_type
from idic.readers import read_mesh_file

HEAD = "$MeshFormat\n{} 0 8\n$EndMeshFormat\n"
POINTS = ((0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1))
NAMES = '$PhysicalNames\n4\n1 1 "LEFT"\n1 2 "END"\n2 3 "SHEET"\n2 4 "END"\n$EndPhysicalNames\n'


def msh4(second=(2, 3, 6, 5), left_tag=1, n_parametric=0, first_groups="1 3"):
    """Two squares, each a surface: the second is in both groups 3 and 4; curve 1 is LEFT, curve 2 END."""
    entities = (f"$Entities\n0 2 2 0\n1 0 0 0 0 1 0 1 {left_tag} 0\n2 2 0 0 2 1 0 1 2 0\n"
                f"1 0 0 0 1 1 0 {first_groups} 0\n2 1 0 0 2 1 0 2 3 4 0\n$EndEntities\n")
    tail = " 0.5 0.5" if n_parametric else ""
    nodes = (f"$Nodes\n1 6 1 6\n2 1 {n_parametric} 6\n" + "".join(f"{k}\n" for k in range(1, 7))
             + "".join(f"{x} {y} 0{tail}\n" for x, y in POINTS) + "$EndNodes\n")
    elements = ("$Elements\n4 4 1 4\n1 1 1 1\n1 1 4\n1 2 1 1\n2 3 6\n2 1 3 1\n3 1 2 5 4\n2 2 3 1\n"
                f"4 {' '.join(map(str, second))}\n$EndElements\n")
    return HEAD.format("4.1") + NAMES + entities + nodes + elements


def read(tmp_path, text, n_dim=2, name="mesh.msh"):
    (tmp_path / name).write_text(text)
    mesh, notes = read_mesh_file(tmp_path / name).to_mesh(n_dim, 1.0)
    mesh.check_elements()
    return mesh, notes


@pytest.mark.parametrize("change", [{}, {"left_tag": -1}, {"n_parametric": 1}])
def test_groups_of_every_sign_keep_their_names(tmp_path, change):
    mesh, notes = read(tmp_path, msh4(**change))
    assert {name: ids.tolist() for name, ids in mesh.element_sets.items()} == {"SHEET": [0, 1], "END": [1]}
    assert mesh.node_sets["LEFT"].tolist() == [0, 3] and mesh.edge_sets["END"].tolist() == [[1, 1]] and not notes


@pytest.mark.parametrize("groups", ["1 {}", "0"])  # written with the part, or of the entity alone that was parted
def test_the_parts_of_a_partitioned_mesh_are_one_mesh_with_its_groups(tmp_path, groups):
    """As gmsh 4.15 writes it: entity, parent, partitions, box, groups, what bounds it."""
    parts = ("$PartitionedEntities\n2\n0\n0 2 2 0\n"
             f"11 1 1 1 1 0 0 0 0 1 0 {groups.format(1)} 0\n12 1 2 1 2 2 0 0 2 1 0 {groups.format(2)} 2 5 -6\n"
             f"21 2 1 1 1 0 0 0 1 1 0 {groups.format(3)} 0\n22 2 2 2 2 1 1 0 0 2 1 0 {groups.format('3')} 0\n"
             "$EndPartitionedEntities\n")
    text = msh4().replace("$Nodes", parts + "$Nodes", 1)
    for old, new in (("1 1 1 1\n1 1 4", "1 11 1 1\n1 1 4"), ("1 2 1 1\n2 3 6", "1 12 1 1\n2 3 6"),
                     ("2 1 3 1\n3 1", "2 21 3 1\n3 1"), ("2 2 3 1\n4", "2 22 3 1\n4")):
        assert old in text
        text = text.replace(old, new)
    mesh, notes = read(tmp_path, text)
    assert mesh.n_elements == 2 and mesh.element_sets["SHEET"].tolist() == [0, 1] and mesh.n_nodes == 6
    assert mesh.node_sets["LEFT"].tolist() == [0, 3] and mesh.edge_sets["END"].tolist() == [[1, 1]]


def test_entities_without_a_group_are_read(tmp_path):
    mesh, _ = read(tmp_path, msh4(first_groups="0"))
    assert mesh.n_elements == 2 and mesh.element_sets["SHEET"].tolist() == [1]


def test_elements_of_two_groups_in_version_2_are_one(tmp_path):
    nodes = "$Nodes\n6\n" + "".join(f"{k} {x} {y} 0\n" for k, (x, y) in enumerate(POINTS, 1)) + "$EndNodes\n"
    rows = ["1 1 2 1 1 1 4", "2 1 2 2 2 3 6", "3 3 2 3 1 1 2 5 4", "4 3 2 3 2 2 3 6 5", "5 3 2 4 2 2 3 6 5"]
    text = HEAD.format("2.2") + NAMES + nodes
    mesh, _ = read(tmp_path, text + f"$Elements\n{len(rows)}\n" + "\n".join(rows) + "\n$EndElements\n")
    assert mesh.element_labels.tolist() == [3, 4]
    assert {name: ids.tolist() for name, ids in mesh.element_sets.items()} == {"SHEET": [0, 1], "END": [1]}
    rows[-1] = "5 3 2 3 2 2 3 6 5"  # twice in one group
    with pytest.raises(InputError, match="two elements on the same nodes"):
        read(tmp_path, text + f"$Elements\n{len(rows)}\n" + "\n".join(rows) + "\n$EndElements\n")


def test_names_of_empty_groups_are_told(tmp_path):
    _, notes = read(tmp_path, msh4(left_tag=2))
    assert len(notes) == 1 and "no element is in the groups LEFT" in notes[0]


@pytest.mark.parametrize("text, message", [
    (msh4().replace("$EndElements\n", ""), "cannot be read"), (msh4().replace("1 6 1 6", "1 7 1 7"), None),
    (msh4().replace("2 1 0 6", "2 1 0 60"), "cannot be read"), (msh4(second=(2, 3, 66, 5)), "cannot be read"),
    (msh4().replace("2 2 3 1\n4", "2 2 99 1\n4"), "a type that idic does not know"),
    (msh4().replace("$Entities", "$PartitionedEntities\n2\n$EndPartitionedEntities\n$Entities"), "cannot be read")])
def test_an_incomplete_file_is_refused(tmp_path, text, message):
    if message is None:  # a wrong total alone does not matter: the blocks state their own numbers
        assert read(tmp_path, text)[0].n_nodes == 6
        return
    with pytest.raises(InputError, match=message):
        read(tmp_path, text)


def test_a_surface_that_is_numbered_the_other_way_round_is_turned(tmp_path):
    mesh, notes = read(tmp_path, msh4(second=(2, 5, 6, 3)))
    assert mesh.blocks[0].connectivity[1].tolist() == [1, 2, 5, 4]
    assert len(notes) == 1 and "1 of 2 elements are numbered clockwise" in notes[0]
    assert mesh.edge_sets["END"].tolist() == [[1, 1]]


def test_a_mesh_that_folds_over_itself_is_refused(tmp_path):
    """The shared nodes 2 and 5 moved beyond the right edge: the second element is clockwise by its place alone."""
    text = msh4().replace("1 0 0\n2 0 0", "3 0 0\n2 0 0").replace("1 1 0\n2 1 0\n$EndNodes", "3 1 0\n2 1 0\n$EndNodes")
    with pytest.raises(InputError, match="folds over itself") as caught:
        read(tmp_path, text)
    assert "elements 3 and 4" in caught.value.found


def med(path, blocks, points, families=(), node_families=None):
    """A MED file as MEDCoupling lays it out: {type: cells}, families [(kind, number, groups)]."""
    with h5py.File(path, "w") as file:
        mesh = file.create_group("ENS_MAA/specimen")
        mesh.attrs["ESP"] = points.shape[1]
        step = mesh.create_group("-0000000000000000001-0000000000000000001")
        coordinates = step.create_dataset("NOE/COO", data=points.ravel(order="F"))
        coordinates.attrs["NBR"] = len(points)
        if node_families is not None:
            step["NOE/FAM"] = node_families
        for name, (cells, numbers) in blocks.items():
            rows = step.create_dataset(f"MAI/{name}/NOD", data=(1 + cells).ravel(order="F"))
            rows.attrs["NBR"] = len(cells)
            step[f"MAI/{name}/FAM"] = numbers
        file.create_group("FAS/specimen/FAMILLE_ZERO").attrs["NUM"] = 0
        for kind, number, groups in families:
            family = file.create_group(f"FAS/specimen/{kind}/F{number}")
            family.attrs["NUM"] = number
            if groups:
                family.create_dataset("GRO/NOM", data=np.array([[ord(c) for c in f"{name:\0<80}"] for name in groups],
                                                               dtype=np.int8))


@pytest.mark.parametrize("kind, name", [("hex8", "HE8"), ("hex20", "H20"), ("tet4", "TE4"), ("tet10", "T10")])
def test_solids_of_med_are_turned_with_their_mid_side_nodes(tmp_path, kind, name):
    """MED numbers solids left-handed: the first face is seen counter-clockwise from inside."""
    cell = cell_type(kind)
    edges = cell_type(kind).edges
    mirrored = cell.reference_nodes[:cell.n_corners] * (1.0, 1.0, -1.0)
    middles = [mirrored[list(edge)].mean(axis=0) for edge in edges] if cell.n_nodes > cell.n_corners else []
    points = np.vstack([mirrored, *middles]) if middles else mirrored
    med(tmp_path / "mesh.med", {name: (np.arange(cell.n_nodes)[None], np.array([-1]))}, points,
        [("ELEME", -1, ["BODY"])])
    mesh, notes = read_mesh_file(tmp_path / "mesh.med").to_mesh(3, 1.0)
    mesh.check_elements()
    nodes = mesh.nodes[mesh.blocks[0].connectivity[0]]
    if middles:
        centres = [nodes[list(edge)].mean(axis=0) for edge in edges]
        np.testing.assert_allclose(nodes[cell.n_corners:], centres, atol=1e-15)
    assert "left-handed" in notes[0] and mesh.element_sets["BODY"].tolist() == [0]


def test_families_without_a_group_do_no_harm(tmp_path):
    cells = np.array([[0, 1, 4, 3], [1, 2, 5, 4]])
    families = [("ELEME", -1, []), ("ELEME", -2, ["SOFT", "ALL"]), ("ELEME", -3, ["EDGE"]), ("NOEUD", 4, ["LEFT"])]
    med(tmp_path / "mesh.med", {"QU4": (cells, np.array([-1, -2])), "SE2": (np.array([[2, 5]]), np.array([-3]))},
        np.array(POINTS, float), families, np.array([4, 0, 0, 4, 0, 0]))
    mesh, _ = read_mesh_file(tmp_path / "mesh.med").to_mesh(2, 1.0)
    assert {name: ids.tolist() for name, ids in mesh.element_sets.items()} == {"SOFT": [1], "ALL": [1]}
    assert mesh.node_sets["LEFT"].tolist() == [0, 3]
    assert mesh.face_set_nodes(mesh.edge_sets["EDGE"]).tolist() == [2, 5]


@pytest.mark.parametrize("content", [b"", b"no HDF5", b"\x89HDF\r\n\x1a\n" + b"\0" * 100])
def test_a_file_that_is_no_med_file_is_refused(tmp_path, content):
    (tmp_path / "mesh.med").write_bytes(content)
    with pytest.raises(InputError, match="cannot be read"):
        read_mesh_file(tmp_path / "mesh.med")
