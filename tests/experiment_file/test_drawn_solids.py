"""A solid with a seen face, made of a drawn outline and a thickness: no mesh file, no script."""

from __future__ import annotations

import numpy as np
import pytest

from experiment_file.small_experiment import TOML, write_experiment
from idic.errors import InputError
from idic.experiment_file import load_experiment

ROI = "roi_px = [10, 10, 50, 40], element_px = 10"
OUTLINE = ("outline_px = [[10, 10], [50, 10], [50, 40], [10, 40]], element_px = 6, "
           "edge_names = { TOP = [1], BOTTOM = [3] }")
HOLE = "holes_px = [[30, 25, 6]]"


def folder(tmp_path, mesh, axes='["+col", "-row"]', kind='kind = "solid"\nsurface = "FRONT"'):
    text = TOML.replace('mesh = "mesh.inp"\nmesh_unit = "mm"\n', f"mesh = {{ {mesh} }}\n")
    text = text.replace('kind = "plane_stress"\nthickness_mm = 2.0', kind)
    if "solid" in kind:
        text = text.replace('BOTTOM"\n', 'BOTTOM"\nuz = 0.0\n')
    return write_experiment(tmp_path / "test", text.replace('["+col", "-row"]', axes))


def volume_and_areas(mesh):
    """mm³ of the body and mm² of every face set, of straight elements, by the divergence theorem."""
    def area(face):
        corners = mesh.nodes[mesh.face_nodes(face)]
        corners = corners[:4 if len(corners) in (4, 8) else 3]
        return 0.5 * sum(np.cross(corners[k] - corners[0], corners[k + 1] - corners[0])
                         for k in range(1, len(corners) - 1)), corners.mean(axis=0)
    total = sum(float(a @ c) for a, c in map(area, mesh.boundary_faces())) / 3.0
    return total, {name: sum(area(face)[0] for face in faces) for name, faces in mesh.edge_sets.items()}


@pytest.mark.parametrize("layers", [1, 3])
@pytest.mark.parametrize("plane", [ROI, f"{OUTLINE}, {HOLE}", f'{OUTLINE}, {HOLE}, elements = "triangles"'])
def test_the_solid_has_the_outline_the_thickness_and_its_faces(tmp_path, plane, layers):
    mesh = load_experiment(folder(tmp_path, f"{plane}, through_mm = 1.5, layers = {layers}"),
                           {"options.element_order": "as_given"}).model.mesh
    mesh.check_elements()
    volume, areas = volume_and_areas(mesh)
    assert mesh.nodes[:, 2].min() == -1.5 and mesh.nodes[:, 2].max() == 0.0
    assert set(np.unique(np.round(mesh.nodes[:, 2], 9))) == set(np.round(np.linspace(-1.5, 0.0, layers + 1), 9))
    plan = areas["FRONT"][2]
    assert np.allclose(areas["FRONT"], [0, 0, plan]) and np.allclose(areas["BACK"], [0, 0, -plan])  # outwards
    flat = load_experiment(folder(tmp_path / "flat", plane, kind='kind = "plane_stress"\nthickness_mm = 1.5'),
                           {"options.element_order": "as_given"}).model.mesh
    corners = [flat.nodes[row] for block in flat.blocks for row in block.connectivity]
    assert plan == pytest.approx(sum(0.5 * abs(np.sum(c[:, 0] * np.roll(c[:, 1], -1) - np.roll(c[:, 0], -1) * c[:, 1]))
                                     for c in corners), rel=1e-9)
    assert volume == pytest.approx(1.5 * plan, rel=1e-9)
    assert np.allclose(areas["TOP"], [0, 4.0 * 1.5, 0]) and np.allclose(areas["BOTTOM"], [0, -4.0 * 1.5, 0])
    assert np.ptp(mesh.nodes[mesh.node_sets["TOP"]], axis=0) == pytest.approx([4.0, 0.0, 1.5])


def test_the_body_lies_behind_the_face_that_the_camera_sees(tmp_path):
    """Where y runs downwards in the image, z points away from the camera."""
    mesh = load_experiment(folder(tmp_path, f"{ROI}, through_mm = 1.5", axes='["+col", "+row"]')).model.mesh
    assert mesh.nodes[:, 2].min() == 0.0 and mesh.nodes[:, 2].max() == 1.5
    corners = mesh.nodes[mesh.face_nodes(mesh.edge_sets["FRONT"][0])[:4]]
    assert np.all(corners[:, 2] == 0.0) and np.cross(corners[1] - corners[0], corners[2] - corners[0])[2] < 0.0


@pytest.mark.parametrize("mesh, kind, words", [
    (ROI, 'kind = "solid"\nsurface = "FRONT"', "give through_mm, or a mesh file"),
    (f"{ROI}, through_mm = 1.0", 'kind = "plane_stress"\nthickness_mm = 1.0', "leave through_mm out"),
    (f"{ROI}, layers = 3", 'kind = "plane_stress"\nthickness_mm = 1.0', "layers without a thickness"),
    ('file = "mesh.inp", through_mm = 1.0', 'kind = "solid"\nsurface = "FRONT"', "has its thickness already")])
def test_keys_that_do_not_go_together_are_refused(tmp_path, mesh, kind, words):
    with pytest.raises(InputError, match=words):
        load_experiment(folder(tmp_path, mesh, kind=kind))
