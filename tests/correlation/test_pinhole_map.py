"""Rays of a pinhole camera against faces of a mesh: the pixel comes back, and what is hidden is not seen."""

import numpy as np
import pytest
from pictures import make_mesh
from surfaces import CAMERA, box, placed, tube

from idic.correlation import build_ray_map
from idic.errors import InputError
from idic.fe import Mesh

SHAPE = (90, 130)


@pytest.mark.parametrize("kind", ["tri3", "quad4", "tri6", "quad8", "mixed"])
def test_the_point_of_a_pixel_is_projected_onto_the_pixel(kind):
    nodes, blocks = make_mesh(kind)
    mesh = Mesh(nodes, tuple(blocks))
    found = build_ray_map(mesh, mesh.surface_cells(), CAMERA, SHAPE)
    points = found.interpolate(np.column_stack([nodes, np.zeros(len(nodes))]))
    # (a, b) are float32: 1e-7 of an element of 20 px
    assert np.abs(CAMERA.project(points) - found.points()).max() < 2e-5
    assert found.n_pixels > 5000


def test_a_tube_owns_the_pixels_of_its_near_side_only():
    mesh = tube()
    camera = placed((0.0, 0.0, 0.0), distance=80.0, focal=1200.0, centre=(64.5, 44.5))
    found = build_ray_map(mesh, mesh.surface_cells("OUT"), camera, SHAPE, surface="OUT")
    points = found.interpolate(mesh.nodes)
    assert np.abs(camera.project(points) - found.points()).max() < 2e-5
    to_camera = camera.effective.centre_mm - points
    normals = points * [1.0, 0.0, 1.0]
    cosine = (to_camera * normals).sum(axis=1) / np.linalg.norm(to_camera, axis=1) / np.linalg.norm(normals, axis=1)
    assert cosine.min() > 0.16  # 80 degrees; normals of quadratic faces are a little off those of the cylinder
    # hit by hand: the nearer intersection of ray and cylinder
    centre, rays = camera.effective.rays(found.points())
    a, b, c = (rays[:, [0, 2]] ** 2).sum(axis=1), rays[:, [0, 2]] @ centre[[0, 2]], (centre[[0, 2]] ** 2).sum() - 25.0
    near = centre + ((-b - np.sqrt(b**2 - a * c)) / a)[:, None] * rays
    assert np.linalg.norm(near - points, axis=1).max() < 0.01  # sagitta of a quadratic arc of 15 degrees: 5 um


def test_a_part_of_the_body_outside_the_seen_set_hides_what_is_behind_it():
    front = box()
    camera = placed((0.0, 35.0, 0.0), distance=120.0, focal=1500.0, centre=(64.5, 44.5))
    alone = build_ray_map(front, front.surface_cells("FLOOR"), camera, SHAPE)
    hidden = build_ray_map(front, front.surface_cells("FLOOR"), camera, SHAPE, surface="FLOOR")
    # the wall of height 2 on one side of the floor covers 2 tan(35 deg) = 1.4 of its 8 mm
    assert 0.1 < 1.0 - hidden.n_pixels / alone.n_pixels < 0.25
    points = hidden.interpolate(front.nodes)
    assert np.abs(camera.project(points) - hidden.points()).max() < 2e-5


def test_a_mesh_behind_the_camera_is_refused():
    nodes, blocks = make_mesh("quad4")
    mesh = Mesh(nodes, tuple(blocks))
    with pytest.raises(InputError, match="behind the camera"):
        build_ray_map(mesh, mesh.surface_cells(), placed((0.0, 0.0, 0.0), distance=-100.0), SHAPE)
