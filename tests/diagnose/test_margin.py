"""The practical margin: what the camera shows at rest is blamed on no law."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from calculix_bricks import write_sheet
from matrix_of_sides import SIDES
from side_twins import write_folder
from test_verdicts import POWER, left, rival, ranked, round_of, screening

from idic.diagnose import Margin, candidate_library, residual_evidence, screen_candidates
from idic.diagnose.locate.mismatch import locate
from idic.diagnose.locate.nested_tests import without_channels
from idic.diagnose.residual.channel_left import ChannelLeft
from idic.diagnose.residual.excess import margin_chi2, power
from idic.diagnose.residual.excess_left import ExcessLeft
from idic.diagnose.residual.margin import ASSUMED, FLOOR_FACTOR, PRACTICAL_MARGIN_PX
from idic.diagnose.screen.practical import MIN_CHANNEL_EFFECT_STD, PracticalSize
from idic.diagnose.screen.score_columns import score_columns
from idic.diagnose.screen.situation import situation
from idic.diagnose.selection.rival import judge
from idic.diagnose.selection.verdict import conclude
from idic.experiment_file import load_experiment, read_toml
from idic.identification import identify
from idic.measure import CameraFloor
from idic_studies.trial.tool_run import run_tool


MANY = 1e9  # chi-square of one px of motion in many pixels


def floor(px, nodes_px=np.ones(1)):
    return CameraFloor(px, 1.1 * px, px * np.asarray(nodes_px), 48.0, (11,), "images", (0.4,))


def test_without_still_frames_the_margin_is_an_assumption_and_says_so():
    assert ASSUMED.px == PRACTICAL_MARGIN_PX and ASSUMED.camera_px == 0.0
    assert "assumption" in ASSUMED.words and "no frame of this recording is at rest" in ASSUMED.words


def test_a_camera_that_shows_more_than_the_assumption_sets_the_margin():
    noisy = Margin(floor(0.02))
    assert noisy.px == noisy.inclusion_px == pytest.approx(FLOOR_FACTOR * 0.02)
    assert "0.02 px" in noisy.words and "not attributed to a law" in noisy.words


def test_a_quiet_camera_does_not_lower_the_margin_as_still_frames_show_no_interpolation():
    assert Margin(floor(0.001)).px == PRACTICAL_MARGIN_PX and Margin(floor(0.0)).px == PRACTICAL_MARGIN_PX


def test_the_margin_of_a_region_is_that_of_its_nodes():
    by_region = Margin(floor(0.02, np.array([1.4, 0.2])))
    assert by_region.local_px(np.array([1.0, 0.0])) == pytest.approx(FLOOR_FACTOR * 0.028)
    assert by_region.local_px(np.array([0.0, 1.0])) == pytest.approx(FLOOR_FACTOR * 0.004)


@pytest.mark.parametrize(("camera_px", "word"), [(0.0, "outside_library"), (0.02, "single")])
def test_motion_of_the_size_of_the_camera_does_not_make_a_candidate_a_formal_fit(camera_px, word):
    """Chi-square 300 in each of 10 frames is a motion of 0.017 px; it is most of what free motions explain."""
    rounds = [round_of(screening(ranked("creep")), [rival("creep", 1000.0)])]
    excess = [ExcessLeft(left(400.0), left(300.0), POWER, margin_px=max(0.004, camera_px), camera_px=camera_px)]
    found = conclude(rounds, left(400.0), left(300.0), True, excess, camera_chi2=POWER * camera_px**2)
    assert found.word == word


@pytest.mark.parametrize(("off", "before_px", "word"), [(20.0, 0.0030, "single"), (20.0, 0.0041, "outside_library"),
                                                        (0.1, 0.0030, "outside_library")])
def test_motions_below_the_margin_do_not_unmake_a_cause_of_the_readings(off, before_px, word):
    """A load cell 20 standard deviations off in every frame, explained, beside motions that stay."""
    def fit(px, z):
        return replace(left(MANY * px**2 / 10.0), channels=np.full((10, 1), z))

    before, after = fit(before_px, off), fit(0.95 * before_px, 0.1)
    rounds = [round_of(screening(ranked("force_drift")), [rival("force_drift", before.chi2 - after.chi2)])]
    channel = ChannelLeft("F", np.full(10, off), np.full(10, 0.1), 1e-3)
    found = conclude(rounds, before, after, True, [ExcessLeft(before, after, MANY)], channels=[channel])
    assert found.word == word


@pytest.fixture(scope="module")
def distorted(tmp_path_factory):
    """A lens that distorts: identified without that, its residual, and the column of the distortion."""
    path = write_folder(tmp_path_factory.mktemp("margin") / "twin", SIDES["lens_distortion"])
    found = identify(load_experiment(path))
    residual = residual_evidence(found)
    here = situation(found, residual, read_toml(path))
    trials = [(c, v) for c in candidate_library() if c.name == "lens_distortion" for v in c.variants(here)]
    return found, residual, score_columns(found, residual, trials, lambda edits: load_experiment(path, edits))


def screened(distorted, margin):
    """By the images alone: a force that the lens falsifies would matter for itself."""
    _, residual, (labels, columns) = distorted
    return screen_candidates(without_channels(residual.evidence), residual.null, labels, columns,
                             practical=PracticalSize(margin.px, MIN_CHANNEL_EFFECT_STD)).ranked[0]


def test_a_significant_candidate_with_an_effect_below_the_floor_is_small(distorted):
    plain = screened(distorted, ASSUMED)
    assert plain.standing == "significant"
    assert screened(distorted, Margin(floor(0.5 * plain.local_px))).standing == "significant"
    assert screened(distorted, Margin(floor(plain.local_px))).standing == "small"


@pytest.mark.parametrize(("share", "standing"), [(0.5, "significant"), (1.5, "small")])
def test_a_candidate_explains_more_than_a_finer_mesh_changes_along_its_own_pattern(distorted, share, standing):
    _, residual, (labels, columns) = distorted
    plain = screen_candidates(residual.evidence, residual.null, labels, columns).ranked[0]
    mesh = columns.pick([plain.best])
    mesh = replace(mesh, fields=share * plain.amplitude * mesh.fields, channels=share * plain.amplitude * mesh.channels)
    found = screen_candidates(residual.evidence, residual.null, labels, columns, mesh=mesh).ranked[0]
    assert found.standing == standing
    assert (found.statistic, found.amplitude) == pytest.approx((plain.statistic, plain.amplitude), rel=1e-9)


def test_a_mismatch_of_the_size_of_the_floor_is_none(distorted):
    found, residual, _ = distorted
    plain = locate(found, residual)
    n_nodes = len(found.experiment.model.mesh.nodes)
    high = Margin(floor(3.0 * plain.effect_px_rms, np.ones(n_nodes)))
    assert plain.nested_tests.p_value < 1e-3 < locate(found, residual, margin=high).nested_tests.p_value


def test_the_chi_square_of_the_margin_is_that_of_its_motion_by_region(distorted):
    evidence = distorted[1].evidence
    n_nodes = evidence.back.shape[1]
    even = margin_chi2(evidence, Margin(floor(0.02, np.ones(n_nodes))))
    np.testing.assert_allclose(even, (FLOOR_FACTOR * 0.02) ** 2 * power(evidence), rtol=1e-12)
    half = np.where(np.arange(n_nodes) % 2, 1.0, 0.0)
    assert np.all(margin_chi2(evidence, Margin(floor(0.02, half))) < even)
    np.testing.assert_array_equal(margin_chi2(evidence), PRACTICAL_MARGIN_PX**2 * power(evidence))


# the one gate of all names ------------------------------------------------------------------------
def refit_of(name, extra, power, is_located=True, shift=0.0):
    """A refit that leaves nothing of so much chi-square per frame, and passes on held-out data."""
    null, made = round_of(screening()).null, rival(name, 10.0 * extra)
    null = replace(null, choice=left(extra), values={"E": 1.0}, stds={"E": 0.01})
    refitted = replace(made.refitted, values={"E": 1.0 + 0.01 * shift}, stds={"E": 0.01, "amplitude": 0.1})
    px = np.sqrt(10.0 * extra / power)
    made = replace(made, ranked=replace(made.ranked, effect_px=px, local_px=px, effect_channel=0.0))
    return replace(made, refitted=refitted, null=null, practical=PracticalSize(0.004, 0.5, power, is_located))


@pytest.mark.parametrize(("px", "names"), [(0.0006, ()), (0.0035, ()), (0.0045, ("creep",)), (0.02, ("creep",))])
def test_a_refit_is_named_by_its_size_whatever_its_significance(px, names):
    """0.0006 px of warmth "explained 93 % of the residual" of a clean sheet with two holes: 6 standard deviations, as a
    million pixels saw it."""
    made = refit_of("creep", 400.0, 4000.0 / px**2)
    assert made.improves
    winner, _ = judge([made], screening())
    assert (() if winner is None else (winner.name,)) == names
    winner, _ = judge([made, refit_of("plasticity", 300.0, 3000.0 / 0.01**2)], screening())
    assert winner.name == (names or ("plasticity",))[0]  # a smaller drop of a practical size


def test_a_reading_of_practical_size_is_enough():
    """Friction moves nothing."""
    made = refit_of("friction", 0.0, 1e9)
    null = replace(made.null, choice=replace(left(0.0), channels=np.full((10, 1), 2.0)))
    made = replace(made, heldout=30.0, null=null)
    assert made.effect.channel_std == pytest.approx(np.sqrt(3.0)) and made.passes
    assert not replace(made, practical=replace(made.practical, channel_std=2.0)).passes


@pytest.mark.parametrize(("is_located", "shift", "passes"),
                         [(False, 7.0, False), (False, 3.0, True), (True, 70.0, True)])
def test_a_pattern_alone_moves_no_parameter_by_many_standard_deviations(is_located, shift, passes):
    """nu at its true 0.304 +- 0.0007 was "corrected" to 0.319, while free motions left nothing."""
    assert refit_of("creep", 400.0, 1e6, is_located, shift).passes is passes


@pytest.mark.parametrize(("share", "standing"), [(0.1, "significant"), (1.2, "excluded")])
def test_a_score_that_an_uncounted_error_of_the_simulation_may_have_is_not_significant(distorted, share, standing):
    _, residual, (labels, columns) = distorted
    plain = screen_candidates(residual.evidence, residual.null, labels, columns).ranked[0]
    error = columns.pick([plain.best])
    error = replace(error, fields=share * plain.amplitude * error.fields,
                    channels=share * plain.amplitude * error.channels)
    tested = screen_candidates(residual.evidence, residual.null, labels, columns, errors=error).ranked[0]
    assert tested.standing == standing and tested.amplitude == pytest.approx(plain.amplitude, rel=1e-9)
    assert tested.statistic < max(1.0 - 0.9 * share, 0.05) * plain.statistic


@pytest.mark.slow  # a diagnosis, 20 s of CPU time
@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
def test_a_clean_sheet_of_a_foreign_solid_gets_no_name(tmp_path):
    """Scores of 5 standard deviations by 0.0007 px of motion: finite strains of bricks, elements of another order."""
    write_sheet(tmp_path, "hole", 300, "flicker")
    content = run_tool(tmp_path).content
    assert content["verdict"] == "none" and content["named"] == []
