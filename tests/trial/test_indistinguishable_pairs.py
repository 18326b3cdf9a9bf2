"""The indistinguishable pairs of the trial: each effect shows on its record, and no record separates the two."""

import numpy as np
import pytest

from idic.diagnose import Columns, null_model, score
from idic_studies.trial.plan import INDISTINGUISHABLE_PAIRS, Campaign, draw, effect_in
from idic_studies.trial.scenes.indistinguishable import STRENGTH_OF
from idic_studies.trial.scenes.recording import Paint, as_logged
from idic_studies.trial.scenes.scene import NULLS, Geometry, plain_scene
from idic_studies.trial.scenes.solve import solve
from idic_studies.trial.strength import CLEAR, Bench
from idic_studies.trial.strengths import strengths

SEEN = 20.0  # standard deviations: without doubt


def scenes(plain, one, other):
    """Both effects at amplitudes at which they are alike, where that matters."""
    amplitudes = [strengths()[STRENGTH_OF.get(name, name)][CLEAR]["amplitude"] for name in (one, other)]
    if one == "creep":  # rate E / 3 G of the Maxwell body, the exponent being 1
        E, nu = plain.values["E"], plain.values["nu"]
        amplitudes[1] = 20.0 * 4e-4 * amplitudes[0] * 1.5 * E / (1.0 + nu) / 30.0
    return [effect_in("twins", name).change(plain, a, np.random.default_rng(5))
            for name, a in zip((one, other), amplitudes, strict=True)]


@pytest.mark.slow
@pytest.mark.parametrize(("one", "other", "null"), INDISTINGUISHABLE_PAIRS)
def test_each_effect_of_a_pair_shows_clearly_and_a_record_cannot_tell_the_two_apart(tmp_path, one, other, null):
    """D = S (1 - rho^2) of their columns below nine, whatever the amplitude of the rival."""
    bench = Bench.of(plain_scene(null, Geometry(), NULLS[null].truth), tmp_path, Paint(1, 2))
    columns = []
    for scene in scenes(bench.plain, one, other):
        motion = solve(scene)
        plain = as_logged(scene, bench.plain, motion)
        before = bench.motion if np.array_equal(plain.grip, bench.plain.grip) else solve(plain)
        columns.append(bench._column(scene, motion, plain, before))
    both = Columns((one, other), np.concatenate([c.fields for c in columns], axis=2),
                   np.concatenate([c.channels for c in columns], axis=2))
    evidence = bench.residual.evidence
    found = score(evidence, null_model(evidence, bench.residual.null), both)
    assert np.sqrt(found.own).min() > SEEN
    assert (found.own * (1.0 - found.correlation[0, 1] ** 2)).max() < 3.0**2  # not told apart


def test_every_pair_is_drawn_in_both_directions():
    drawn = [draw(trial, 3) for trial in Campaign().select(["indistinguishable"])]
    for one, other, _ in INDISTINGUISHABLE_PAIRS:
        kinds = {(truth.names[0], truth.counterpart) for truth in drawn if truth.key.startswith(f"twins/{one}~")}
        assert kinds == {(one, other), (other, one)}
