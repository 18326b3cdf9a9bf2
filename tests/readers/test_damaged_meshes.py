"""Mesh files that would hang, exhaust the memory or refer to nothing are refused within seconds."""

from __future__ import annotations

import time

import pytest

from idic.errors import InputError
from idic.readers import foreign_mesh
from idic.readers import read_mesh_file

INP = """*NODE
101, 0., 0.
102, 1., 0.
103, 1., 1.
104, 0., 1.
*ELEMENT, TYPE=CPS4, ELSET=ALL
1, 101, 102, 103, 104
"""
MEDIT = """MeshVersionFormatted 1
Dimension 2
Vertices
4
0 0 0
1 0 0
1 1 0
0 1 0
Quadrilaterals
1
1 2 3 {last} 1
End
"""


def read(tmp_path, name: str, text: str):
    (tmp_path / name).write_text(text)
    return read_mesh_file(tmp_path / name)


def test_a_reader_that_waits_for_the_end_of_a_file_is_stopped(tmp_path, monkeypatch):
    monkeypatch.setattr(foreign_mesh, "SECONDS", 1.0)
    start = time.monotonic()
    with pytest.raises(InputError, match="cannot be read") as problem:
        read(tmp_path, "empty.node", "")  # meshio reads the empty lines at its end for ever
    assert "end is not found" in problem.value.found
    assert time.monotonic() - start < 20.0  # 2 s without other work on the machine


def test_a_cell_with_a_node_that_is_not_there_is_refused(tmp_path):
    assert len(read(tmp_path, "plate.mesh", MEDIT.format(last=4)).nodes) == 4
    for last in (5, 0, 10**12):
        with pytest.raises(InputError, match="cannot be read"):
            read(tmp_path, "plate.mesh", MEDIT.format(last=last))


def test_sets_of_sets_are_resolved_once(tmp_path):
    levels = "".join(f"*NSET, NSET=S{k}\nS{k - 1}, S{k - 1}\n" for k in range(1, 60))  # 2^59 members without memory
    raw = read(tmp_path, "nested.inp", f"{INP}*NSET, NSET=S0\n101, 103\n{levels}")
    assert raw.node_sets["S59"].tolist() == [0, 2]


@pytest.mark.parametrize("text, line", [
    ("*NSET, NSET=A, GENERATE\n101, 99999999999\n", "line 9"),
    ("*NSET, NSET=A, GENERATE\n101, 2000000000\n", "line 9"),
    ("*NSET, NSET=A\n99999999999999999999\n", "line 9"),
    (f"*NSET, NSET=A\n{'9' * 5000}\n", "line 9"),
    ("*NSET, NSET=A\n²\n", "line 9"),
    ("*SURFACE, NAME=F\n77, S1\n", "line 9"),
    ("*SURFACE, NAME=F\nNONE, S1\n", "line 9"),
    ("*SURFACE, NAME=F\n1, S0\n", "line 9"),
    ("*SURFACE, NAME=F\n1, S5\n", "line 9"),
    ("*SURFACE, NAME=F, TYPE=NODE\n77\n", "line 9"),
    ("*SURFACE, NAME=F, TYPE=NODE\nNONE\n", "line 9"),
    ("*NODE\n99999999999999999999, 2., 2.\n", "line 9"),
    ("*ELEMENT, TYPE=CPS3\n99999999999999999999, 101, 102, 103\n", "line 9"),
    ("*NSET, NSET=A\nB\n*NSET, NSET=B\nA\n", None),
    ("".join(f"*NSET, NSET=A{k}\nA{k + 1}\n" for k in range(3000)) + "*NSET, NSET=A3000\n101\n", None)])
def test_sets_and_labels_without_meaning_are_refused_with_their_line(tmp_path, text, line):
    with pytest.raises(InputError) as problem:
        read(tmp_path, "part.inp", INP + text)
    assert line is None or problem.value.key == line
