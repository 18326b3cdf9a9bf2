"""Ray-traced images: against closed formulas, against each other, and against an independent renderer."""

from dataclasses import replace

import numpy as np
import pytest

from idic.correlation import build_ray_map
from idic.fe import Block, make_mesh
from idic.images import PinholeCamera, PlacedCamera, rotation_of
from idic.virtual_tests import Rig, Scene, Sensor, SolidSpeckle

SHAPE = (60, 90)
CAMERA = PinholeCamera(1500.0, 1510.0, 46.0, 28.0, skew=0.3, k1=-0.3, p1=1e-3,
                       rotation=rotation_of([6.0, -14.0, 3.0]) @ Rig.FROM_ABOVE, translation_mm=[0.1, 0.2, 150.0])
SQUARE = np.array([[-6.0, -6.0, 0.0], [6.0, -6.0, 0.0], [6.0, 6.0, 0.0], [-6.0, 6.0, 0.0]])
ONE = [Block("quad4", np.array([[0, 1, 2, 3]]), 0)]


def waves(points):
    """A smooth pattern in space."""
    return 120.0 + 50.0 * np.sin(points @ [1.1, 0.7, 0.9]) + 40.0 * np.cos(points @ [-0.6, 1.3, 0.5])


def pixels():
    rows, columns = np.mgrid[:SHAPE[0], :SHAPE[1]]
    return np.column_stack([columns.ravel(), rows.ravel()]).astype(float)


def test_a_plane_shows_the_pattern_where_its_rays_meet_it():
    image = Scene(SQUARE, ONE).image(0 * SQUARE, CAMERA, waves, Sensor(SHAPE, supersampling=1))
    at = CAMERA.inverse(pixels())
    expected = waves(np.column_stack([at, np.zeros(len(at))])).reshape(SHAPE)
    assert np.abs(image - expected).max() < 1e-5  # Newton's last step of 1e-6 of a face of 12 mm


def test_a_motion_carries_the_pattern_with_the_material():
    """A rigid motion of the body is the opposite motion of the camera."""
    turn, shift = rotation_of([2.0, 3.0, -5.0]), np.array([0.4, -0.2, 1.5])
    moved = Scene(SQUARE, ONE).image(SQUARE @ turn.T + shift - SQUARE, CAMERA, waves, Sensor(SHAPE))
    other = CAMERA.placed(CAMERA.rotation @ turn, CAMERA.rotation @ shift + CAMERA.translation_mm)
    still = Scene(SQUARE, ONE).image(0 * SQUARE, other, waves, Sensor(SHAPE))
    assert np.abs(moved - still).max() < 1e-5


def test_a_sphere_is_hit_on_its_near_side():
    """Quadratic faces on a sphere of 4 mm; the image against the ray-sphere intersection."""
    n = 12
    s = np.linspace(-0.6, 0.6, 2 * n + 1)
    x, y = np.meshgrid(s, s, indexing="ij")
    nodes = 4.0 * np.column_stack([np.sin(x.ravel()), np.sin(y.ravel()) * np.cos(x.ravel()),
                                   np.cos(x.ravel()) * np.cos(y.ravel())])
    at = np.arange(len(nodes)).reshape(2 * n + 1, 2 * n + 1)
    i, j = (2 * a.ravel() for a in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    faces = np.stack([at[i, j], at[i + 2, j], at[i + 2, j + 2], at[i, j + 2], at[i + 1, j], at[i + 2, j + 1],
                      at[i + 1, j + 2], at[i, j + 1]], axis=1)
    image = Scene(nodes, [Block("quad8", faces, 0)]).image(0 * nodes, CAMERA, waves,
                         Sensor(SHAPE, background=-1.0, supersampling=1))
    centre, rays = CAMERA.rays(pixels())
    b, c = rays @ centre, centre @ centre - 16.0
    with np.errstate(invalid="ignore"):
        expected = waves(centre + (-b - np.sqrt(b**2 - c))[:, None] * rays).reshape(SHAPE)
    seen = image > 0.0
    assert 500 < seen.sum() < image.size
    assert np.abs(image - expected)[seen].max() < 0.05  # faces of 0.4 mm leave the sphere by 1e-4 mm; 150 per mm


def test_two_cameras_see_one_speckle():
    pair = Rig.around(SHAPE, 0.1, 120.0, (-15.0, 15.0))
    speckle = SolidSpeckle.drawn(np.random.default_rng(3), 0.3)
    left, right = (Scene(SQUARE, ONE).image(0 * SQUARE, camera, speckle.value, Sensor(SHAPE, supersampling=1))
                   for camera in pair.cameras)
    points = np.random.default_rng(1).uniform(-2.5, 2.5, (400, 2))
    at = [camera.project(points) for camera in pair.cameras]
    rounded = [np.rint(own).astype(int) for own in at]
    ours, theirs = (image[own[:, 1], own[:, 0]] for image, own in zip((left, right), rounded))
    assert np.corrcoef(ours, theirs)[0, 1] > 0.9  # half a pixel apart at most, of dots of 3 px
    assert left.std() > 25.0


@pytest.mark.parametrize("distorted", [False, True])
def test_an_independent_renderer_sees_the_same_point_in_every_pixel(distorted):
    """riley-raster draws the material coordinates of a tilted square: pixel centres, principal point, the sense of the
    axes and of the distortion are then those of both renderers and of the correlator."""
    riley = pytest.importorskip("riley", reason="riley-raster is not installed")
    turn = rotation_of([20.0, -25.0, 10.0])
    tilted = SQUARE @ turn.T
    k1, p1, p2 = (-0.5, 0.004, -0.003) if distorted else (0.0, 0.0, 0.0)
    convention = riley.ConnectConvention(riley.EElemType.QUAD4, riley.EConnectAxis.ROW, 0, riley.ENodeOrder.RILEY)
    theirs = []
    for k in range(2):
        shader = riley.NodalShader(field=np.ascontiguousarray(SQUARE[:, k:k + 1]),
                                   scaling_type=riley.ScaleStrategy.none)
        mesh = riley.create_mesh(convention, riley.MeshType.quad4, np.ascontiguousarray(tilted),
                                 np.array([[0, 1, 2, 3]], dtype=np.uintp), shader)
        camera = riley.Camera(SHAPE[::-1], (0.01, 0.01), (0.0, 0.0, 150.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 15.0, 1,
                              distort_model=int(distorted), distort_k1=k1, distort_p1=p1, distort_p2=p2)
        settings = riley.RasterConfig(save_strategy=int(riley.SaveStrategy.memory), parallel=1,
                                      report=int(riley.ReportMode.off))
        theirs.append(np.asarray(riley.raster([mesh], [camera], settings)).reshape(SHAPE))
    ny, nx = SHAPE
    ours = PinholeCamera(1500.0, 1500.0, 0.5 * (nx - 1), 0.5 * (ny - 1), k1=k1, p1=p1, p2=p2,
                         rotation=Rig.FROM_ABOVE, translation_mm=[0.0, 0.0, 150.0])
    for k in range(2):
        image = Scene(tilted, ONE).image(0 * tilted, ours, lambda p: (p @ turn)[:, k],
                             Sensor(SHAPE, supersampling=1, background=0.0))
        assert np.abs(image - theirs[k]).max() < 1e-5  # mm: our Newton's last step on a face of 12 mm
    plane = make_mesh(tilted, [("hex8", np.zeros((0, 8), int))])
    found = build_ray_map(replace(plane, blocks=()), ONE, PlacedCamera(ours), SHAPE)
    points = found.interpolate(SQUARE)
    for k in range(2):
        assert np.abs(points[:, k] - theirs[k][found.iy, found.ix]).max() < 1e-5  # (a, b) are float32: 6e-8 of 12 mm
