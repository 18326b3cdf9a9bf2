"""The necking strip: ten sensitivities at full size, and all 42 of a spectrum of 17 modes on a coarse mesh."""

import resource

import numpy as np
import pytest
from jobs.bench_jobs import best_of

from idic.fe import march
from idic_studies.examples.polycarbonate_model import (FULL_MESH, REDUCED_MESH, TRUTH, directions, strip_mesh,
                                                       strip_model)

pytestmark = [pytest.mark.bench, pytest.mark.slow]


def spectrum():
    """A regular spectrum of 17 modes, after those measured on polycarbonate."""
    k = np.arange(1, 17)
    modes = np.stack([56.0 * 0.87**k, 3.5e10 * 11.0**-k], axis=1)
    return np.concatenate([list(TRUTH.values())[:8], [350.0, 2e11], modes.ravel()])


def test_ten_sensitivities_of_the_strip_cost_less_than_a_run(measured):
    times = np.arange(0.0, 61.0)
    model, values = strip_model(strip_mesh(FULL_MESH), times), {"strip": np.array(list(TRUTH.values()))}
    plain, direct = best_of([lambda: list(march(model, values, times)),
                             lambda: list(march(model, values, times, directions(model)))], 1)  # fmt: skip
    measured("necking strip, 1440 hex8, 60 frames, 10 exact sensitivities", f"{direct:.1f} s",
             f"one forward run {plain:.1f} s: {direct / plain:.2f} runs (perturbed runs: 11)")  # fmt: skip
    assert direct / plain < 2.5


def test_all_42_sensitivities_of_17_modes(measured):
    times = np.arange(0.0, 201.0, 4.0)
    model, values = strip_model(strip_mesh(REDUCED_MESH), times, "egp_17"), {"strip": spectrum()}
    (direct,) = best_of([lambda: list(march(model, values, times, directions(model)))], 1)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    measured("necking strip, 160 hex8, 17 modes, 50 frames, 42 exact sensitivities", f"{direct:.1f} s",
             f"peak memory {peak:.0f} MB")  # fmt: skip
    assert peak < 2000
