"""`idic check` takes what `idic init` writes for measured fields; two hundred specimens are drawn by
``python -m idic_studies.evidence.drawn_specimens 200``."""

from __future__ import annotations

import numpy as np
import pytest

from idic.readers import Drawing, PointOutline
from idic_studies.evidence.drawn_specimens import points_on, refusal, specimen


@pytest.mark.parametrize(("kind", "seed"), [("shear", 14), ("butterfly", 16), ("holes", 18)])
def test_what_init_writes_passes_the_check(kind, seed):
    assert refusal(kind, seed) == ""


@pytest.mark.parametrize("kind", ["waisted", "notched", "shear", "slots", "butterfly", "holes", "angle", "cross"])
def test_an_outline_of_points_is_meshed_and_has_the_same_corners_in_shifted_axes(kind):
    for seed in range(4):
        rng = np.random.default_rng([seed, len(kind)])
        at = points_on(*specimen(kind, rng), rng)
        pitch = float(np.median(np.sort(np.hypot(*(at[:200, None] - at[None]).transpose(2, 0, 1)), axis=1)[:, 1]))
        outline = PointOutline.around(at, pitch, 0.5 * pitch)
        mesh = Drawing(outline.outline.tolist(), [hole.tolist() for hole in outline.holes], 3.0 * pitch, True,
                       outline.ends).mesh()
        assert mesh.n_elements > 10
        again = PointOutline.around(at * (1.0 + 1e-13) + 1e-12, pitch, 0.5 * pitch)
        assert [len(loop) for loop in (again.outline, *again.holes)] == [
            len(loop) for loop in (outline.outline, *outline.holes)]
