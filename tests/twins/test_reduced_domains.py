"""A reduced domain with a virtual boundary gives the material of the whole specimen; see docs/virtual-boundaries.md."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parent))

from reduced_domains import TRUTH, clean_images, user_mesh, write_case  # noqa: E402
from virtual_boundary_study import one_draw  # noqa: E402

from idic.experiment_file import load_experiment  # noqa: E402

DRAWS = 3


def mean_of_draws(folder, case, route):
    """Mean value and its standard deviation, per parameter, over draws of all noise  # (2, n)"""
    experiment = load_experiment(write_case(folder / route, case, route, clean_images(case)))
    draws = [one_draw(experiment, clean_images(case), seed) for seed in range(DRAWS)]
    assert all(draw["status"] == "converged" for draw in draws)
    assert max(draw["iterations"] for draw in draws) <= 4  # as the whole specimen, which takes 3
    values, stds = np.array([[draw[name] for name in TRUTH] for draw in draws]).transpose(2, 0, 1)
    return values.mean(axis=0), np.sqrt((stds**2).sum(axis=0)) / DRAWS


@pytest.mark.slow
@pytest.mark.parametrize("case", ["strip", "plate"])
def test_a_quarter_of_the_elements_and_a_virtual_boundary_find_the_same_material(case, tmp_path):
    assert user_mesh(case, False).n_elements <= user_mesh(case, True).n_elements / 4
    whole, whole_std = mean_of_draws(tmp_path, case, "full")
    for route in ("bspline", "dic"):
        found, std = mean_of_draws(tmp_path, case, route)
        assert np.all(np.abs(found - whole) < 2.0 * np.hypot(std, whole_std)), (route, found, whole, std)
