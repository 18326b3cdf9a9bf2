"""What a diagnosis starts from, on height images of a solid."""

from dataclasses import replace

import numpy as np
import pytest
from height_bodies import bent_plate, photographed

from idic.diagnose.locate.freedoms import camera_fields
from idic.diagnose.locate.mismatch import locate
from idic.diagnose import identification_at, residual_evidence
from idic.images import ArrayStack


@pytest.fixture(scope="module")
def plate():
    """Images of the plate, seen by a model that is 3 % too stiff."""
    body = photographed(bent_plate())
    body = replace(body, recording=replace(body.recording, noise=replace(body.recording.noise, std_gv=0.05)))
    wrong = {name: 1.03 * p.value for name, p in body.model.parameters.items() if name.endswith(".C10")}
    assert wrong
    found = identification_at(body, body.model.parameters.as_values() | wrong, np.zeros((body.model.n_frames, 0)), None)
    return found, residual_evidence(found)


def test_a_residual_is_left_by_the_image_made_for_it(plate):
    context = plate[1].context
    r = np.random.default_rng(4).standard_normal(context.reference.pixel_map.n_pixels)
    image, reference = context.reference.synthetic_image(r)
    alone = replace(context.experiment, recording=replace(context.experiment.recording, stack=ArrayStack(image[None])))
    found = reference.compare_pixels(alone, 0, np.zeros((len(context.experiment.model.mesh.nodes), 3)), np.zeros(0))
    assert found.valid.mean() > 0.8
    assert found.r[found.valid] == pytest.approx(r[found.valid], abs=1e-4)


def test_the_null_model_asks_for_the_step_back_to_the_truth(plate):
    """A score test on heights: the stiffness is 3 % too high, to first order."""
    from idic.diagnose import null_model

    found, residual = plate
    null = null_model(residual.evidence, residual.null)
    name = next(n for n in null.names if n.endswith(".C10"))
    step = null.remaining[null.names.index(name)] / found.parameters[name].value
    assert step == pytest.approx(1.0 / 1.03 - 1.0, rel=0.15)


def test_a_profilometer_shifts_turns_and_tilts_its_images(plate):
    assert np.linalg.matrix_rank(camera_fields(plate[1], 0)) == 8


def test_the_mismatch_is_looked_for(plate):
    assert locate(*plate).nested_tests.levels["bulk"].rank > 0
