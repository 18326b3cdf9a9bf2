"""Side, onset and place of a mismatch: what noise does to every statistic, and twins whose truth is known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import sparse, stats
from side_twins import GRIP, Side, write_folder

from idic.diagnose import Mismatch, SelectedEffect, element_centres, in_words, null_model, residual_evidence
from idic.diagnose.locate.adjoint_sources import (
    BandFactor,
    draw_residual,
    element_scores,
    recorded_residual,
)
from idic.diagnose.locate.fingerprint import fingerprint
from idic.diagnose.locate.freedoms import boundary_patterns
from idic.diagnose.locate.mismatch import locate
from idic.diagnose.locate.nested_tests import normal, level
from idic.diagnose.locate.noise_draws import free_motion, recorded_frames
from idic.diagnose.locate.onset import MotionRecord, growing_windows, load_histories, onset, parameter_cusum
from idic.diagnose.locate.place import clusters
from idic.diagnose.locate.tangents import tangents
from idic.diagnose.residual.excess import p_beyond_margin
from idic.diagnose.residual.heldout import grid_of, misfit_of
from idic.diagnose.residual.residual_evidence import simulated
from idic.diagnose.residual.subspace import hats
from idic.experiment_file import load_experiment
from idic.fe.solver.linear import factorise, make_pattern
from idic.identification import identify
from idic.virtual_tests import strip_with_hole

UNLIKELY = 1e-3  # p of a Kolmogorov-Smirnov test that a sound statistic meets once in a thousand seeds


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    found = identify(load_experiment(write_folder(tmp_path_factory.mktemp("where") / "clean", Side())))
    return found, residual_evidence(found)


@pytest.fixture(scope="module")
def null(clean):
    return null_model(clean[1].evidence, clean[1].null)


def drawn(evidence, rng):
    """The evidence with noise in place of its residual, frames' own unknowns projected out."""
    parts = []
    for part in evidence.parts:
        noise = draw_residual(evidence, part, rng, 1)[:, 0]
        parts.append(replace(part, q=noise[:len(part.q)], channel_q=noise[len(part.q):],
                             inner_q=np.zeros_like(part.inner_q)))
    return replace(evidence, parts=tuple(parts))


def test_drawn_noise_has_the_covariance_of_a_projected_residual(clean):
    evidence, rng = clean[1].evidence, np.random.default_rng(1)
    part = evidence.parts[4]
    n = len(part.q)
    draws = draw_residual(evidence, part, rng, 800)
    forms = rng.standard_normal((n + 1, 3))
    forms[:, 2] = part.border[:, 0] / np.abs(part.border[:, 0]).max()  # along the frame's own unknown
    whole = sparse.block_diag([part.A, np.diag(evidence.channel_weight)])
    exact = forms.T @ (whole @ forms) - (forms.T @ part.border) @ part.inner @ (part.border.T @ forms)
    sampled = np.cov(forms.T @ draws)
    # a variance from 800 draws is known to 5 %: five of these
    assert np.diagonal(sampled) == pytest.approx(np.diagonal(exact), rel=0.25)


def test_the_drop_of_a_level_is_chi_square_with_its_rank(clean, null):
    """Identified parameters included; 40 draws of all frames."""
    evidence, rng = clean[1].evidence, np.random.default_rng(2)
    basis = hats(evidence, grid_of(clean[1], 8.0)).fields
    every = [np.array([t]) for t in range(len(evidence.parts))]
    members, p = np.arange(basis.shape[1]), []
    for _ in range(40):
        noise = drawn(evidence, rng)
        here = replace(null, b=noise.scores(null.white))
        normals = [normal(noise, part, basis, here, t) for t, part in enumerate(noise.parts)]
        p.append(level("hats", normals, every, members, here).p)
    assert stats.kstest(p, "uniform").pvalue > UNLIKELY


def test_free_motion_knows_its_noise(clean, null):
    evidence, rng = clean[1].evidence, np.random.default_rng(3)
    basis = hats(evidence, grid_of(clean[1], 8.0))
    std = free_motion(evidence, null, basis, rng, 200).std
    noise = [drawn(evidence, rng) for _ in range(8)]
    a = [free_motion(one, replace(null, b=one.scores(null.white)), basis, rng, 1).a for one in noise]
    # one mean square over 8 draws of some 100 amplitudes, neighbours and frames dependent: 12 %
    assert np.sqrt(np.mean((np.array(a) / std) ** 2)) == pytest.approx(1.0, abs=0.12)


def test_the_residual_needs_no_derivatives_and_no_second_simulation(clean):
    found, whole = clean
    grid = grid_of(whole)
    less = residual_evidence(found, light=False, null=False, responses=simulated(found, null=False))
    for name in ("gain", "rank", "channels", "light"):
        np.testing.assert_allclose(getattr(misfit_of(less, grid), name), getattr(misfit_of(whole, grid), name),
                                   rtol=1e-9,
                                   atol=1e-9)
    assert less.null.n == 0 < whole.null.n


def test_recorded_frames_undo_whitening(clean):
    evidence = clean[1].evidence
    flat = replace(evidence, back=np.tile(np.eye(2), (*evidence.back.shape[:2], 1, 1)))
    a = np.random.default_rng(4).standard_normal((len(evidence.parts), 1))
    field = np.random.default_rng(5).standard_normal(len(evidence.seen))
    columns = replace(clean[1].null.pick([0]), fields=(a * field)[:, :, None])
    white = flat.whiten(columns).fields[:, :, 0] @ field / (field @ field)
    assert recorded_frames(flat, white[None, :, None])[0] == pytest.approx(a, rel=1e-9)


def test_weighing_a_recorded_change_is_the_transpose_of_whitening(clean):
    evidence, rng = clean[1].evidence, np.random.default_rng(6)
    shape = (len(evidence.parts), len(evidence.seen), 1)
    q, s = rng.standard_normal(shape), rng.standard_normal(shape)
    columns = replace(clean[1].null.pick([0]), fields=s)
    there = np.sum(q * evidence.whiten(columns).fields)
    assert np.sum(recorded_residual(evidence, q) * s) == pytest.approx(there, rel=1e-9)


def test_adjoint_score_of_an_element_is_that_of_its_simulated_softening(clean):
    """One back-substitution for all elements against one solution per element."""
    found, residual = clean
    rng = np.random.default_rng(7)
    p, channel = rng.standard_normal((len(residual.evidence.seen), 1)), np.array([[0.7]])
    for tangent in tangents(found, residual):
        if tangent.index == 3:
            break
    adjoint = element_scores(residual, tangent, p, channel)[:, 0]
    n_dof = found.experiment.model.mesh.nodes.size
    for element in (0, 17):
        forces = np.zeros((n_dof, 1))
        for group, at in zip(tangent.system.groups, tangent.evaluation.groups, strict=True):
            mine = np.flatnonzero(group.elements == element)
            per = group.points_per_element
            for point in (mine[0] * per + np.arange(per) if len(mine) else []):
                forces[group.dofs[mine[0]], 0] += (group.weights[point] * at.P[point] @ group.grads[point].T).T.ravel()
        du = tangent.answer(np.zeros_like(forces), -forces)
        columns = residual.view.columns(found.experiment.model.mesh.nodes, residual.u[3], du.reshape(-1, 2, 1))
        held = forces + tangent.times(du)
        reaction = tangent.system.body.channels[0]
        direct = p[:, 0] @ columns[residual.evidence.seen, 0]
        direct += 0.7 * reaction.factor * held[np.asarray(reaction.dofs), 0].sum()
        assert adjoint[element] == pytest.approx(direct, rel=1e-8)


def test_band_factor_is_a_root_of_its_matrix():
    rng = np.random.default_rng(8)
    dense = np.diag(np.full(30, 4.0)) + np.diag(np.ones(27), 3) + np.diag(np.ones(27), -3)
    order = rng.permutation(30)
    matrix = sparse.csr_array(dense[order][:, order])
    factor = BandFactor(matrix)
    root = factor.times(np.eye(30))
    assert root @ root.T == pytest.approx(matrix.toarray(), abs=1e-3)  # the jitter: 1e-5 of 4
    x = rng.standard_normal((30, 2))
    assert factor.solve(factor.times(x)) == pytest.approx(x, abs=1e-10)


def test_boundary_freedoms_move_driven_edges_and_nothing_else(clean):
    experiment = clean[0].experiment
    held = np.asarray(clean[0].forward.body.constraints.dofs)
    motion, force = boundary_patterns(experiment.model, held)
    assert motion.shape[1] == 2 * 2 * 4 and not force.any()  # two grips, two components, cubic
    still = np.setdiff1d(np.arange(motion.shape[0]), held)
    assert not motion[still].any() and np.linalg.matrix_rank(motion) == 16


# when -----------------------------------------------------------------------------------------------------------------
def synthetic(rng, start=None, n_frames=20, p=6, size=3.0):
    """A course with one parameter proportional to time, and perhaps a departure growing from `start`."""
    t = np.arange(1.0, n_frames + 1)
    J = t[:, None, None] * np.array([1.0, 0.5, 0.0, 0.0, 0.3, 0.0])[None, :, None]
    e = rng.standard_normal((n_frames, p)) + rng.standard_normal(p) + J[:, :, 0] * 0.4
    if start is not None:
        e += size * np.maximum(t - start, 0.0)[:, None] * np.array([0.0, 0.3, 0.9, -0.3, 0.0, 0.1])
    return MotionRecord(e, J, np.ones(p, dtype=bool), np.ones(n_frames), np.ones(n_frames))


def test_onset_lies_in_its_interval():
    rng = np.random.default_rng(9)
    found = [onset(synthetic(rng, 8.0)) for _ in range(12)]
    inside = [o.interval[0] <= 8.0 <= o.interval[1] for o in found]
    assert sum(inside) >= 9  # 95 % of 12 less two and a half
    assert np.median([abs(o.frame - 8.0) for o in found]) <= 0.75


def test_an_effect_from_the_start_begins_at_the_reference():
    rng = np.random.default_rng(10)
    assert all(onset(synthetic(rng, 0.0)).interval[0] == 0.0 for _ in range(10))


def test_steady_growth_needs_no_corner_and_late_growth_does():
    rng, times = np.random.default_rng(13), np.arange(1.0, 21.0)
    load = np.minimum(times, 9.0) ** 1.5
    grown = synthetic(rng)
    pattern = np.array([0.0, 0.3, 0.9, -0.3, 0.0, 0.1])
    creeping = replace(grown, e=grown.e + 0.15 * np.cumsum(load)[:, None] * pattern)
    assert onset(creeping, followed=load_histories(times, load)).from_start
    assert not onset(synthetic(rng, 8.0, size=6.0), followed=load_histories(times, load)).from_start


def test_parameters_over_growing_windows_stay_where_the_model_holds():
    rng = np.random.default_rng(14)
    held, drifting = synthetic(rng, n_frames=30), synthetic(rng, n_frames=30)
    steps, stds = growing_windows(held)
    assert stds[-1, 0] < stds[3, 0] and np.all(np.abs(steps[:, 0] - 0.4) < 5.0 * stds[:, 0] + 0.3)
    late = np.linspace(0.0, 1.0, 30)[:, None] * drifting.J[:, :, 0]
    moved = growing_windows(replace(drifting, e=drifting.e + late))
    assert moved[0][-1, 0] - moved[0][8, 0] > 5.0 * moved[1][8, 0]


def test_noise_alone_rises_as_chi_square_and_raises_no_alarm():
    rng = np.random.default_rng(11)
    found = [onset(synthetic(rng)) for _ in range(60)]
    p = np.concatenate([stats.chi2.sf(o.innovation, o.rank) for o in found])  # independent from frame to frame
    assert stats.kstest(p, "uniform").pvalue > UNLIKELY
    assert sum(np.isfinite(o.frame) for o in found) <= 1  # nominal 1e-3 each: two of 60 happen once in 600 seeds


def test_constant_parameters_do_not_wander_and_changing_ones_do():
    rng = np.random.default_rng(12)
    steady = [parameter_cusum(synthetic(rng, n_frames=60))[1][0] for _ in range(80)]
    assert np.mean(np.array(steady) < 0.05) <= 0.12  # bridges in steps wander less than continuous ones
    moving = synthetic(rng, n_frames=60)
    grown = replace(moving, e=moving.e + moving.J[:, :, 0] * np.linspace(-1, 1, 60)[:, None])
    assert parameter_cusum(grown)[1][0] < 1e-3


def test_the_margin_forgives_a_motion_of_its_size():
    assert p_beyond_margin(150.0, 50, 100.0) == pytest.approx(0.5, abs=0.05) and p_beyond_margin(150.0, 50, 0.0) < 1e-10
    assert p_beyond_margin(49.0, 50, 0.0) == pytest.approx(stats.chi2.sf(49.0, 50))


def test_a_course_that_stays_at_unloading_follows_the_largest_load():
    times = np.arange(1.0, 16.0)
    load = np.array([1, 2, 3, 4, 5, 4, 3, 2, 1, 3, 5, 6, 7, 8, 9.0])
    amplitude = np.maximum(np.maximum.accumulate(load) - 3.0, 0.0)
    print_ = fingerprint(amplitude, np.full(15, 0.1), times, load, 3.0)
    assert next(iter(print_.shares)) == "the largest load so far above a threshold"
    assert print_.remanence == pytest.approx(1.0)
    assert fingerprint(load, np.full(15, 0.1), times, load, 0.0).words.startswith("The amplitude follows the load")


def test_a_specimen_that_keeps_a_fourth_of_its_load_keeps_nothing_of_an_elastic_mismatch():
    """An offset of the load cell beside it: the amplitude in the last frame is 58 % of the largest."""
    load = np.array([1, 2, 3, 4, 5, 6, 7, 8, 6, 4, 2.0])
    said = fingerprint(load + 6.0, np.full(11, 0.1), np.arange(1.0, 12.0), load, 0.0)
    assert said.remanence == pytest.approx(0.0, abs=1e-12) and said.words.endswith("it goes back at unloading.")


def test_growth_after_the_corner_widens_the_interval():
    """The record did without a corner; the enriched model says when it begins, and the record has no say against it."""
    open_ = SimpleNamespace(is_significant=True, onset_frame=1, onset_ci=(0, 2), onset=SimpleNamespace(from_start=True))
    assert Mismatch.reported_onset(open_, SelectedEffect("bulk", False, 3)) == (3, (0, 3))
    assert Mismatch.reported_onset(open_, SelectedEffect("bulk", False, 1)) == (1, (0, 2))
    unseen = SimpleNamespace(is_significant=True, onset_frame=None, onset_ci=None,
                             onset=SimpleNamespace(from_start=False))
    assert Mismatch.reported_onset(unseen, SelectedEffect("bulk", False, 3)) == (3, (3, 3))


def test_a_slip_begins_where_its_course_does():
    """Error of the mesh before it hides the corner in the growth."""
    early = SimpleNamespace(is_significant=True, onset_frame=0, onset_ci=(0, 9), onset=SimpleNamespace(from_start=True))
    slip = SelectedEffect("boundary", False, course_onset=(13, 14))
    assert Mismatch.reported_onset(early, slip) == (14, (0, 14))
    unseen = SimpleNamespace(is_significant=False, onset_frame=None, onset_ci=None)
    assert Mismatch.reported_onset(unseen, slip) == (14, (13, 14))


def test_two_zones_at_the_sides_of_a_hole_are_two_places():
    mesh = strip_with_hole(10.0, 6.0, 1.0, "quad8", 3, 4, 3, name="BODY")
    centres = element_centres(mesh)
    beside = np.flatnonzero((np.abs(centres[:, 0]) < 0.8) & (np.hypot(*centres.T) < 1.6))
    parts = clusters(mesh, beside)
    assert len(parts) == 2 and {float(np.sign(centres[part, 1].mean())) for part in parts} == {-1.0, 1.0}
    assert np.sort(np.concatenate(parts)) == pytest.approx(beside)


# twins ----------------------------------------------------------------------------------------------------------------
def test_clean_recording_has_no_mismatch(clean):
    mismatch = locate(*clean)
    assert not mismatch.is_significant and mismatch.side == "" and mismatch.elements == ()
    assert all(level.p > UNLIKELY for level in mismatch.nested_tests.levels.values())
    assert all(test.p_value > UNLIKELY for test in mismatch.tests)


def test_inclusion_is_bulk_and_found_within_an_element(tmp_path):
    soft = Side(modulus=lambda x: np.where(np.hypot(x[:, 0] - 2.5, x[:, 1] - 1.2) < 0.9, 0.6, 1.0))
    found = identify(load_experiment(write_folder(tmp_path / "soft", soft)))
    mismatch = locate(found, residual_evidence(found))
    assert mismatch.side == "bulk"
    assert min(t.p_value for t in mismatch.tests if t.name == "whiteness, motion") < UNLIKELY
    assert np.hypot(*np.subtract(mismatch.centroid_mm, (2.5, 1.2))) < 1.0  # mm: an element there is 1.3 mm long


@pytest.mark.slow
@pytest.mark.parametrize(("side", "truth"), [
    ("boundary", Side(motion={("RIGHT", "x"): np.column_stack([0 * GRIP, 0.004 * (GRIP / 0.12)])})),
    ("camera", Side(camera=lambda c, k: c.with_parameters({"pixel_size": c.pixel_size * (1 + 1.5e-4 * k)}))),
    ("force", Side(force=lambda f: f + 15.0 * (np.arange(len(f)) > 0))),
])
def test_every_side_is_told_from_the_others(tmp_path, side, truth):
    found = identify(load_experiment(write_folder(tmp_path / side, truth)))
    assert locate(found, residual_evidence(found)).side == side


@pytest.mark.parametrize("n, width", [(40, 2), (90, 40)])
def test_transposed_solution_solves_the_transposed_system(n, width):
    rng = np.random.default_rng(13)
    dofs = np.array([np.arange(i, i + width) for i in range(n - width + 1)])
    points = np.column_stack([np.arange(n // 2, dtype=float), np.zeros(n // 2)])
    pattern = make_pattern(points, [dofs], np.zeros(0, dtype=int))
    blocks = rng.standard_normal((len(dofs), width, width)) + 3.0 * width * np.eye(width)
    dense = np.zeros((n, n))
    values, places = np.zeros(pattern.n_stored), pattern.positions(dofs)
    for block, where, dof in zip(blocks, places, dofs, strict=True):
        equations = pattern.equation[dof]
        dense[np.ix_(equations, equations)] += block
        np.add.at(values, where[where >= 0], block[where >= 0])
    x = rng.standard_normal((n, 2))
    assert factorise(pattern, values).solve_transposed(dense.T @ x) == pytest.approx(x, abs=1e-9)


def test_a_place_is_told_without_the_rounding_of_its_mean():
    assert in_words((6.94e-17, 1.413)) == "(0, 1.41)" and in_words((0.0, 0.0)) == "(0, 0)"
    assert in_words((0.012, 1281.4), (0.004, 3.0)) == "(0.012 ± 0.004, 1281 ± 3)"
    assert in_words((0.0, -2.78e-17), size=6.0) == "(0, 0)"  # the middle of a body
    assert in_words((3e-6, -2.78e-17), size=2e-5) == "(3e-06, 0)"  # of a small one
