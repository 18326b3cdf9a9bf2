"""A reference that is the mean of N images carries 1/N of the noise of one: every test of noise must know that."""

from dataclasses import replace

import numpy as np
import pytest
from side_twins import NOISE, Side, write_folder

from idic.diagnose import Columns, identification_at, null_model, residual_evidence, score
from idic.diagnose.locate.noise_draws import recorded_frames
from idic.diagnose.locate.onset import MotionRecord
from idic.diagnose.residual.evidence import Courses, noise_share
from idic.diagnose.residual.excess import pixel_tests
from idic.diagnose.residual.grey_value_effects import columns_of_kind
from idic.diagnose.residual.heldout import grid_of, misfit_of
from idic.diagnose.residual.subspace import gain_and_rank
from idic.experiment_file import load_experiment
from idic.images import ArrayStack

STILL, T = 6, 12  # images averaged, frames after them
SIGMAS = 4.5  # a sound statistic goes beyond once in 10^5 seeds


@pytest.fixture(scope="module")
def at_rest(tmp_path_factory):
    """A body that rests in all of its images: noise and nothing else, at the true parameters."""
    known = load_experiment(write_folder(tmp_path_factory.mktemp("still") / "clean", Side()))
    rng, n = np.random.default_rng(5), STILL + T
    image = known.recording.stack.frame(0).astype(np.float32)
    images = image + NOISE * rng.standard_normal((n, *image.shape)).astype(np.float32)
    channels = tuple(replace(c, values=c.noise_std * rng.standard_normal(n), rates=None) for c in known.model.channels)
    prescribed = tuple(replace(p, drive=replace(p.drive, values=np.zeros(n), rates=None)) if hasattr(p.drive, "values")
                       else p
                       for p in known.model.prescribed)
    return replace(known, recording=replace(known.recording, stack=ArrayStack(images),
                                            labels=tuple(str(k) for k in range(n)), averaged=tuple(range(STILL)),
                                            noise=replace(known.recording.noise, std_gv=NOISE)),
                   model=replace(known.model, channels=channels, prescribed=prescribed, times=np.arange(float(n)),
                                 reference=STILL - 1), options=replace(known.options, lowpass_px=0.0))


@pytest.fixture(scope="module")
def residual(at_rest):
    values = at_rest.model.parameters.as_values()
    return residual_evidence(identification_at(at_rest, values, np.zeros((at_rest.model.n_frames, 1)), None))


def test_white_noise_has_unit_variance(residual):
    evidence = residual.evidence
    assert len(evidence.frames) == T
    assert evidence.chi2 / evidence.n_pixels == pytest.approx(1.0, abs=SIGMAS * np.sqrt(2.0 / evidence.n_pixels))
    found = misfit_of(residual, grid_of(residual))
    assert abs(found.excess_z) < SIGMAS
    omnibus = next(test for test in pixel_tests(residual) if test.name == "omnibus")
    assert 1e-5 < omnibus.p_value < 1.0 - 1e-5


@pytest.mark.parametrize("kind", ["gain", "offset", "light"])
def test_light_that_is_alike_all_over_a_frame_tells_nothing(residual, kind):
    """Every frame has its own gain and offset: the sum of all places is one of them, but for rounding."""
    evidence = residual.evidence
    ways = columns_of_kind(evidence.pixel_names, kind, float(residual.context.reference.f.mean()))
    n = ways.shape[1]
    columns = Columns(tuple(map(str, range(n))), np.zeros((T, len(evidence.seen), n)),
                      np.zeros((*residual.channels.shape, n)), np.linspace(0.1, 1.0, T)[:, None, None] * ways)
    found = score(evidence, null_model(evidence, residual.null), columns)
    assert abs(found.information.sum()) < 1e-3 * np.trace(found.information)  # images in single precision
    assert abs(found.U.sum()) < 1e-2 * np.abs(found.U).max()


def test_columns_of_grey_values_meet_noise_alone(residual):
    """The blur's column holds the noise of the mean, whose product with the residual is known."""
    for part in residual.evidence.parts:
        z = part.pixel.q / np.sqrt(np.diagonal(part.pixel.gram))
        assert np.abs(z).max() < SIGMAS


def test_a_frame_at_rest_is_not_blurred(at_rest, residual):
    blurred = replace(at_rest, options=replace(at_rest.options, defocus="frame"))
    z = []
    for frame in residual.evidence.frames:
        share = residual.context.reference.compare(blurred, int(frame), np.zeros((at_rest.model.mesh.n_nodes, 2)))
        z.append(share.rb[-1] / np.sqrt(share.bb[-1, -1] * NOISE**2 * (1.0 + 1.0 / STILL)))
    assert np.abs(z).max() < SIGMAS


def test_light_and_the_blur_of_a_frame_share_what_their_images_share(at_rest):
    """Of images without noise of their own nothing is taken off. Taken off all the same, a blur that a frame has of its
    own left light where there was none (15 standard deviations)."""
    blurred = replace(at_rest, options=replace(at_rest.options, defocus="frame"))
    values = at_rest.model.parameters.as_values()
    part = residual_evidence(identification_at(blurred, values, np.zeros((T + STILL, 1)), None)).evidence.parts[0]
    shared, alike = part.pixel.border[:, -1], part.pixel.gram[:, -1]  # with the frame's own blur; with the tested one
    scale = np.sqrt(np.diagonal(part.pixel.gram) * part.pixel.gram[-1, -1])
    assert np.abs(shared - alike).max() < 1e-4 * scale.max()  # grey values in single precision
    assert (np.abs(shared - alike) / scale).max() < 1e-3


def test_columns_are_scored_as_white_fields_of_every_frame(residual):
    """Motions times courses, with grey values, and grey values alone, against the white columns frame by frame."""
    evidence, rng = residual.evidence, np.random.default_rng(8)
    turned = np.eye(2) + 0.1 * rng.standard_normal(evidence.back.shape)
    evidence = replace(evidence, back=turned, kappa=rng.uniform(0.7, 1.4, T))
    k, n = len(evidence.pixel_names), 6
    grey, motion = rng.standard_normal((T, k, n)), np.array([1, 0, 1, 0, -1, -1])
    grey[..., :3] = 0.0
    columns = Columns(tuple("abcdef"), rng.standard_normal((T, len(evidence.seen), 2)), rng.standard_normal((T, 1, n)),
                      grey, Courses(motion, rng.standard_normal((T, n))))
    null = null_model(evidence, residual.null)
    found, white = score(evidence, null, columns), evidence.whiten(columns)
    weighed = evidence.weighed(white)
    np.testing.assert_allclose(found.gross, evidence.products(white, weighed), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.moves, -null.covariance @ evidence.products(null.white, weighed), rtol=1e-9)
    np.testing.assert_allclose(found.U, evidence.scores(white) + found.moves.T @ null.b, rtol=1e-9)
    for parts in (([0, 1], [2, 3, 4, 5]), ([4], [1, 0])):
        beside = score(evidence, null, *(columns.pick(part) for part in parts))
        members = np.ix_(sum(parts, []), sum(parts, []))
        np.testing.assert_allclose(beside.information, found.information[members], rtol=1e-9, atol=1e-9)
    plain = score(evidence, null, columns.expanded())
    np.testing.assert_allclose(plain.information, found.information, rtol=1e-9, atol=1e-9)


def test_the_drop_by_fields_is_that_of_their_eigenvalues():
    rng = np.random.default_rng(2)
    for n_rows in (200, 40):  # all fields are seen; only as many directions as rows
        drawn = rng.standard_normal((n_rows, 60)) * rng.uniform(0.01, 3.0, 60)
        drawn[:, 3] = 0.0  # seen by nothing
        matrix, rhs = drawn.T @ drawn, drawn.T @ rng.standard_normal(n_rows)
        gain, rank = gain_and_rank(matrix, rhs)
        assert rank == min(n_rows, 59)
        assert gain == pytest.approx(float(rhs @ np.linalg.lstsq(matrix, rhs, rcond=1e-12)[0]), rel=1e-6)


def test_one_look_at_a_frame_gives_what_two_give(at_rest, residual):
    reference, motion = residual.context.reference, 0.1 * np.ones((at_rest.model.mesh.n_nodes, 2))
    equations, found = reference.compare_with_residual(at_rest, STILL + 2, motion)
    alone, whole = (reference.compare(at_rest, STILL + 2, motion),
                    reference.compare_pixels(at_rest, STILL + 2, motion, np.zeros(0)))
    assert np.array_equal(equations.q, alone.q) and np.array_equal(equations.rb, alone.rb)
    assert np.array_equal(found.r, whole.r) and np.array_equal(found.valid, whole.valid)


def test_whitening_is_a_root_of_the_inverse_covariance(residual):
    rng = np.random.default_rng(0)
    kappa = rng.uniform(0.7, 1.4, T)
    back = np.tile(np.eye(2), (T, residual.evidence.back.shape[1], 1, 1))
    evidence = replace(residual.evidence, kappa=kappa, back=back)
    n = len(evidence.seen)
    fields = np.zeros((T, n, T))
    fields[np.arange(T), 0, np.arange(T)] = 1.0
    W = evidence.whiten(Columns(tuple(map(str, range(T))), fields, np.zeros((T, 1, T)))).fields[:, 0]
    covariance = np.diag(kappa) + 1.0 / STILL
    np.testing.assert_allclose(W @ covariance @ W.T, np.eye(T), atol=1e-12)
    np.testing.assert_allclose(recorded_frames(evidence, W.T[:, :, None])[:, :, 0], np.eye(T), atol=1e-12)
    record = MotionRecord(np.zeros((T, 1)), np.zeros((T, 1, 0)), np.ones(1, dtype=bool), kappa, np.ones(T), STILL)
    np.testing.assert_allclose(record.white(np.eye(T)[:, None, :], np.arange(T))[:, 0], W, atol=1e-12)
    assert noise_share(kappa, 10**9) < 1e-8  # a reference without noise: frames are independent already
