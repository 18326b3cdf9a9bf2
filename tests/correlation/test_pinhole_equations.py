"""The nodal route of a pinhole camera against the exact one pixel by pixel, and against difference quotients."""

from dataclasses import replace

import numpy as np
import pytest
from pictures import SHAPE, Texture, grid, with_middles
from surfaces import CAMERA, placed, tube

from idic.correlation import build_ray_map, nodal_equations, PinholeView, residual_map, ReferenceImage
from correlation.pinhole_pixel_equations import pinhole_normal_equations
from idic.fe import make_mesh, nodal_deformation
from idic.images import RigidMotion, prefilter

TUBE_CAMERA = placed((5.0, 12.0, 3.0), distance=80.0, focal=1100.0, k1=-0.1, p1=1e-3)
LENS = ("fx", "fy", "skew", "cx", "cy", "k1", "k2", "k3", "p1", "p2", "rotation_x", "rotation_y", "rotation_z",
        "t_x", "t_y", "t_z")
PLACES = tuple(f"placement.{name}" for name in LENS[-6:])


def plate(n=6):
    nodes, quads = grid(n, n * 2 // 3)
    nodes, cells = with_middles(nodes, quads)
    return make_mesh(nodes, [("quad8", cells)])


def smooth(nodes, seed, size=0.05):
    """A smooth motion in space and four smooth sensitivities of it  # (n, 3), (n, 3, 4)"""
    rng = np.random.default_rng(seed)
    x = nodes if nodes.shape[1] == 3 else np.column_stack([nodes, np.zeros(len(nodes))])
    fields = [np.sin(x @ rng.normal(size=(3, 3)) * 0.4 + rng.normal(size=3)) for _ in range(5)]
    return size * x @ rng.normal(size=(3, 3)) * 0.3 + size * fields[0], np.stack(fields[1:], axis=2)


def case(name, n=6):
    mesh, surface, camera = (plate(n), None, CAMERA) if name == "plate" else (tube(), "OUT", TUBE_CAMERA)
    texture = Texture()
    found = build_ray_map(mesh, mesh.surface_cells(surface), camera, SHAPE, surface=surface)
    f, g = texture.picture(), texture.picture(gradient=np.array([[1.03, 0.02], [0.0, 0.98]]), shift=(0.6, -0.4))
    return mesh, surface, camera, ReferenceImage.of(found, f, 5), f, g


@pytest.mark.parametrize("name", ["plate", "tube"])
def test_nodal_and_pixelwise_equations_agree(name):
    mesh, surface, camera, reference, f, g = case(name)
    u, du = smooth(mesh.nodes, 3)
    slow = pinhole_normal_equations(reference.pixel_map, mesh.nodes, camera, f, g, u, du, 5)
    view = PinholeView(camera, mesh, surface)
    share = nodal_equations(reference, prefilter(g, 5), view.motion(mesh.nodes, u), "none")
    gram = share.gram(view.columns(mesh.nodes, u, du))
    size = np.sqrt(np.diag(slow.M))
    # One F per element of 20 px instead of one per pixel, and J interpolated between the nodes; both are seen to fall
    # with the size of the elements in the next test. Faces of the tube turn by 15 degrees each.
    tolerance = 4e-3
    assert np.abs((gram.matrix - slow.M) / np.outer(size, size)).max() < tolerance
    assert np.abs((gram.rhs - slow.b) / (size * np.linalg.norm(slow.r))).max() < tolerance
    assert share.n_valid == slow.valid.sum()
    # positions: quadratic faces leave the third derivative of perspective and of the motion
    exact = camera.project(reference.pixel_map.interpolate(mesh.nodes if mesh.n_dim == 3 else
                                                           np.column_stack([mesh.nodes, 0 * mesh.nodes[:, 0]]))
                           + reference.pixel_map.interpolate(u))
    fast = reference.pixel_map.points() + reference.pixel_map.interpolate(view.motion(mesh.nodes, u))
    assert np.abs(exact - fast).max() < (2e-4 if name == "plate" else 3e-3)


def test_the_difference_falls_with_the_square_of_the_element_size():
    errors = []
    for n in (6, 12):
        mesh, surface, camera, reference, f, g = case("plate", n)
        u, du = smooth(mesh.nodes, 3)
        slow = pinhole_normal_equations(reference.pixel_map, mesh.nodes, camera, f, g, u, du, 5)
        view = PinholeView(camera, mesh, surface)
        gram = nodal_equations(reference, prefilter(g, 5), view.motion(mesh.nodes, u), "none").gram(
            view.columns(mesh.nodes, u, du))
        size = np.sqrt(np.diag(slow.M))
        errors.append(np.abs((gram.matrix - slow.M) / np.outer(size, size)).max())
    assert errors[1] < 0.4 * errors[0]  # order two: 0.25


@pytest.mark.parametrize("name", ["plate", "tube"])
def test_columns_are_difference_quotients_of_the_position_in_the_frame(name):
    mesh, surface, camera, reference, _, _ = case(name)
    u, du = smooth(mesh.nodes, 5)
    view, step = PinholeView(camera, mesh, surface), 1e-5
    columns = view.columns(mesh.nodes, u, du).reshape(len(mesh.nodes), 2, -1)
    for i in range(du.shape[2]):
        quotient = (view.motion(mesh.nodes, u + step * du[:, :, i])
                    - view.motion(mesh.nodes, u - step * du[:, :, i])) / (
            2 * step)
        assert np.abs(columns[:, :, i] - quotient).max() < 1e-6 * np.abs(quotient).max()  # step squared, rounding


# on a tube every pixel has a depth of its own
@pytest.mark.parametrize("name", [pytest.param("plate", marks=pytest.mark.slow), "tube"])
@pytest.mark.parametrize("parameter", LENS + PLACES + ("turn_x", "turn_y"))
def test_the_column_of_a_camera_parameter_is_the_change_of_the_position_at_fixed_pixels(name, parameter):
    """The exact way: with the changed camera every pixel is traced to its new material point and carried again."""
    mesh, surface, camera, reference, _, _ = case(name)
    u, _ = smooth(mesh.nodes, 7)
    view = PinholeView(camera, mesh, surface)
    gradient = nodal_deformation(mesh, u)
    gradient = np.where(np.isnan(gradient), np.eye(3)[:, :mesh.n_dim], gradient)
    column = reference.pixel_map.interpolate(view.camera_column(mesh.nodes, u, gradient, parameter).reshape(-1, 2))
    positions = []
    value = camera.values()[parameter]
    step = {"fx": 1.0, "fy": 1.0, "skew": 1.0, "cx": 0.1, "cy": 0.1, "k1": 0.01, "k2": 0.1, "k3": 1.0, "p1": 1e-3,
            "p2": 1e-3}.get(parameter, 0.01)
    for sign in (1, -1):
        changed = camera.with_parameters({parameter: value + sign * step})
        found = build_ray_map(mesh, mesh.surface_cells(surface), changed, SHAPE, surface=surface)
        space = mesh.nodes if mesh.n_dim == 3 else np.column_stack([mesh.nodes, 0 * mesh.nodes[:, 0]])
        at = found.interpolate(space + u)
        positions.append([found.to_image(p) for p in changed.project(at).T])
    quotient = (np.array(positions[0]) - np.array(positions[1])) / (2 * step)
    pixels = reference.pixel_map
    quotient = quotient[:, pixels.iy, pixels.ix].T
    known = np.isfinite(quotient).all(axis=1)
    assert known.mean() > 0.9
    scale = np.abs(quotient[known]).max()
    error = np.abs(column - quotient)[known]
    # F at the nodes is the mean of the elements around; on the tube normals are means, too, and (a, b) is float32
    rounding = 4e-5 / step
    assert np.sqrt((error**2).mean()) < (0.01 if name == "plate" else 0.05) * scale + rounding


def test_a_motion_of_the_specimen_moves_the_frame_and_leaves_the_reference():
    mesh, _, camera, reference, f, g = case("plate")
    courses = np.array([[0.0, 1.0], [0.0, 2.0]])
    moving = replace(camera, motion=RigidMotion(("t_z_drift", "rotation_y_drift"), ("t_z", "rotation_y"), courses,
                                                np.array([0.3, 0.2])))
    u, _ = smooth(mesh.nodes, 9)
    view = PinholeView(moving, mesh).at(1)
    assert np.abs(PinholeView(moving, mesh).at(0).motion(mesh.nodes, 0.0 * u)).max() < 1e-9
    still = view.motion(mesh.nodes, u)
    assert np.abs(still - PinholeView(camera, mesh).motion(mesh.nodes, u)).max() > 0.2
    for name in ("placement.t_z_drift", "placement.rotation_y_drift"):
        old, step = moving.motion.values[moving.motion.names.index(name[10:])], 1e-4
        ends = [PinholeView(moving.with_parameters({name: old + s * step}), mesh).at(1).motion(mesh.nodes, u)
                for s in (1, -1)]
        column = view.camera_column(mesh.nodes, u, np.zeros((mesh.n_nodes, 3, 2)), name).reshape(-1, 2)
        quotient = (ends[0] - ends[1]) / (2 * step)
        assert np.abs(column - quotient).max() < 1e-6 * np.abs(quotient).max()


def test_the_residual_at_rest_is_that_of_the_image_itself():
    _, _, _, reference, f, _ = case("tube")
    found = residual_map(reference, prefilter(f, 5), np.zeros((reference.pixel_map.n_nodes, 2)))
    assert np.abs(found.r).max() < 1e-3  # float32 grey values
