"""What is left where a spot was put, also where the model with it sees other nodes."""

from dataclasses import replace

import numpy as np
import pytest
import tifffile
from side_twins import SHAPE, Side, write_folder

from idic.diagnose import Columns, identification_at, null_model, residual_evidence, score
from idic.diagnose.residual.heldout import grid_of
from idic.diagnose.residual.subspace import MIN_EIGENVALUE_SHARE, hats, spectrum
from idic.diagnose.screen.local_residual import local_residual_tests
from idic.diagnose.screen.time_course import GRID_REFINEMENT, added_time_course, time_course_test
from idic.diagnose.residual.excess_left import MAX_INCLUSION_EXCESS_LEFT
from idic.experiment_file import load_experiment
from idic.identification import identify

PLACE, RADIUS, STIFFNESS = np.array([-2.5, 0.5]), 1.0, 0.5
SPOT = {"heterogeneity": [{"set": "BODY", "form": "inclusion", "centre_mm": PLACE.tolist(), "identify_centre": True,
                           "radius_mm": {"value": RADIUS, "identify": True},
                           "stiffness": {"value": STIFFNESS, "identify": True}}]}


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """A strip with a softer spot, of which the left part is masked; the model without it, and what that leaves."""
    side = Side(modulus=lambda X: np.where(np.linalg.norm(X - PLACE, axis=1) < RADIUS, STIFFNESS, 1.0))
    path = write_folder(tmp_path_factory.mktemp("spot") / "case", side)
    mask = np.zeros(SHAPE, dtype=np.uint8)
    mask[:, 33:] = 255
    tifffile.imwrite(path.parent / "mask.tif", mask)
    path.write_text(path.read_text().replace("[experiment]\n", '[experiment]\nmask = "mask.tif"\n'))
    found = identify(load_experiment(path))
    return path, found, residual_evidence(found, light=False)


@pytest.fixture(scope="module")
def with_spot(case):
    path, found, _ = case
    experiment = load_experiment(path, SPOT)
    start = experiment.model.parameters.with_values(found.parameters.as_values())
    return identify(replace(experiment, model=replace(experiment.model, parameters=start)))


def test_a_true_inclusion_leaves_noise(case, with_spot):
    _, _, before = case
    (left,) = local_residual_tests(before, residual_evidence(with_spot, light=False), grid_of(before),
                                   with_spot.parameters.as_values())
    assert left.before.excess_z > 20.0 and abs(left.after.excess_z) < 4.0 and not left.matters


def test_an_inclusion_in_the_wrong_place_leaves_a_significant_excess(case, with_spot):
    _, _, before = case
    values = dict(with_spot.parameters.as_values()) | {"BODY.inclusion.y": PLACE[1] - 0.8}
    after = residual_evidence(identification_at(with_spot.experiment, values, with_spot.local, with_spot.steps),
                              light=False)
    (left,) = local_residual_tests(before, after, grid_of(before), values)
    assert left.matters and left.motion_px > 0.004


def test_a_model_with_other_visible_nodes_is_judged_at_those(case, with_spot):
    _, _, before = case
    camera = with_spot.experiment.model.camera
    moved = replace(with_spot.experiment, model=replace(with_spot.experiment.model,
                                                        camera=replace(camera,
                                                                       origin_px=camera.origin_px + [0.3, 0.0])))
    after = residual_evidence(identification_at(moved, with_spot.parameters.as_values(), with_spot.local,
                                                with_spot.steps), light=False)
    assert len(after.evidence.seen) != len(before.evidence.seen)
    (left,) = local_residual_tests(before, after, grid_of(before), with_spot.parameters.as_values())
    assert abs(left.after.excess_z) < 4.0 and not left.matters


def test_an_inclusion_of_the_identified_model_is_not_new(case, with_spot):
    after = residual_evidence(with_spot, light=False)
    assert local_residual_tests(after, after, grid_of(after), with_spot.parameters.as_values()) == []


def test_the_time_course_of_a_true_inclusion_leaves_noise(case, with_spot):
    _, found, before = case
    right = time_course_test(before, residual_evidence(with_spot, light=False), grid_of(before))
    assert right.before.excess_z > 20.0 and abs(right.after.excess_z) < 4.0 and not right.matters
    assert right.max_share == MAX_INCLUSION_EXCESS_LEFT


def test_the_time_course_of_an_inclusion_is_that_of_the_load(case, with_spot):
    _, _, before = case
    course = added_time_course(before, residual_evidence(with_spot, light=False))
    load = before.channels[:, 0]
    assert np.mean(course**2) == pytest.approx(1.0) and abs(np.corrcoef(course, load)[0, 1]) > 0.99


def test_the_time_course_test_equals_dense_columns_of_all_frames(case, with_spot):
    _, _, before = case
    grid, evidence = grid_of(before), before.evidence
    course = added_time_course(before, residual_evidence(with_spot, light=False))
    fields = hats(evidence, replace(grid, cells=GRID_REFINEMENT * grid.cells)).fields.toarray()
    columns = Columns(tuple(map(str, range(fields.shape[1]))), course[:, None, None] * fields,
                      np.zeros((len(course), len(evidence.channel_weight), fields.shape[1])))
    scores = score(evidence, null_model(evidence, before.null), columns)
    values, vectors, scale = spectrum(scores.information)
    good = values > MIN_EIGENVALUE_SHARE * values.max()
    fit = time_course_test(before, residual_evidence(with_spot, light=False), grid).before
    assert fit.rank[0] == good.sum()
    assert fit.gain[0] == pytest.approx((((vectors[:, good].T @ (scores.U * scale)) ** 2 / values[good]).sum()),
                                        rel=1e-6)
