"""A rival that gains what the model in hand could have gained, and a margin of the bricks that are counted."""

import numpy as np
import pytest

from idic.diagnose.refit import Refit
from idic.diagnose.residual.margin import BRICKS_SHARE, PRACTICAL_MARGIN_PX, Margin
from idic.diagnose.screen.candidate import Variant, candidates
from idic.diagnose.screen.select import Ranked, Screening
from idic.diagnose.selection.imitation import gains_without_its_unknowns
from idic.diagnose.selection.rival import Rival

KNOWN = {candidate.name: candidate for candidate in candidates()}
RADIUS = "geometry.hole_radius"


def smaller_hole(radius: float, std: float | None, achieved: float, absent: float = 3.0) -> tuple[Rival, Screening]:
    variant = Variant("another radius of the hole", {}, (RADIUS,), {RADIUS: absent}, {RADIUS: 3.06})
    ranked = Ranked(KNOWN["hole_geometry"], 0, variant, variant.label, 6.0, 1e-6, 0.2, 0.03, 0.5, 18.0, 3e-4, 0.3,
                    {"PLATE.E": 0.0}, "significant")
    refitted = Refit("hole_geometry", variant.label, "converged", {"PLATE.E": 7e4, RADIUS: radius},
                     {"PLATE.E": 20.0, RADIUS: std}, np.zeros((3, 0)), None, None, None)
    return Rival(ranked, refitted, 18.0, achieved, achieved), Screening((ranked,), (), None)


@pytest.mark.parametrize(("radius", "std", "achieved", "of_the_model"), [
    (2.9957, 0.0027, 29.7, True),  # the recording that showed it: 1.6 standard deviations are no 30 of chi-square
    (2.9957, 0.0027, 5.0, False),  # they are 5
    (2.9700, 0.0027, 124.0, False),  # a smaller hole
    (2.9957, None, 29.7, False)])  # of which nothing is known
def test_a_gain_that_the_unknowns_of_a_rival_cannot_make_is_of_the_model(radius, std, achieved, of_the_model):
    assert gains_without_its_unknowns(*smaller_hole(radius, std, achieved)) is of_the_model


def test_physics_that_is_absent_at_no_finite_value_is_not_compared():
    assert not gains_without_its_unknowns(*smaller_hole(2.9957, 0.0027, 29.7, absent=np.inf))


def test_bricks_that_move_far_widen_the_margin_and_others_do_not():
    assert Margin(bricks_px=BRICKS_SHARE * 0.01).px == Margin().px == PRACTICAL_MARGIN_PX
    wide = Margin(bricks_px=BRICKS_SHARE * 0.20)
    assert wide.px == wide.smallest_effect_px == wide.inclusion_px == pytest.approx(0.008)
