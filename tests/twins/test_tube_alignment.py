"""A curved surface, measured by two cameras, next to points clicked by hand; images of a finer mesh than the user's."""

import re
from dataclasses import replace

import numpy as np
import pytest
from notched_tube import GRIP, NOTCH, NOTCH_WIDTH, OUTER, SIZE, still_tube, tube, write_tube

from idic.experiment_file import load_experiment
from idic.virtual_tests import Scene

pytestmark = pytest.mark.slow


def test_clicks_and_the_measured_surface_of_a_tube_place_the_mesh(tmp_path):
    fine = tube(*SIZE.true[:3])
    seen, bare = (fine.face_cells(fine.edge_sets[name]) for name in ("FRONT", "REST"))
    test = replace(still_tube(SIZE), scene=Scene(fine.nodes, seen, bare), grip=GRIP[:2], force=np.zeros(2),
                   displacements=np.zeros((2, fine.n_nodes, 3)))
    x, angle = np.array([-12.0, 12.0, 12.0, -12.0]), np.radians([40.0, 40.0, -40.0, -40.0])
    radius = OUTER - NOTCH * np.exp(-((x / NOTCH_WIDTH) ** 2))
    points = np.column_stack([x, radius * np.sin(angle), radius * np.cos(angle) - OUTER])
    file, rng = write_tube(tmp_path, test), np.random.default_rng(3)
    marks = [(camera.project(points) + rng.standard_normal((4, 2))).tolist() for camera in test.rig.cameras]
    left, right = (f"alignment = {{ points_mm = {points.tolist()}, points_px = {own}, measured_surface = true }}\n"
                   for own in marks)
    text = re.sub(r"rotation = .*\ntranslation_mm = .*\n", lambda _: left, file.read_text())
    file.write_text(text.replace("calibration_camera = 1\n", "calibration_camera = 1\n" + right))
    experiment = load_experiment(tmp_path)
    (prior,) = experiment.model.parameters.joint
    std = dict(zip(prior.names, np.sqrt(np.diag(prior.covariance)), strict=True))
    assert std["placement.rotation_y"] < 0.01 and std["placement.rotation_x"] > 0.1  # deg: about the axis by clicks
    found, true = experiment.model.camera.effective, test.rig.cameras[0]
    along = (true.rotation.T @ found.rotation)[:, 0]  # the axis of the tube, from the mesh to the mesh
    assert np.degrees(np.linalg.norm(along[1:])) < 4.0 * np.hypot(std["placement.rotation_y"],
                                                                  std["placement.rotation_z"])
    assert np.abs(found.project(points) - true.project(points)).max() < 1.0  # px
