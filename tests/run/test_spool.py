"""Sums of generalised least squares on disk: the same bits, and memory that does not grow with the frames."""

from dataclasses import fields, replace

import numpy as np

from idic.correlation import CorrelationSystem, FrameRecord, LocalEquations, OpenSums, Weights, reduce_systems
from idic.correlation import shared_noise
from idic.correlation.shared_noise import close
from idic.correlation.image_equations.system import SharedSums
from idic.run import spool
from idic.run.spool import open_spool

N, K, SHARED = 2, 3, 40


def part(rng, first, frames=2):
    """The sums of some frames, of random columns."""
    def local():
        L, seen = rng.normal(size=(SHARED, K)), rng.normal(size=(K, K))
        return LocalEquations(L.T @ L + seen @ seen.T, rng.normal(size=(K, N)), rng.normal(size=K), L.T @ L,
                              rng.normal(size=(K, N)), L, -L, np.ones(SHARED), np.zeros((0, K)), np.zeros((0, N)))

    S = rng.normal(size=(SHARED, N))
    sums = OpenSums(rng.normal(size=SHARED), S, -S, -S, np.full(SHARED, float(frames)), np.full(SHARED, float(frames)),
                    S.T @ S, rng.normal(size=N), S.T @ S, tuple(local() for _ in range(frames)))
    records = tuple(FrameRecord(first + k, 1, 0, 1.0, np.zeros(0), np.zeros(K - 1), np.zeros((K - 1, N)), np.zeros(1),
                                np.zeros((1, 4)), np.zeros((0, N))) for k in range(frames))
    return CorrelationSystem(("a", "b"), S.T @ S, np.ones(N), 1.0, 1.0, np.eye(N), np.zeros((SHARED, N)), records, sums)


def closed(parts):
    weights = Weights(1.0, 1.0, np.zeros(0), np.zeros(0)).as_generalised()
    return close(reduce_systems(parts), weights, 1, lambda columns: columns.T @ columns)[0]


def test_sums_on_disk_give_the_same_bits_and_leave_no_file(tmp_path, monkeypatch):
    rng = np.random.default_rng(0)
    parts = [part(rng, 2 * k) for k in range(3)]
    monkeypatch.setattr(spool, "MIN_BYTES", 0)
    for most in (6000, 0):
        monkeypatch.setattr(shared_noise, "MAX_DENSE_UNKNOWNS", most)
        expected = closed(parts)
        with open_spool(tmp_path) as kept:
            stored = [kept.kept(one) for one in parts]
            assert isinstance(stored[1].sums.frames[1].product.base, np.memmap)
            found = closed(stored)
        for name in ("M", "b", "spread"):
            assert np.array_equal(getattr(found, name), getattr(expected, name))
        assert list(tmp_path.iterdir()) == []


def test_little_stays_in_memory(tmp_path):
    one = part(np.random.default_rng(0), 0)
    with open_spool(tmp_path) as kept:
        assert kept.kept(one) is one
        shared = SharedSums(*(np.zeros(SHARED) for _ in fields(SharedSums)))  # of ordinary least squares
        for sums in (None, shared):
            plain = replace(one, sums=sums)
            assert kept.kept(plain) is plain
