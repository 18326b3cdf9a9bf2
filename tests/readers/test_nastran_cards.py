"""Nastran bulk data: local systems, wide, free and continued cards, blank fields; what cannot be used is named."""

from __future__ import annotations

import numpy as np
import pytest

from idic.errors import InputError
from idic.readers import read_mesh_file

SQUARE = "GRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nGRID,3,,1.,1.,0.\nGRID,4,,0.,1.,0.\n"
RING = ((10.0, 0.0), (20.0, 0.0), (0.0, 20.0), (0.0, 10.0))


def read(tmp_path, text, n_dim=2):
    (tmp_path / "mesh.bdf").write_text(text)
    mesh, notes = read_mesh_file(tmp_path / "mesh.bdf").to_mesh(n_dim, 1.0)
    mesh.check_elements()
    return mesh, notes


def row(*fields, width=8):
    """A line of fixed columns: the name in 8, the fields in `width`, and the mark that ends a wide line."""
    text = f"{fields[0]:<8}" + "".join(f"{field!s:<{width}}" for field in fields[1:])
    return text + "\n"


def test_points_of_a_cylindrical_system_are_a_ring(tmp_path):
    """CORD2C: origin, a point on the axis, a point in the plane of angle 0."""
    system = "CORD2C,7,0,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\n"
    grids = "GRID,1,7,10.,0.,0.\nGRID,2,7,20.,0.,0.\nGRID,3,7,20.,90.,0.\nGRID,4,7,10.,90.,0.\n"
    quad = "CQUAD4,1,1,1,2,3,4\n"
    mesh, _ = read(tmp_path, system + grids + quad)
    np.testing.assert_allclose(mesh.nodes, RING, atol=1e-13)
    by_default = "GRDSET,,7\n" + system + grids.replace(",7,", ",,") + quad
    np.testing.assert_allclose(read(tmp_path, by_default)[0].nodes, RING, atol=1e-13)
    stated = by_default.replace("GRID,1,,10.,0.,0.", "GRID,1,0,10.,0.,0.")  # 0 is the basic system, blank the default
    np.testing.assert_allclose(read(tmp_path, stated)[0].nodes, RING, atol=1e-13)


def test_systems_are_chained_and_may_stand_on_grid_points(tmp_path):
    """A spherical system (r, angle from its axis, angle about it) in one that is moved and turned by 90 degrees."""
    text = ("CORD2R,1,0,5.,0.,0.,5.,0.,1.\n,5.,1.,0.\nCORD2S,2,1,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\n"
            "GRID,1,2,10.,90.,0.\nGRID,2,2,20.,90.,0.\nGRID,3,2,20.,90.,90.\nGRID,4,2,10.,90.,90.\nCQUAD4,1,1,1,2,3,4\n")
    turned = [(5 - y, x) for x, y in RING]  # x of system 1 is y of the mesh
    np.testing.assert_allclose(read(tmp_path, text)[0].nodes, turned, atol=1e-13)
    on_grids = ("GRID,11,,0.,0.,0.\nGRID,12,,0.,0.,3.\nGRID,13,,2.,0.,0.\nCORD1C,7,11,12,13\nGRDSET,,7\n"
                "GRID,1,,10.,0.,0.\nGRID,2,,20.,0.,0.\nGRID,3,,20.,90.,0.\nGRID,4,,10.,90.,0.\nCQUAD4,1,1,1,2,3,4\n")
    with pytest.raises(InputError, match="line 4: CORD1C 7 is defined by itself"):  # its grids take GRDSET, too
        read(tmp_path, on_grids)
    for label in (11, 12, 13):
        on_grids = on_grids.replace(f"GRID,{label},,", f"GRID,{label},0,")
    np.testing.assert_allclose(read(tmp_path, on_grids)[0].nodes, RING, atol=1e-13)


@pytest.mark.parametrize("text, message", [
    ("GRID,1,9,0.,0.,0.\nCQUAD4,1,1,1,2,3,4\n", "line 1: GRID refers to a coordinate system that does not exist"),
    ("CORD2R,9,8,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\nCORD2R,8,9,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\nGRID,1,9,0.,0.,0.\n"
     "CQUAD4,1,1,1,2,3,4\n", r"line \d: CORD2R [89] is defined by itself"),
    ("CORD2R,9,0,0.,0.,0.,0.,0.,1.\n,0.,0.,2.\nGRID,1,9,0.,0.,0.\nCQUAD4,1,1,1,2,3,4\n",
     "line 1: CORD2R 9 has no axes"),
    ("GRID,1,,0.,x,0.\nCQUAD4,1,1,1,2,3,4\n", "line 1: GRID: y is not a number"),
    ("CQUAD4,1,1,1,2,3,\n", "line 1: CQUAD4 1 lacks a corner"),
    ("CQUAD4,1,1,1,2,3,99\n", "line 1: CQUAD4 1 refers to a grid point that does not exist"),
    ("CQUAD8,1,1,1,2,3,4,5,\n,7,8\n", "line 1: CQUAD8 1 lacks some of its mid-side nodes"),
    ("CQUAD4,1,1,1,2,3,4\nCTRIA3,1,1,1,2,3\n", "line 2: element 1 occurs twice"),
    ("CQUAD4,1,1,1,2,3,4\nGRID,3,,1.,1.5,0.\n", "grid point 3 occurs twice"),
    ("CHEXA,1,1,1,2,3,4,5,6,7,8\n", "line 1: CHEXA: more fields than a line has"),
    ("=,*1,=\n", "line 1: a card that repeats"),
    ("CHEXA,1,1,1,2,3,4,5,6,+A\n+B,7,8\n", "line 2: CHEXA: its lines are not in order"),
    ("CBUSH,1,1,1,2\n", "the file holds no elements"), ("", "the file holds no elements")])
def test_a_card_that_cannot_be_used_is_named_with_its_line(tmp_path, text, message):
    with pytest.raises(InputError, match=message) as caught:
        read(tmp_path, text + (SQUARE.partition("\n")[2] if "GRID,1," in text else SQUARE))
    assert "damaged" not in str(caught.value)


def test_wide_and_short_cards_stand_beside_each_other(tmp_path):
    text = (row("GRID*", 1, "", "0.", "0.", width=16) + row("*", "0.", width=16) + row("GRID", 2, "", "1.", "0.", "0.")
            + "GRID*,3,,1.0D0,1.\n*,0.\n" + "grid    4       \t0.\t1.\n"
            + row("GRID", 5, "", "2.", "0.") + row("GRID", 6, "", "2.", "1.")
            + row("CQUAD4*", 1, 7, 1, 2, width=16) + row("*", 3, 4, width=16) + row("cquad4", 2, 8, 2, 5, 6, 3))
    mesh, _ = read(tmp_path, text)
    assert mesh.element_labels.tolist() == [1, 2] and mesh.node_labels.tolist() == [1, 2, 3, 4, 5, 6]
    np.testing.assert_array_equal(mesh.nodes, [(0, 0), (1, 0), (1, 1), (0, 1), (2, 0), (2, 1)])
    assert {name: ids.tolist() for name, ids in mesh.element_sets.items()} == {"property_7": [0], "property_8": [1]}


@pytest.mark.parametrize("quad", ["CQUAD4,1,1,1,2,3,4,30.,0.1", "CQUAD4,1,,1,2,3,4", "cquad4,1,1,1,2,3,4 $ comment",
                                  row("CQUAD4", 1, 1, 1, 2, 3, 4, "45.", "-.5"), "CQUADR,1,1,1,2,3,4",
                                  "CPLSTS4,1,1,1,2,3,4,0.", "CQUAD,1,1,1,2,3,4", "CQUAD8,1,1,1,2,3,4,,,\n,,,1.,1."])
def test_fields_behind_the_nodes_and_blank_ones_do_no_harm(tmp_path, quad):
    bulk = f"BEGIN BULK\n{SQUARE}{quad}\nENDDATA\nGRID,1,,7.,7.,7.\n"
    mesh, _ = read(tmp_path, f"ID A,B\nSOL 101\nCEND\nTITLE = X\n{bulk}")
    assert mesh.n_elements == 1 and mesh.blocks[0].connectivity.tolist() == [[0, 1, 2, 3]]


@pytest.mark.parametrize("text, value", [("1.5+1", 15.0), ("1.5-101", 1.5e-101), ("1.5E+1", 15.0), ("1.5D1", 15.0),
                                         (".15+2", 15.0), ("15", 15.0), ("", 0.0)])
def test_numbers_may_lack_the_letter_of_the_exponent(tmp_path, text, value):
    mesh, _ = read(tmp_path, f"{SQUARE}GRID,5,,-9.,{text},0.\nCQUAD4,1,1,1,2,3,4\nCTRIA3,2,1,1,4,5\n")
    assert mesh.nodes[4, 1] == value


def test_mid_side_nodes_of_solids_stand_where_they_belong(tmp_path):
    """CHEXA: bottom, upright, top edges (Nastran); the upright ones come last in idic."""
    corners = np.array([(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)], float)
    edges = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 5), (2, 6), (3, 7), (4, 5), (5, 6), (6, 7), (7, 4)]
    points = np.vstack([corners, *[corners[list(edge)].mean(axis=0) for edge in edges]])
    grids = "".join(f"GRID,{k},,{x},{y},{z}\n" for k, (x, y, z) in enumerate(points, 1))
    labels = list(range(1, 21))
    lines = [",".join(map(str, part)) for part in (labels[:6], labels[6:14], labels[14:])]
    card = f"CHEXA,1,1,{lines[0]}\n,{lines[1]}\n,{lines[2]}\n"
    mesh, _ = read(tmp_path, grids + card + "CQUAD4,9,5,1,2,3,4\n", 3)
    assert mesh.blocks[0].cell == "hex20" and len(mesh.edge_sets["property_5"]) == 1
    bottom = mesh.nodes[mesh.node_sets["property_5"]]
    assert len(bottom) == 8 and not bottom[:, 2].any()


def test_bars_on_quadratic_elements_take_the_nodes_between(tmp_path):
    mids = "GRID,5,,.5,0.,0.\nGRID,6,,1.,.5,0.\nGRID,7,,.5,1.,0.\nGRID,8,,0.,.5,0.\n"
    mesh, _ = read(tmp_path, f"{SQUARE}{mids}CQUAD8,1,1,1,2,3,4,5,6\n,7,8\nCBAR,2,3,2,3\n")
    assert mesh.node_labels[mesh.node_sets["property_3"]].tolist() == [2, 3, 6]


def test_masses_and_rigid_bodies_are_left_out_with_a_note(tmp_path):
    mesh, notes = read(tmp_path, f"{SQUARE}CQUAD4,1,1,1,2,3,4\nCONM2,7,1,,3.\nRBE2,8,1,123,2,3\n")
    assert mesh.n_elements == 1 and [note.split(": ")[1].split(" cards")[0] for note in notes] == ["1 CONM2", "1 RBE2"]


def test_included_files_are_read(tmp_path):
    (tmp_path / "grids.dat").write_text(SQUARE)
    mesh, _ = read(tmp_path, "BEGIN BULK\nINCLUDE 'grids.dat'\nCQUAD4,1,1,1,2,3,4\nENDDATA\n")
    assert mesh.n_nodes == 4
    with pytest.raises(InputError, match="line 1: the path leaves"):
        read(tmp_path, "INCLUDE '/etc/hostname'\n")
