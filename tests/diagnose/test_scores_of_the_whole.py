"""Scores are of the whole recording; refits see one copy, and what is promised is of that."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from test_revision import chosen, sets

from idic.diagnose.candidates import defocus
from idic.diagnose import NO_CAUSE, candidate_library, diagnose, residual_evidence
from idic.diagnose.residual.thinning import drop_on_copy
from idic.diagnose.screen.situation import situation
from idic.diagnose.selection.rival import causes_of
from idic.identification import identify
from idic.images import ArrayStack
from idic.model import CorrelatedNoise
from idic.run import SerialRunner, run_refits
from idic_studies.trial.kinds import LIBRARY
from idic_studies.trial.scenes.recording import IMAGES, Paint, write_public
from idic_studies.trial.scenes.scene import NULLS
from idic_studies.trial.scenes.solve import solve
from idic_studies.trial.scenes.worlds import world_scene
from idic_studies.trial.strength import FAINT, SEEN_OF
from idic_studies.trial.tool_run import FolderSource
from idic_studies.trial.world_strength import amplitude_in

WORLD = {"specimen": "hole", "columns": 132, "frames": 16, "programme": "hold", "thickness": 1.0, "solid": False,
         "finite": False, "noise": "white"}
TRUE = NULLS["elastic"].truth


def recorded(folder, scene):
    """Recording of a scene, and its identification."""
    write_public(folder, scene, solve(scene), Paint(5, 6))
    source = FolderSource.of(folder, ArrayStack(np.load(folder / IMAGES, allow_pickle=False)))
    return source, identify(source.load())


def screening_of(folder, scene, name):
    """First screening of one candidate on a recording of a scene, and the noise of what it looked at."""
    (source, found), seen = recorded(folder, scene), []
    diagnosis = diagnose(source, found, partial(run_refits, SerialRunner(), None), quick=True,
                         library=[one for one in candidate_library() if one.name == name],
                         watch=lambda residual, *_: seen.append(residual.context.experiment))
    return diagnosis.rounds[0].screening.of(name), seen[0].recording.noise.std_gv / source.load().recording.noise.std_gv


def test_a_candidate_is_scored_on_the_recording_and_promises_what_a_copy_can_show(tmp_path):
    ranked, noise = screening_of(tmp_path, world_scene(WORLD, "elastic", 1.0, TRUE), "machine_compliance")
    assert noise == pytest.approx(1.0)  # of a copy 1.41
    z = ranked.amplitude / ranked.std
    assert ranked.gain == pytest.approx(drop_on_copy(z**2, 1), rel=1e-6) and drop_on_copy(z**2, 1) < max(z**2, 1.0)


@pytest.mark.slow  # 30 s of CPU time
@pytest.mark.parametrize("columns", [132, 264])
def test_a_faint_creep_has_its_eight_standard_deviations_in_images_of_any_size(columns, tmp_path):
    """Load cells see it, and they do not grow with the images: scaled from small images it was four times too weak."""
    world = WORLD | {"columns": columns}
    amplitude, _ = amplitude_in(world, "elastic", TRUE, LIBRARY["creep"], FAINT)
    scene = LIBRARY["creep"].change(world_scene(world, "elastic", 1.0, TRUE), amplitude, np.random.default_rng(5))
    ranked, _ = screening_of(tmp_path, scene, "creep")
    assert abs(ranked.statistic - SEEN_OF[FAINT]) < 3.0  # noise is one, an amplitude is met within a tenth to a third


def test_what_joins_finite_strains_first_is_no_further_cause():
    sizes = sets(((), 500.0), ((NO_CAUSE,), 100.0), ((NO_CAUSE, "grip_slip"), 10.0))
    rounds = chosen((NO_CAUSE, "grip_slip"), sizes)
    assert [one.winner.name for one in causes_of(rounds)] == ["grip_slip"]
    assert causes_of([*rounds[:1], replace(rounds[1], winner=None)]) == []


@pytest.mark.parametrize(("beside", "least"), [(None, defocus.MIN_BLUR_OF_WHITE_PX2),
                                               (0.02, defocus.MIN_BLUR_OF_WHITE_PX2), (0.3, defocus.MIN_BLUR_PX2)])
def test_a_blur_that_a_camera_makes_itself_is_larger_where_the_noise_is_correlated(beside, least, still_situation):
    found = None if beside is None else CorrelatedNoise(2.0, 2.0, ((0.0, beside, 0.0), (beside, 1.0, beside),
                                                                  (0.0, beside, 0.0)), 1.0)
    experiment = still_situation.experiment
    recording = replace(experiment.recording, noise=replace(experiment.recording.noise, correlated=found))
    there = replace(still_situation, experiment=replace(experiment, recording=recording))
    assert {variant.least for variant in defocus.variants(there)} == {least}


@pytest.fixture(scope="module")
def still_situation(tmp_path_factory):
    source, found = recorded(tmp_path_factory.mktemp("still"), world_scene(WORLD, "elastic", 1.0, TRUE))
    return situation(found, residual_evidence(found), source.document())
