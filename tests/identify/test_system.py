"""Elimination, sums and covariance against dense linear algebra and against repeated noise."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from idic.correlation.image_equations.equations import BasisEquations, ChannelEquations
from idic.correlation import (
    CorrelationSystem, eliminate, FrameEquations, ordinary_variance, reduce_systems, shared_noise, Weights,
)
from idic.correlation.shared_noise import close
from idic.identification import scaled_system
from idic.parameters import Parameter, ParameterSet

N, M, NB, PIXELS, CHANNELS = 3, 2, 2, 60, 1
SIGMA, SIGMA_F, SIGMA_W = 0.3, 0.2, 0.5
WEIGHTS = Weights(1 / (2 * SIGMA**2), SIGMA, np.array([1 / SIGMA_F**2]), np.array([SIGMA_F]))
NAMES = ("a", "b", "c")


def _design(rng):
    """Columns of one frame: pixels x (global, local, brightness), channels x (global, local)."""
    return rng.normal(size=(PIXELS, N + M + NB)), rng.normal(size=(CHANNELS, N + M))


def _rows(columns, channel, r, rho, local):
    return FrameEquations(
        gram=columns.T @ columns, rhs=columns.T @ r, rr=r @ r, shared=columns,  # the pixels serve as reference basis
        kappa=1.0, channels=ChannelEquations(rho, channel[:, :N], channel[:, N:]),
        local_precision=np.eye(M) / SIGMA_W**2, local_gap=-local)


def test_elimination_solves_the_same_least_squares_problem_as_all_unknowns_at_once():
    rng = np.random.default_rng(1)
    frames = []
    rows, right = [], []
    for k in range(4):
        columns, channel = _design(rng)
        r, rho, local = rng.normal(size=PIXELS), rng.normal(size=CHANNELS), rng.normal(size=M) * 0.1
        frames.append(eliminate(k, NAMES, _rows(columns, channel, r, rho, local), WEIGHTS, PIXELS, 0))
        wide = np.zeros((PIXELS + CHANNELS + M, N + 4 * (M + NB)))
        first = N + k * (M + NB)
        wide[:PIXELS, :N], wide[:PIXELS, first:first + M + NB] = columns[:, :N], columns[:, N:]
        wide[PIXELS:PIXELS + CHANNELS, :N] = channel[:, :N]
        wide[PIXELS:PIXELS + CHANNELS, first:first + M] = channel[:, N:]
        wide[PIXELS + CHANNELS:, first:first + M] = np.eye(M)
        weight = np.sqrt(np.concatenate([np.full(PIXELS, WEIGHTS.image), WEIGHTS.channels, np.full(M, SIGMA_W**-2)]))
        rows.append(weight[:, None] * wide)
        right.append(weight * np.concatenate([r, rho, -local]))
    system = reduce_systems(frames)
    solution, residual, *_ = np.linalg.lstsq(np.vstack(rows), np.concatenate(right), rcond=None)
    step = np.linalg.solve(system.M, system.b)
    assert np.allclose(step, solution[:N], rtol=1e-8)  # rounding, and the 1e-11 hold on the pivots
    assert np.isclose(system.phi - system.b @ step, residual[0], rtol=1e-8)
    for k, record in enumerate(system.frames):
        first = N + k * (M + NB)
        assert np.allclose(record.local_step + record.local_slope @ step, solution[first:first + M], rtol=1e-6)


def test_a_frame_tells_how_much_of_an_error_of_a_reading_its_residual_keeps():
    rng = np.random.default_rng(11)
    columns, channel = _design(rng)
    r, local = rng.normal(size=PIXELS), np.zeros(M)
    rho, more = np.ones(CHANNELS), np.full(CHANNELS, 0.7)
    one, other = (eliminate(0, NAMES, _rows(columns, channel, r, own, local), WEIGHTS, PIXELS, 0).frames[0]
                  for own in (rho, rho + more))
    assert np.allclose(other.channel_residual - one.channel_residual, one.channel_kept * more, rtol=1e-9)
    assert 0.0 < one.channel_kept[0] < 0.999


def test_a_frame_without_local_unknowns_needs_no_elimination():
    rng = np.random.default_rng(2)
    columns, r = rng.normal(size=(PIXELS, N)), rng.normal(size=PIXELS)
    rows = FrameEquations(columns.T @ columns, columns.T @ r, r @ r, columns, 1.0,
                     ChannelEquations(np.zeros(0), np.zeros((0, N)), np.zeros((0, 0))), np.zeros((0, 0)), np.zeros(0))
    weights = Weights(1.0, 1.0, np.zeros(0), np.zeros(0))
    system = eliminate(0, NAMES, rows, weights, PIXELS, 0)
    assert np.array_equal(system.M, columns.T @ columns) and np.array_equal(system.b, columns.T @ r)


def test_restricting_to_free_names_keeps_their_rows():
    rng = np.random.default_rng(3)
    columns, channel = _design(rng)
    system = eliminate(0, NAMES, _rows(columns, channel, rng.normal(size=PIXELS), np.ones(1), np.zeros(M)), WEIGHTS,
                       PIXELS, 0)
    part = system.restrict(["c", "a"])
    assert part.M[0, 1] == system.M[2, 0] and part.b[1] == system.b[0]


@dataclass(frozen=True)
class _Repeated:
    """Estimates over many draws of the noise, and what one system says of them."""

    estimates: np.ndarray  # (draws, N)
    system: CorrelationSystem
    predicted: np.ndarray  # (N,) standard deviations

    @property
    def scatter(self):
        return np.std(self.estimates, axis=0)


def _closed(weights, system, n_images=1):
    """The pixels themselves are the reference's basis: its Gram matrix is the unit matrix."""
    return close(system, weights, n_images, lambda columns: columns.T @ columns)


def _pixel_basis(columns, r):
    """The pixels themselves as the basis: what a frame says in it are its own columns and residual."""
    return BasisEquations(r, columns, np.ones(len(r)), np.ones(len(r)))


def _repeated(frames, generalised, n_reference=1, draws=1000):
    rng = np.random.default_rng(4)
    base = rng.normal(size=(PIXELS, N + M + NB))
    designs = [(base * (1 + k) / frames, rng.normal(size=(CHANNELS, N + M))) for k in range(frames)]
    weights = replace(WEIGHTS, image=1.0 / (ordinary_variance(n_reference) * SIGMA**2))
    weights = weights.as_generalised() if generalised else weights
    estimates = []
    for _ in range(draws):
        reference = rng.normal(size=PIXELS) * SIGMA / np.sqrt(n_reference)
        parts = []
        for k, (columns, channel) in enumerate(designs):
            r = reference - rng.normal(size=PIXELS) * SIGMA
            local = rng.normal(size=M) * SIGMA_W  # the logged value is off by this; its prior mean is zero
            r = r + columns[:, N:N + M] @ local
            rho = rng.normal(size=CHANNELS) * SIGMA_F + channel[:, N:] @ local
            rows = replace(_rows(columns, channel, r, rho, np.zeros(M)), basis=_pixel_basis(columns, r))
            parts.append(eliminate(k, NAMES, rows, weights, PIXELS, 0))
        system, gram = _closed(weights, reduce_systems(parts), n_reference)
        estimates.append(np.linalg.solve(system.M, system.b))
    scaled = scaled_system(system, ParameterSet(Parameter(name, 1.0, free=True) for name in NAMES), gram, SIGMA)
    return _Repeated(np.array(estimates), system, np.sqrt(np.diagonal(scaled.covariance(scaled.spectrum()))))


@pytest.mark.parametrize(("frames", "n_reference", "generalised"), [
    (1, 1, True), (12, 5, True), *(pytest.param(*case, marks=pytest.mark.slow) for case in (
        (1, 1, False), (12, 1, False), (12, 1, True), (12, 5, False)))])
def test_standard_deviations_hold_over_repeated_noise_with_a_shared_reference(frames, n_reference, generalised):
    """1000 draws: a standard deviation is then known to 2.2 %; 8 % is more than three of those."""
    found = _repeated(frames, generalised, n_reference)
    assert np.allclose(found.scatter, found.predicted, rtol=0.08)
    if frames > 1 and not generalised:  # what the naive covariance would have claimed is far too small
        naive = np.sqrt(np.diagonal(np.linalg.inv(found.system.M)))
        assert np.all(naive < 0.8 * found.predicted)


@pytest.mark.slow  # 6 s of CPU time
def test_generalised_least_squares_scatter_less_and_as_ordinary_ones_predicted():
    """20 frames of a ramp: less than half of the scatter (0.41 to 0.50, known to 4 % from 300 draws), since the slope
    over time tells pattern noise from motion."""
    ordinary, generalised = _repeated(20, False, draws=300), _repeated(20, True, draws=300)
    assert np.all(generalised.scatter < 0.6 * ordinary.scatter)
    expected = np.sqrt(np.diagonal(np.linalg.inv(ordinary.system.predicted)))
    # local unknowns with a prior are taken out with the weights of the system at hand: a few percent
    assert np.allclose(expected, generalised.predicted, rtol=0.05)


@pytest.mark.parametrize("lost", [0.0, 0.3], ids=["all pixels", "30 % lost here and there"])
def test_generalised_least_squares_are_the_best_there_are(lost):
    """Against the inverse of the whole covariance of all residuals, without local unknowns (Gauss and Markov)."""
    rng, frames = np.random.default_rng(6), 5
    weights = replace(WEIGHTS, channels=np.zeros(0), channel_noise=np.zeros(0)).as_generalised()
    parts, designs, residuals, where = [], [], [], []
    for k in range(frames):
        seen = rng.random(PIXELS) >= lost
        L, r = seen[:, None] * rng.normal(size=(PIXELS, N)) * (1 + k), seen * rng.normal(size=PIXELS)
        rows = FrameEquations(L.T @ L, L.T @ r, r @ r, L, 1.0,
                         ChannelEquations(np.zeros(0), np.zeros((0, N)), np.zeros((0, 0))), np.zeros((0, 0)),
                         np.zeros(0),
                         basis=BasisEquations(r, L, seen.astype(float), np.ones(PIXELS)))
        parts.append(eliminate(k, NAMES, rows, weights, PIXELS, 0))
        designs.append(L[seen])
        residuals.append(r[seen])
        where.append(np.flatnonzero(seen))
    system, gram = _closed(weights, reduce_systems(parts))
    pixel = np.concatenate(where)
    inverse = np.linalg.inv(SIGMA**2 * (np.eye(len(pixel)) + (pixel[:, None] == pixel[None])))
    L, r = np.vstack(designs), np.concatenate(residuals)
    assert np.allclose(system.M, L.T @ inverse @ L, rtol=1e-10)  # rounding
    assert np.allclose(system.b, L.T @ inverse @ r, rtol=1e-10, atol=1e-10 * np.abs(L.T @ r).max())
    assert np.allclose(system.spread + SIGMA**2 * gram, system.M, rtol=1e-10)


@pytest.mark.parametrize("lost", [0.0, 0.3], ids=["all pixels", "30 % lost here and there"])
@pytest.mark.parametrize("most", [6000, 0], ids=["in one matrix", "frame by frame"])
def test_generalised_least_squares_with_unknowns_of_every_frame_solve_for_the_pattern_too(lost, most, monkeypatch):
    """Against one dense problem in everything: parameters, grip noise and brightness of each frame, every pixel of the
    pattern. Grips that the channel and a prior see too, and columns that differ from frame to frame."""
    monkeypatch.setattr(shared_noise, "MAX_DENSE_UNKNOWNS", most)
    rng, frames = np.random.default_rng(8), 5
    weights, local_size = WEIGHTS.as_generalised(), M + NB
    size = N + frames * local_size + PIXELS
    parts, rows, right = [], [np.hstack([np.zeros((PIXELS, size - PIXELS)),
                                         np.eye(PIXELS) / SIGMA])], [np.zeros(PIXELS)]
    for k in range(frames):
        seen = rng.random(PIXELS) >= lost
        columns, channel = _design(rng)
        columns = seen[:, None] * columns * (1 + k)
        r, rho, local = seen * rng.normal(size=PIXELS), rng.normal(size=CHANNELS), rng.normal(size=M) * 0.1
        basis = BasisEquations(r, columns, seen.astype(float), np.ones(PIXELS))
        parts.append(eliminate(k, NAMES, replace(_rows(columns, channel, r, rho, local), basis=basis), weights, PIXELS,
                               0))
        wide, first = np.zeros((PIXELS + CHANNELS + M, size)), N + k * local_size
        wide[:PIXELS, :N], wide[:PIXELS, first:first + local_size] = columns[:, :N], columns[:, N:]
        wide[:PIXELS, size - PIXELS:] = np.diag(seen.astype(float))
        wide[PIXELS:PIXELS + CHANNELS, :N] = channel[:, :N]
        wide[PIXELS:PIXELS + CHANNELS, first:first + M] = channel[:, N:]
        wide[PIXELS + CHANNELS:, first:first + M] = np.eye(M)
        scale = np.concatenate([np.full(PIXELS, 1 / SIGMA), np.full(CHANNELS, 1 / SIGMA_F), np.full(M, 1 / SIGMA_W)])
        rows.append(scale[:, None] * wide)
        right.append(scale * np.concatenate([r, rho, -local]))
    dense, values = np.vstack(rows), np.concatenate(right)
    everything = np.linalg.solve(dense.T @ dense, dense.T @ values)
    covariances = np.linalg.inv(dense.T @ dense)[:N, :N]
    system, gram = _closed(weights, reduce_systems(parts))
    step = np.linalg.solve(system.M, system.b)
    assert np.allclose(step, everything[:N], rtol=1e-8)  # rounding, and the 1e-11 hold on the pivots
    assert np.allclose(np.linalg.inv(system.M), covariances, rtol=1e-8)
    assert np.allclose(system.spread + SIGMA**2 * gram, system.M, rtol=1e-8)
    for k, record in enumerate(system.frames):
        first = N + k * local_size
        assert np.allclose(record.local_step + record.local_slope @ step, everything[first:first + M], rtol=1e-6)
        assert len(record.brightness) == NB
    # the residuals of the channels, and the information of everything but the channels
    at = [PIXELS + k * (PIXELS + CHANNELS + M) + PIXELS for k in range(frames)]
    left = [SIGMA_F * (values - dense @ everything)[row] for row in at]
    columns = np.array([record.channel_columns[0] for record in system.frames])
    residual = np.array([record.channel_residual[0] for record in system.frames])
    assert np.allclose(residual - columns @ step, left, rtol=1e-6, atol=1e-8)
    others = np.delete(dense, at, axis=0)
    without = np.linalg.inv(np.linalg.inv(others.T @ others)[:N, :N])
    given_back = np.linalg.solve(system.retention_of(0), columns)
    assert np.allclose(system.M - columns.T @ given_back / SIGMA_F**2, without, rtol=1e-6, atol=1e-8 * without.max())


def test_a_direction_that_the_data_leave_open_is_not_determined_and_not_stepped_along():
    from idic.identification.step.proposal import propose

    columns = np.random.default_rng(5).normal(size=(PIXELS, 2))
    columns = np.column_stack([columns[:, 0], -columns[:, 0], columns[:, 1]])  # only a - b is seen
    r = columns @ np.array([0.05, 0.0, 0.1])
    rows = FrameEquations(columns.T @ columns, columns.T @ r, r @ r, columns, 1.0,
                     ChannelEquations(np.zeros(0), np.zeros((0, N)), np.zeros((0, 0))), np.zeros((0, 0)), np.zeros(0))
    weights = Weights(1 / (2 * 1e-4), 1e-2, np.zeros(0), np.zeros(0))
    system = eliminate(0, NAMES, rows, weights, PIXELS, 0)
    parameters = ParameterSet(Parameter(name, 2.0, free=True, transform="log") for name in NAMES)
    scaled = scaled_system(system, parameters, system.shared.T @ system.shared, 1e-2)
    found = scaled.spectrum()
    assert found.determined.sum() == 2
    stds = np.sqrt(np.diagonal(scaled.covariance(found)))
    step = propose(scaled, found, stds, parameters, 0.0)
    assert np.isclose(step.delta[0] + step.delta[1], 0.0, atol=1e-9)  # along the open direction nothing happens
    assert np.isclose(step.delta[0] - step.delta[1], 0.05 / 2.0, rtol=1e-6)
    assert np.isclose(step.delta[2], 0.1 / 2.0, rtol=1e-6)


def test_what_only_a_prior_knows_is_determined_and_counts_in_what_depends_on_it():
    """The data show ln a + 0.2 g alone; the prior of g is wider than its scale."""
    seen = np.array([1.0, 0.2]) / 1e-3
    M = np.outer(seen, seen)
    system = CorrelationSystem(("a", "g"), M, np.zeros(2), 0.0, 0.0, M, np.zeros((0, 2)), ())
    parameters = ParameterSet((Parameter("a", 1.0, free=True, transform="log"),
                               Parameter("g", 0.3, free=True, scale=0.2, prior_mean=0.0, prior_std=0.5)))
    scaled = scaled_system(system, parameters, np.zeros((2, 2)), 1.0)
    found = scaled.spectrum()
    assert found.determined.all()
    stds = np.sqrt(np.diagonal(scaled.covariance(found))) * scaled.slopes
    np.testing.assert_allclose(stds, [0.1, 0.5], rtol=1e-3)
    np.testing.assert_allclose(found.inverse @ scaled.b * scaled.slopes, [0.06, -0.3], rtol=1e-3)
