"""Fields of pixels onto nodes, and steady conduction where there are no pixels."""

import numpy as np
import pytest

from idic.correlation import onto_nodes
from idic.errors import InputError
from idic.fe import conductance, conducted, make_mesh, unreached, volume
from idic.images import Camera

CAMERA = Camera.from_table(0.05, (20.0, 10.0), ("+col", "+row"))  # the body covers columns 20 to 100, rows 10 to 50
SHAPE = (60, 120)


def plate(nx=8, ny=4, length=4.0, width=2.0, cell="quad8"):
    step = 2 if cell == "quad8" else 1
    n = (step * nx + 1, step * ny + 1)
    x, y = np.meshgrid(np.linspace(0, length, n[0]), np.linspace(0, width, n[1]), indexing="ij")
    at = np.arange(x.size).reshape(n)
    conn = []
    for i in range(0, n[0] - 1, step):
        for j in range(0, n[1] - 1, step):
            a, b, c, d = at[i, j], at[i + step, j], at[i + step, j + step], at[i, j + step]
            middles = [at[i + 1, j], at[i + 2, j + 1], at[i + 1, j + 2], at[i, j + 1]] if step == 2 else []
            conn.append([a, b, c, d, *middles])
    used = np.unique(conn)
    number = np.full(x.size, -1)
    number[used] = np.arange(len(used))
    return make_mesh(np.column_stack([x.ravel(), y.ravel()])[used], [(cell, number[np.array(conn)])])


def seen(field, camera=CAMERA, shape=SHAPE):
    """The image of a field over the plane, `field` maps (n, 2) mm to (n,)."""
    rows, columns = np.indices(shape)
    points = camera.inverse(np.column_stack([columns.ravel(), rows.ravel()]).astype(float))
    return field(points).reshape(shape)


def hill(points):
    return 20.0 + 60.0 * np.exp(-((points[:, 0] - 1.5) ** 2 + (points[:, 1] - 1.0) ** 2))


# conduction -----------------------------------------------------------------------------------------------
@pytest.mark.parametrize("cell", ["quad4", "quad8"])
def test_two_known_ends_make_a_linear_course_and_one_a_uniform_body(cell):
    mesh = plate(cell=cell)
    x = mesh.nodes[:, 0]
    values = np.full((2, mesh.n_nodes), np.nan)
    values[:, x == 0.0] = 5.0
    values[0, x == 4.0] = 25.0
    linear, uniform = conducted(mesh, values)
    np.testing.assert_allclose(linear, 5.0 + 5.0 * x, atol=1e-10)
    np.testing.assert_allclose(uniform, 5.0, atol=1e-10)


def test_the_conductance_of_a_strip_is_width_over_length():
    mesh = plate()
    T = mesh.nodes[:, 0] / 4.0
    assert T @ (conductance(mesh) @ T) == pytest.approx(2.0 / 4.0, rel=1e-12)
    assert volume(mesh) == pytest.approx(8.0, rel=1e-12)


def test_a_piece_that_no_temperature_reaches_is_refused():
    one = plate(2, 2)
    two = make_mesh(np.vstack([one.nodes, one.nodes + [10.0, 0.0]]),
                    [("quad8", np.vstack([b.connectivity + k * one.n_nodes for b in one.blocks for k in (0, 1)]))])
    values = np.full((1, two.n_nodes), np.nan)
    values[0, 0] = 1.0
    assert unreached(two, ~np.isnan(values[0])) >= one.n_nodes
    with pytest.raises(InputError, match="piece of the mesh without a temperature"):
        conducted(two, values)


# projection -------------------------------------------------------------------------------------------------
def test_a_linear_field_comes_back_at_every_node():
    mesh = plate()
    linear = lambda p: 3.0 + 2.0 * p[:, 0] - 4.0 * p[:, 1]
    field = onto_nodes(mesh, mesh.blocks, CAMERA, [seen(linear)], smoothing_px=1e-3)
    np.testing.assert_allclose(field.values[0], linear(mesh.nodes), atol=2e-4)  # the smoothing's pull, (1e-3)^2 x 12 K
    assert field.visible.all()


def test_a_hill_comes_back_within_the_mesh_and_the_smoothing():
    mesh = plate(12, 6)
    field = onto_nodes(mesh, mesh.blocks, CAMERA, [seen(hill)])
    assert np.abs(field.values[0] - hill(mesh.nodes)).max() < 0.005 * 60.0  # quadratic elements of a third of the hill


@pytest.mark.parametrize("pixel", [0.05, 0.2])
def test_noise_averages_over_the_pixels_of_a_node_as_the_note_says(pixel):
    mesh = plate(4, 2)
    rng, std, n = np.random.default_rng(5), 0.3, 60
    camera, shape = (CAMERA, SHAPE) if pixel == 0.05 else (Camera.from_table(pixel, (3.0, 3.0), ("+col", "+row")),
                                                           (20, 30))
    images = [np.full(shape, 20.0) + std * rng.standard_normal(shape) for _ in range(n)]
    field = onto_nodes(mesh, mesh.blocks, camera, images)
    found = np.sqrt(field.values.var(axis=0, ddof=1).mean()) / std
    assert field.noise < (0.5 if pixel == 0.05 else 2.0)
    assert found == pytest.approx(field.noise, rel=0.15)  # 37 nodes, 60 draws: 2 to 5 %, 3 of them


def test_pixels_without_a_value_do_not_count_and_unseen_nodes_get_theirs_by_conduction():
    mesh = plate()
    image = seen(lambda p: 10.0 * p[:, 0])
    image[:, 60:] = np.nan  # the right half is hidden: beyond it nothing but insulation
    image[20, 30] = np.nan
    field = onto_nodes(mesh, mesh.blocks, CAMERA, [image], smoothing_px=1e-2)
    x = mesh.nodes[:, 0]
    left = x < 1.5
    assert np.abs(field.values[0, left] - 10.0 * x[left]).max() < 0.05
    hidden = x > 2.6
    assert not field.visible[x > 3.0].any()
    assert np.abs(field.values[0, hidden] - 20.0).max() < 1.0  # the temperature of the border


def test_elements_smaller_than_a_pixel_get_values_between_the_pixels():
    coarse = Camera.from_table(0.4, (1.0, 1.0), ("+col", "+row"))  # 10 x 5 pixels for 480 quad8 elements
    mesh = plate(30, 16)
    field = onto_nodes(mesh, mesh.blocks, coarse, [seen(hill, coarse, (8, 13))], margin_px=0)
    inside = (mesh.nodes > 0.3).all(axis=1) & (mesh.nodes[:, 0] < 3.7) & (mesh.nodes[:, 1] < 1.7)
    assert np.isfinite(field.values).all()
    bend = 240.0  # K/mm², |T_xx| + |T_yy| at the top: linear interpolation misses h²/8 of it, the smoothing l²
    assert np.abs(field.values[0, inside] - hill(mesh.nodes[inside])).max() < (0.4**2 / 8 + 0.04**2) * bend


def test_a_body_that_moves_is_followed():
    mesh = plate(12, 6)
    motion = np.zeros((2, mesh.n_nodes, 2))
    motion[1, :, 0] = 0.4  # 8 px
    moved = seen(lambda p: np.where((p[:, 0] > 0.4) & (p[:, 0] < 4.4), hill(p - [0.4, 0.0]), -50.0))
    still = onto_nodes(mesh, mesh.blocks, CAMERA, [seen(hill), moved], None)
    followed = onto_nodes(mesh, mesh.blocks, CAMERA, [seen(hill), moved], motion)
    assert np.abs(followed.values[1] - hill(mesh.nodes)).max() < 0.3
    assert np.abs(still.values[1] - hill(mesh.nodes)).max() > 20.0
    assert followed.steepest < 0.1 < 1.0 < still.steepest  # K/px


def test_images_without_the_body_or_without_values_are_refused():
    mesh = plate()
    with pytest.raises(InputError, match="no pixel of the body has a value"):
        onto_nodes(mesh, mesh.blocks, CAMERA, [np.full(SHAPE, np.nan)])
    with pytest.raises(InputError, match="nothing is left"):
        onto_nodes(mesh, mesh.blocks, CAMERA, [np.zeros(SHAPE)], margin_px=30)
