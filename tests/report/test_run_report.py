"""Files beside the report page, and the meshes of the examples: what is written is what another program reads."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from types import SimpleNamespace

import meshio
import numpy as np
import pytest

from idic.errors import InputError
from idic.readers import read_mesh_file
from idic.run.reporting.paraview import _frames, write_collection
from idic.run.reporting.write import load_record
from idic.virtual_tests import strip_with_hole, write_inp


class Stored:
    """Displacements of two frames, as `FrameArrays` gives them."""

    n_frames = 2

    def read(self, first, last):
        return np.zeros((last - first, 4, 2))


@pytest.mark.parametrize("unit", ["mm", "px"])
def test_the_displacement_of_a_paraview_file_has_the_unit_of_the_mesh_in_its_name(unit):
    mesh = SimpleNamespace(nodes=np.zeros((4, 2)))
    model = SimpleNamespace(length_unit=unit, reference=0, times=np.arange(2.0), mesh=mesh)
    record = SimpleNamespace(sensitivities=None, series=None)
    assert [list(fields) for _, fields in _frames(model, Stored(), record)] == [[f"displacement_{unit}"]] * 2


@pytest.mark.parametrize("cell, name", [("quad4", "quad"), ("quad8", "quad8")])
def test_paraview_files_hold_the_mesh_the_times_and_the_fields(tmp_path, cell, name):
    mesh = strip_with_hole(28.0, 16.0, 3.0, cell, 2, 2, 1)
    u = 0.01 * mesh.nodes
    path = write_collection(
        tmp_path / "paraview", mesh, [(0.0, {"displacement_mm": 0 * u}), (2.5, {"displacement_mm": u})]
    )
    entries = ElementTree.parse(path).getroot().findall("Collection/DataSet")
    assert [float(e.get("timestep")) for e in entries] == [0.0, 2.5]
    read = meshio.read(path.parent / entries[1].get("file"))
    assert read.cells[0].type == name and np.array_equal(read.cells[0].data, mesh.blocks[0].connectivity)
    assert (
        np.allclose(read.point_data["displacement_mm"][:, :2], u) and not read.point_data["displacement_mm"][:, 2].any()
    )


def test_a_folder_without_a_result_is_refused(tmp_path):
    with pytest.raises(InputError, match="no result"):
        load_record(tmp_path)


@pytest.mark.parametrize("cell", ["quad4", "quad8"])
def test_the_strip_is_a_sound_mesh_with_a_round_hole(tmp_path, cell):
    mesh = strip_with_hole(28.0, 16.0, 3.0, cell, 4, 5, 3)
    mesh.check_elements()
    outer, hole = mesh.boundary_edges()
    corners = mesh.nodes[np.unique([mesh.face_nodes(f) for f in hole])]
    assert np.allclose(np.hypot(*corners.T), 3.0)
    assert len(mesh.node_sets["LEFT"]) == len(mesh.node_sets["RIGHT"]) == (9 if cell == "quad4" else 17)
    write_inp(mesh, tmp_path / "mesh.inp", "strip")
    read, _ = read_mesh_file(tmp_path / "mesh.inp").to_mesh(2, 1.0)
    assert np.allclose(read.nodes, mesh.nodes)
    assert np.array_equal(read.element_sets["sheet"], mesh.element_sets["sheet"])
