"""The strength of an effect on grey values: of the pixels that take part in the correlation."""

from dataclasses import replace

import numpy as np
import pytest

from idic_studies.trial.scenes.effects import EFFECTS
from idic_studies.trial.scenes.recording import BACKGROUND_GREY, Paint
from idic_studies.trial.scenes.scene import NULLS, Geometry, plain_scene
from idic_studies.trial.strength import Bench


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    return Bench.of(plain_scene("elastic", Geometry(), NULLS["elastic"].truth), tmp_path_factory.mktemp("bench"),
                    Paint(1, 2))


def test_what_happens_beside_the_specimen_has_no_strength(bench):
    def other_wall(image, k):
        return np.where(np.abs(image - BACKGROUND_GREY) < 0.5, BACKGROUND_GREY + 50.0 * (k > 0), image)

    assert bench.measure(replace(bench.plain, image=other_wall)).seen < 3.0  # over a thousand with the background


def test_a_blur_is_as_strong_as_the_noise_of_the_pixels_allows(bench):
    """Against its score: 1 / std of an amplitude of one, of the same recording without the low-pass of the images."""
    amplitude = 0.05
    scene = EFFECTS["defocus"].change(bench.plain, amplitude, np.random.default_rng(5))
    reference = bench.residual.context.reference
    f, column = reference.f.astype(float), reference.blur_column.astype(float)
    base = np.column_stack([np.ones(len(f)), f])
    alone = column - base @ np.linalg.lstsq(base, column, rcond=None)[0]
    course = np.linspace(0.0, 1.0, len(bench.plain.times))
    expected = amplitude * np.sqrt((alone**2).sum() * (course**2).sum() / (1.76 * 2.0**2))
    assert bench.measure(scene).seen == pytest.approx(expected, rel=0.3)
