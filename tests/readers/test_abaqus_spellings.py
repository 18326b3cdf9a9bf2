"""Lines of Abaqus decks that other programs write seldom: the mesh is the same, or the file is refused."""

from __future__ import annotations

import numpy as np
import pytest

from idic.errors import InputError
from idic.readers import read_mesh_file

NODES = "*NODE\n1,0,0\n2,1,0\n3,2,0\n4,0,1\n5,1,1\n6,2,1\n"
ELEMENTS = "*ELEMENT,TYPE=CPS4,ELSET=PLATE\n1,1,2,5,4\n2,2,3,6,5\n"


def read(tmp_path, text, encoding="utf-8"):
    (tmp_path / "mesh.inp").write_bytes(text.encode(encoding))
    return read_mesh_file(tmp_path / "mesh.inp").to_mesh(2, 1.0)[0]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_a_deck_of_any_editor_has_its_nodes_and_names(tmp_path, encoding):
    mesh = read(tmp_path, NODES + ELEMENTS + "*NSET,NSET=Prüfling\n1,4\n", encoding)
    assert mesh.n_nodes == 6 and mesh.node_sets["Prüfling"].tolist() == [0, 3]


def test_an_empty_coordinate_is_zero_and_the_next_one_keeps_its_axis(tmp_path):
    mesh = read(tmp_path, NODES.replace("4,0,1", "4, ,1").replace("2,1,0", "2,1,") + ELEMENTS)
    np.testing.assert_array_equal(mesh.nodes, read(tmp_path, NODES + ELEMENTS).nodes)


def test_a_node_set_of_an_element_set_holds_its_nodes(tmp_path):
    """`*NSET, ELSET=` has no data lines; its nodes join those of other lines of the set."""
    one = "*ELSET,ELSET=FIRST\n1\n*NSET,NSET=A,ELSET=FIRST\n*NSET,NSET=B\n6\n*NSET,NSET=B,ELSET=first\n"
    sets = read(tmp_path, NODES + ELEMENTS + one).node_sets
    assert sets["A"].tolist() == [0, 1, 3, 4] and sets["B"].tolist() == [0, 1, 3, 4, 5]
    with pytest.raises(InputError, match="line 11: set A names a set that does not exist"):
        read(tmp_path, NODES + ELEMENTS + "*NSET,NSET=A,ELSET=LOST\n")


@pytest.mark.parametrize("numbers", ["6, 1, -1", "6, 1", "1, 6, 0", "1"])
def test_a_range_of_labels_that_would_lose_some_is_refused(tmp_path, numbers):
    with pytest.raises(InputError, match="line 12: not a range of labels"):
        read(tmp_path, NODES + ELEMENTS + f"*NSET,NSET=A,GENERATE\n{numbers}\n")


@pytest.mark.parametrize("surface", ["*SURFACE,NAME=F\nPLATE,SPOS\n", "*SURFACE,NAME=F,COMBINE=UNION\nG,H\n",
                                     "*SURFACE,NAME=F,TYPE=CUTTING SURFACE\n1,2,3\n"])
def test_a_surface_that_is_no_edge_of_the_sheet_is_left_out(tmp_path, surface):
    mesh = read(tmp_path, NODES + ELEMENTS + surface + "*SURFACE,NAME=END\n2,S2\n")
    assert {name: faces.tolist() for name, faces in mesh.edge_sets.items()} == {"END": [[1, 1]]}
