"""Points, extensometers, lines and circles on fields that are known exactly."""

import numpy as np
import pytest

from idic.fe import interpolation, make_mesh
from idic.measure import FieldSeries, readings, surface_of
from idic.model import Gauge
from idic.virtual_tests import strip_with_hole

GRADIENT = np.array([[0.02, 0.01], [-0.03, -0.006]])
SHIFT = np.array([0.3, -0.2])


@pytest.fixture(scope="module", params=["quad4", "quad8"])
def surface(request):
    return surface_of(strip_with_hole(28.0, 16.0, 3.0, request.param, 4, 5, 3), None)


@pytest.fixture(scope="module")
def series(surface):
    u = surface.plane.nodes @ GRADIENT.T + SHIFT
    rng = np.random.default_rng(1)
    noise = 1e-3 * rng.standard_normal((60, surface.n_nodes, 2))
    return FieldSeries(surface, (0, 4), np.stack([0 * u, u]), np.stack([0 * u, 1.01 * u]), noise)


def read(series, gauge):
    return {reading.quantity: reading for reading in readings(series, gauge)}


def test_a_linear_field_is_carried_to_points_exactly(surface):
    points = np.array([[8.0, 1.0], [-5.5, 7.3], [3.0001, 0.0], [0.0, 0.0], [40.0, 0.0]])
    weights, inside = interpolation(surface.plane.nodes, surface.plane.blocks, points)
    assert inside.tolist() == [True, True, True, False, False], "the hole and the outside hold no point"
    assert np.allclose((weights @ surface.plane.nodes)[inside], points[inside], atol=1e-6 * 28.0)


def test_a_homogeneous_deformation_has_its_gradient_at_every_node(series):
    assert np.allclose(series.F[1], np.eye(2) + GRADIENT, atol=1e-12)


def test_an_extensometer_reads_the_change_of_length(series):
    gauge = Gauge("gauge", "extensometer", ((-8.0, 1.0), (8.0, 5.0)))
    found = read(series, gauge)
    start = np.array([16.0, 4.0])
    exact = np.linalg.norm(start + GRADIENT @ start) - np.linalg.norm(start)
    assert np.allclose(found["elongation"].simulated, [0.0, exact], atol=1e-7)
    assert np.allclose(found["strain"].simulated, [0.0, exact / np.linalg.norm(start)], atol=1e-8)
    assert found["strain"].measured[1] > found["strain"].simulated[1]


def test_the_noise_of_an_extensometer_is_that_of_its_two_ends(series):
    nodes = series.surface.plane.nodes
    ends = nodes[[int(np.argmin(nodes[:, 0])), int(np.argmax(nodes[:, 0]))]]
    found = read(series, Gauge("gauge", "extensometer", tuple(map(tuple, ends))))["elongation"]
    # at a node the weight is one: the std is sqrt(2) of 1e-3, known from 60 samples to 10 % (three times over)
    assert found.std[0] == pytest.approx(np.sqrt(2.0) * 1e-3, rel=0.3)


@pytest.mark.parametrize("gauge", [Gauge("P", "probe", ((8.0, 1.0),)), Gauge("C", "circle", ((8.0, 1.0),), 2.0)])
def test_a_point_and_a_circle_read_displacement_and_strain(series, gauge):
    found = read(series, gauge)
    assert np.allclose(found["u_x"].simulated[1], GRADIENT[0] @ [8.0, 1.0] + SHIFT[0], atol=1e-6)
    E = (GRADIENT + GRADIENT.T + GRADIENT.T @ GRADIENT) / 2.0
    for name, (i, j) in {"xx": (0, 0), "yy": (1, 1), "xy": (0, 1)}.items():
        assert found[f"strain_{name}"].simulated[1] == pytest.approx(E[i, j], abs=1e-10)
    assert found["strain_1"].simulated[1] == pytest.approx(np.linalg.eigvalsh(E)[1], abs=1e-10)
    assert found["strain_xx"].std[1] > 0.0


def test_a_line_across_the_hole_reads_nothing_there(series):
    gauge = Gauge("cut", "line", ((-8.0, 0.0), (8.0, 0.0)), samples=33)
    found = read(series, gauge)["u_x"].simulated[1]
    x = gauge.places[:, 0]
    assert np.array_equal(np.isnan(found), np.abs(x) < 3.0 - 1e-9)
    assert np.allclose(found[np.abs(x) > 3.0], (GRADIENT[0, 0] * x + SHIFT[0])[np.abs(x) > 3.0], atol=1e-6)


def test_a_node_that_is_not_seen_hides_only_its_own_elements(series):
    measured = series.measured.copy()
    lost = int(np.argmin(series.surface.plane.nodes[:, 0]))
    measured[1, lost] = np.nan
    found = read(FieldSeries(series.surface, series.frames, series.simulated, measured),
                 Gauge("P", "probe", ((8.0, 1.0),)))
    assert np.isfinite(found["strain_xx"].measured[1]) and found["strain_xx"].std is None


@pytest.mark.parametrize("face, side", [(0, "below"), (1, "above")])
def test_the_surface_of_a_solid_is_a_plane_mesh_whichever_way_it_faces(face, side):
    x, y, z = (axis.ravel() for axis in np.meshgrid([0.0, 1.0, 2.0], [0.0, 1.0, 2.0], [0.0, 0.5], indexing="ij"))
    at = np.arange(18).reshape(3, 3, 2)
    conn = [[at[i, j, 0], at[i + 1, j, 0], at[i + 1, j + 1, 0], at[i, j + 1, 0],
             at[i, j, 1], at[i + 1, j, 1], at[i + 1, j + 1, 1], at[i, j + 1, 1]] for i in (0, 1) for j in (0, 1)]
    mesh = make_mesh(np.column_stack([x, y, z]), [("hex8", np.array(conn))],
                     edge_sets={"SEEN": np.array([[element, face] for element in range(4)])})
    surface = surface_of(mesh, "SEEN")
    surface.plane.check_elements()
    assert surface.n_nodes == 9 and set(mesh.nodes[surface.index, 2]) == {0.0 if side == "below" else 0.5}
    u = mesh.nodes[surface.index, :2] @ GRADIENT.T
    assert np.allclose(surface.deformation(u), np.eye(2) + GRADIENT, atol=1e-12)
