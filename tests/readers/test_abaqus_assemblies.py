"""Abaqus and CalculiX decks as their programs mean them: shells, instances, local systems, included files, names."""

from __future__ import annotations

import numpy as np
import pytest

from idic.errors import InputError
from idic.fe import inp_text
from idic.readers import read_mesh_file

NODES = "*NODE\n1,0,0\n2,1,0\n3,1,1\n4,0,1\n"
SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
EDGES = {0: {1, 2}, 1: {2, 3}, 2: {3, 4}, 3: {4, 1}}
PART = ("*PART, NAME=GRIP\n*NODE\n1,0,0\n2,1,0\n3,1,1\n4,0,1\n*ELEMENT, TYPE=CPS4, ELSET=ALLE\n1, 1,2,3,4\n"
        "*NSET, NSET=END\n1, 4\n*SURFACE, NAME=TIP\n1, S2\n*END PART\n")


def read(tmp_path, text, n_dim=2, **files):
    for name, content in files.items():
        (tmp_path / f"{name}.txt").write_text(content)
    (tmp_path / "mesh.inp").write_text(text)
    raw = read_mesh_file(tmp_path / "mesh.inp")
    mesh, notes = raw.to_mesh(n_dim, 1.0)
    mesh.check_elements()
    return mesh, notes


def edge(mesh, name):
    return [set(mesh.node_labels[mesh.face_nodes(face)].tolist()) for face in mesh.edge_sets[name]]


@pytest.mark.parametrize("element", ["S4", "S4R", "M3D4", "M3D4R"])
@pytest.mark.parametrize("face, place", [("S3", 0), ("S4", 1), ("S5", 2), ("S6", 3), ("E1", 0), ("E2", 1), ("E4", 3)])
def test_edges_of_a_sheet_follow_its_two_sides(tmp_path, element, face, place):
    """CalculiX 2.20, *SURFACE: of shells faces 1 and 2 are the sides, 3 to 6 the edges; Abaqus calls these E1 to E4."""
    mesh, _ = read(tmp_path, f"{NODES}*ELEMENT,TYPE={element},ELSET=E\n7,1,2,3,4\n*SURFACE,NAME=F\nE,{face}\n")
    assert edge(mesh, "F") == [EDGES[place]]


@pytest.mark.parametrize("element, face, corners", [("CPS4", "S3", {3, 4}), ("CPE4R", "S4", {4, 1}),
                                                    ("CAX4", "S1", {1, 2})])
def test_edges_of_a_plane_element_count_from_1(tmp_path, element, face, corners):
    mesh, _ = read(tmp_path, f"{NODES}*ELEMENT,TYPE={element}\n7,1,2,3,4\n*SURFACE,NAME=F\n7,{face}\n")
    assert edge(mesh, "F") == [corners]


@pytest.mark.parametrize("element, face", [("S4", "S1"), ("S4", "S2"), ("S4", "SPOS"), ("M3D4", "SNEG"), ("CPS4", "N")])
def test_a_side_of_the_sheet_is_no_edge(tmp_path, element, face):
    mesh, _ = read(tmp_path, f"{NODES}*ELEMENT,TYPE={element}\n7,1,2,3,4\n*SURFACE,NAME=F\n7,{face}\n")
    assert "F" not in mesh.edge_sets


@pytest.mark.parametrize("element, face", [("S4", "S7"), ("S3", "S6"), ("CPS4", "S5"), ("CPS4", "X1")])
def test_an_edge_that_the_element_lacks_is_refused_with_its_line(tmp_path, element, face):
    row = "7,1,2,3" + ("" if element == "S3" else ",4")
    with pytest.raises(InputError, match=r"line 9: surface F: a \w+ has no such face"):
        read(tmp_path, f"{NODES}*ELEMENT,TYPE={element}\n{row}\n*SURFACE,NAME=F\n7,{face}\n")


@pytest.mark.parametrize("element", ["CPS4", "S4", "M3D4R"])
def test_what_idic_writes_for_a_type_comes_back(tmp_path, element):
    mesh, _ = read(tmp_path, f"{NODES}*ELEMENT,TYPE=CPS4\n7,1,2,3,4\n*SURFACE,NAME=A\n7,S1\n*SURFACE,NAME=B\n7,S4\n")
    text = inp_text(mesh, "again", {"quad4": element})
    again, _ = read(tmp_path, text)
    assert edge(again, "A") == [{1, 2}] and edge(again, "B") == [{4, 1}]
    assert ("S6" in text) == (element != "CPS4")


def test_names_ignore_case(tmp_path):
    sets = "*nset,nset=Left\n1\n*NSET,NSET=LEFT\n4\n*Elset,elset=a\n7\n*SURFACE,NAME=F\nA,S1\n"
    mesh, _ = read(tmp_path, f"{NODES}*ELEMENT,TYPE=CPS4\n7,1,2,3,4\n{sets}")
    assert list(mesh.node_sets) == ["Left"] and mesh.node_sets["Left"].tolist() == [0, 3] and len(edge(mesh, "F")) == 1


def test_names_in_quotation_marks_may_hold_commas(tmp_path):
    sets = '*NSET,NSET="left, lower"\n1\n*NSET,NSET=B\n"left, lower",2\n'
    mesh, _ = read(tmp_path, f"{NODES}*ELEMENT,TYPE=CPS4\n7,1,2,3,4\n{sets}")
    assert mesh.node_sets["left, lower"].tolist() == [0] and mesh.node_sets["B"].tolist() == [0, 1]


@pytest.mark.parametrize("number, value", [("1.425043-118", 1.425043e-118), ("0.1-100", 1e-101), ("1.5+1", 15.0),
                                           ("1.5D0", 1.5), (".15e1", 1.5), ("1.5Q0", 1.5)])
def test_numbers_are_those_of_fortran(tmp_path, number, value):
    mesh, _ = read(tmp_path, f"*NODE\n1,0,0\n2,30,0\n3,30,{number}\n4,0,20\n*ELEMENT,TYPE=CPS4\n7,1,2,3,4\n".replace(
        f"3,30,{number}", f"3,30,40\n5,0,{number}") + "*ELEMENT,TYPE=CPS3\n8,5,2,4\n")
    assert mesh.nodes[list(mesh.node_labels).index(5), 1] == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize("number", ["1_0", "1.5x", "--1", "1.5+", "١"])
def test_other_texts_are_no_numbers(tmp_path, number):
    with pytest.raises(InputError, match="line 4: not a number"):
        read(tmp_path, NODES.replace("3,1,1", f"3,1,{number}") + "*ELEMENT,TYPE=CPS4\n7,1,2,3,4\n")


def test_instances_are_moved_and_turned(tmp_path):
    """Translation first, then a turn about the axis through two points (Abaqus keywords guide, *INSTANCE)."""
    text = PART + ("*ASSEMBLY, NAME=A\n*INSTANCE, NAME=G-1, PART=grip\n*END INSTANCE\n"
                   "*INSTANCE, NAME=G-2, PART=GRIP\n3., 0.\n3., 0., 0., 3., 0., 1., 90.\n*END INSTANCE\n"
                   "*NODE\n1, 50., 50.\n*NSET, NSET=RP\n1\n*NSET, NSET=FAR, INSTANCE=G-2\n2, 3\n"
                   "*NSET, NSET=MIXED\nG-1.2, G-2.END\n*ELSET, ELSET=S, INSTANCE=G-2\n1\n*SURFACE, NAME=TOP\nS, S2\n"
                   "*END ASSEMBLY\n")
    mesh, notes = read(tmp_path, text)
    assert mesh.n_elements == 2 and mesh.n_nodes == 8 and len(set(mesh.node_labels)) == 8
    np.testing.assert_allclose(mesh.nodes[:4], SQUARE)
    np.testing.assert_allclose(mesh.nodes[4:], [(3, 0), (3, 1), (2, 1), (2, 0)], atol=1e-12)
    points = {name: {tuple(x) for x in np.round(mesh.nodes[ids], 9).tolist()} for name, ids in mesh.node_sets.items()}
    assert points["FAR"] == {(3, 1), (2, 1)} and points["MIXED"] == {(1, 0), (3, 0), (2, 0)}
    assert points["G-1_END"] == {(0, 0), (0, 1)} and points["G-2_END"] == {(3, 0), (2, 0)}
    assert {tuple(x) for x in mesh.nodes[mesh.face_nodes(mesh.edge_sets["TOP"][0])].round(9)} == {(3, 1), (2, 1)}
    assert "RP" not in mesh.node_sets and any("belong to no element" in note for note in notes)


def test_an_instance_of_a_missing_part_or_a_set_of_a_missing_instance_is_refused(tmp_path):
    with pytest.raises(InputError, match="line 15: an instance of a part that does not exist"):
        read(tmp_path, PART + "*ASSEMBLY, NAME=A\n*INSTANCE, NAME=G-1, PART=OTHER\n*END INSTANCE\n*END ASSEMBLY\n")
    with pytest.raises(InputError, match="line 18: an instance that does not exist"):
        read(tmp_path, PART + "*ASSEMBLY, NAME=A\n*INSTANCE, NAME=G-1, PART=GRIP\n*END INSTANCE\n"
             "*NSET, NSET=X, INSTANCE=G-9\n1\n*END ASSEMBLY\n")


def test_nodes_of_local_systems_stand_where_they_are_meant(tmp_path):
    turned = "*SYSTEM\n5., 0., 0., 5., 1., 0.\n4., 0., 0.\n*NODE\n1,0,0\n2,1,0\n*SYSTEM\n*NODE\n3,4,1\n4,4,0\n"
    mesh, _ = read(tmp_path, turned + "*ELEMENT,TYPE=CPS4\n7,1,2,3,4\n")
    np.testing.assert_allclose(mesh.nodes, [(5, 0), (5, 1), (4, 1), (4, 0)], atol=1e-15)
    ring = "*NODE, SYSTEM=C\n1,10,0\n2,20,0\n3,20,90\n4,10,90\n*ELEMENT,TYPE=CPS4\n7,1,2,3,4\n"
    mesh, _ = read(tmp_path, ring + "*TRANSFORM,NSET=X\n1,1,0,-1,1,0\n")  # of results and loads, not of coordinates
    np.testing.assert_allclose(mesh.nodes, [(10, 0), (20, 0), (0, 20), (0, 10)], atol=1e-14)


def test_included_files_are_read_and_named(tmp_path):
    mesh, _ = read(tmp_path, "*INCLUDE, INPUT=nodes.txt\n*ELEMENT, TYPE=CPS4, INPUT=elements.txt\n",
                   nodes=NODES, elements="7,1,2,3,4\n")
    assert mesh.n_elements == 1
    files = read_mesh_file(tmp_path / "mesh.inp").files
    assert [path.name for path in files] == ["mesh.inp", "nodes.txt", "elements.txt"]
    with pytest.raises(InputError, match=r"nodes.txt: line 4: not a number"):
        read(tmp_path, "*INCLUDE, INPUT=nodes.txt\n", nodes=NODES.replace("3,1,1", "3,1,x"))


@pytest.mark.parametrize("name, message", [("lost.txt", "not there"), ("../mesh.inp", "leaves"),
                                           ("/etc/hostname", "leaves"), ("mesh.inp", "include each other")])
def test_an_included_file_that_cannot_be_read_is_refused_with_the_line(tmp_path, name, message):
    with pytest.raises(InputError, match=f"line 1: .*{message}"):
        read(tmp_path, f"*INCLUDE, INPUT={name}\n{NODES}")


def test_springs_masses_and_interfaces_are_left_out_with_a_note(tmp_path):
    others = ("*ELEMENT,TYPE=SPRINGA,ELSET=X\n8,1,3\n*ELEMENT,TYPE=MASS\n9,1\n"
              "*ELEMENT,TYPE=COH2D4,ELSET=X\n10,1,2,3,4\n"
              "*ELSET,ELSET=Y\n7,8\n")
    mesh, notes = read(tmp_path, f"{NODES}*ELEMENT,TYPE=CPS4\n7,1,2,3,4\n{others}")
    assert mesh.n_elements == 1 and mesh.element_sets["Y"].tolist() == [0] and "X" not in mesh.element_sets
    assert [note for note in notes if "1 SPRINGA" in note or "1 COH2D4" in note or "1 MASS" in note] == notes[:3]
    with pytest.raises(InputError, match="line 6: an element type that idic does not know"):
        read(tmp_path, f"{NODES}*ELEMENT,TYPE=WONDER4\n7,1,2,3,4\n")


def test_a_range_skips_the_gaps_of_the_numbering(tmp_path):
    mesh, _ = read(tmp_path, f"{NODES}*NODE\n9,0,2\n*ELEMENT,TYPE=CPS4\n7,1,2,3,4\n*ELEMENT,TYPE=CPS3\n8,4,3,9\n"
                   "*NSET,NSET=A,GENERATE\n3,9\n*NSET,NSET=B,GENERATE\n1,9,2\n")
    assert mesh.node_labels[mesh.node_sets["A"]].tolist() == [3, 4, 9]
    assert mesh.node_labels[mesh.node_sets["B"]].tolist() == [1, 3, 9]


def test_a_surface_without_faces_is_the_outside(tmp_path):
    mesh, _ = read(tmp_path, "*NODE\n1,0,0\n2,1,0\n3,2,0\n4,0,1\n5,1,1\n6,2,1\n*ELEMENT,TYPE=CPS4,ELSET=E\n1,1,2,5,4\n"
                   "2,2,3,6,5\n*SURFACE,NAME=OUT\nE,\n*SURFACE,NAME=HALF\n1\n")
    assert len(edge(mesh, "OUT")) == 6 and {2, 5} not in edge(mesh, "OUT") and len(edge(mesh, "HALF")) == 3


def test_a_line_of_three_nodes_has_its_middle_second(tmp_path):
    nodes = "*NODE\n1,0,0\n2,1,0\n3,1,1\n4,0,1\n5,.5,0\n6,1,.5\n7,.5,1\n8,0,.5\n"
    text = nodes + "*ELEMENT,TYPE=CPS8\n1,1,2,3,4,5,6,7,8\n*ELEMENT,TYPE={},ELSET=END\n2,2,6,3\n"
    for element in ("T3D3", "B32", "B22", "T2D3"):
        mesh, _ = read(tmp_path, text.format(element))
        assert edge(mesh, "END") == [{2, 3, 6}] and mesh.node_labels[mesh.node_sets["END"]].tolist() == [2, 3, 6]


def test_lines_of_two_nodes_on_quadratic_elements_take_the_nodes_between(tmp_path):
    nodes = "*NODE\n1,0,0\n2,1,0\n3,1,1\n4,0,1\n5,.5,0\n6,1,.5\n7,.5,1\n8,0,.5\n*ELEMENT,TYPE=CPS8\n1,1,2,3,4,5,6,7,8\n"
    mesh, notes = read(tmp_path, nodes + "*ELEMENT,TYPE=T3D2,ELSET=END\n2,2,3\n")
    assert mesh.node_labels[mesh.node_sets["END"]].tolist() == [2, 3, 6] and edge(mesh, "END") == [{2, 3, 6}]
    assert not notes
    _, notes = read(tmp_path, nodes + "*NSET,NSET=END\n2,3\n")
    assert len(notes) == 1 and "END holds the ends of 1 edges without the nodes between" in notes[0]


def test_a_node_that_stands_twice_is_refused_unless_it_is_the_same(tmp_path):
    element = "*ELEMENT,TYPE=CPS4\n7,1,2,3,4\n"
    assert read(tmp_path, f"{NODES}*NODE\n3,1,1\n{element}")[0].n_nodes == 4
    with pytest.raises(InputError, match="line 7: a node label occurs twice: 3"):
        read(tmp_path, f"{NODES}*NODE\n3,1,1.5\n{element}")
