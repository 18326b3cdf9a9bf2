"""The planned tests on the polycarbonate strip: folders that `idic design` reads, a round notch, what they tell."""

import numpy as np
import pytest

from idic.errors import InputError
from idic.identification import Plan
from idic.run import write_design
from idic.virtual_tests import write_example
from idic_studies.examples.polycarbonate_model import REDUCED_MESH, strip_mesh
from idic_studies.examples.polycarbonate_plans import NOTCH_DEPTH, NOTCH_RADIUS, PLANS, notched


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_example("polycarbonate-plans", tmp_path_factory.mktemp("plans") / "out", reduced=True)


@pytest.mark.parametrize("plan", PLANS, ids=lambda plan: plan.name)
def test_every_plan_is_a_folder_that_can_be_read(folder, plan):
    experiment = Plan.of(folder / plan.name).experiment
    (grip,) = [entry.drive.values for entry in experiment.model.prescribed if hasattr(entry.drive, "column")]
    assert grip[-1] == pytest.approx(10.0) and experiment.model.n_frames == 51
    assert experiment.model.times[-1] == pytest.approx(plan.course[-1][0])
    assert len(experiment.model.parameters.free) == 10 and experiment.model.parameters["strip.mu"].value == 0.08


def test_the_notch_is_a_part_of_a_circle_and_as_deep_as_it_should_be():
    plain, mesh = strip_mesh(REDUCED_MESH), notched(strip_mesh(REDUCED_MESH))
    edge = np.isclose(plain.nodes[:, 1], plain.nodes[:, 1].max(), atol=0.5) & (plain.nodes[:, 0] < 3.0)
    missing = (plain.nodes - mesh.nodes)[edge, 1] / (plain.nodes[edge, 1] / 10.5)
    x = plain.nodes[edge, 0]
    np.testing.assert_allclose(missing, np.sqrt(NOTCH_RADIUS**2 - x**2) - (NOTCH_RADIUS - NOTCH_DEPTH), atol=1e-9)
    assert missing.max() == pytest.approx(NOTCH_DEPTH)


def test_plans_are_not_written_over_something(folder):
    with pytest.raises(InputError, match="not empty"):
        write_example("polycarbonate-plans", folder)


@pytest.mark.slow  # 40 s
def test_compression_before_tension_tells_more_of_the_pressure_dependence_and_the_viscosity(folder, tmp_path):
    """Two signs of the pressure at like shear: mu by a third better, and eta0."""
    content = write_design([folder / "published", folder / "compressed-first"], tmp_path / "design", workers=0)
    std = {name: entry["std"] for name, entry in content["comparison"]["parameters"].items()}
    assert std["strip.mu"]["compressed-first"] < 0.75 * std["strip.mu"]["published"]
    assert std["strip.eta0"]["compressed-first"] < 0.85 * std["strip.eta0"]["published"]
