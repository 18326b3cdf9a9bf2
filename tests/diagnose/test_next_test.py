"""Continuations of a test: what two models show alike so far, and where they part."""

from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from side_twins import TOML, Side, write_folder

from idic.diagnose import Margin, candidate_library, identification_at, residual_evidence
from idic.diagnose.caution_texts import cautions
from idic.diagnose.next_test import (
    MIN_SEPARATING_CHI2,
    _shown,
    Continuation,
    SeparatedModel,
    Separation,
    continued,
    menu,
    recommended,
    separation_chi2,
    separations,
    unloads,
    reason_against_continuation,
)
from idic.diagnose.screen.situation import situation
from idic.experiment_file import load_experiment, read_toml
from idic.identification import identify
from idic.model import (
    Controlled, Load, Temperature, TemperatureField, build_forward, knot_name, nodal_temperature, shown_value,
)
from idic.model.load_train import way_of
from idic_studies.trial.tool_run import FolderSource
from idic_studies.trial.scenes.recording import Paint, write_public
from idic_studies.trial.scenes.scene import NULLS, Geometry, plain_scene
from idic_studies.trial.scenes.solve import solve

SLIP = 0.004  # mm at the end of the test
LENS_PX = 60.0  # in the corner of the image: a lens that takes the ends of the specimen out of it
SIDES = {"boundary": "slip", "camera": "lens", "force": "offset", "bulk": "orthotropy"}


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """A machine that yields by so much at the largest force, a grip that slips by as much, on a test at even speed."""
    folder = tmp_path_factory.mktemp("ramp")
    scene = plain_scene("ramp", Geometry(), NULLS["ramp"].truth)
    source = FolderSource.of(folder, write_public(folder, scene, solve(scene), Paint(3, 4)))
    found = identify(source.load())
    here = situation(found, residual_evidence(found), read_toml(folder / "experiment.toml"))
    known = {c.name: c for c in candidate_library()}
    slip = next(v for v in known["grip_slip"].variants(here) if v.label.startswith("RIGHT slips slowly along x from 0"))
    compliance = next(v for v in known["machine_compliance"].variants(here) if v.new[0].startswith("boundary.RIGHT.x"))
    force = float(np.abs(found.experiment.model.channels[0].values).max())
    moves, lens, offset, stiff = (known[name].variants(here)[0] for name in
                                  ("camera_motion", "lens_distortion", "force_offset", "orthotropy"))
    half = 0.5 * float(np.hypot(*found.experiment.recording.stack.shape))
    made = []
    for name, edits, values in (("slip", slip.edits, {slip.new[0]: SLIP}),
                                ("compliance", compliance.edits, {compliance.new[0]: SLIP / force}),
                                ("moving", slip.edits | moves.edits, {slip.new[0]: SLIP}),
                                ("lens", lens.edits, {lens.new[0]: LENS_PX / half**3}),
                                ("offset", offset.edits, {offset.new[0]: 0.05 * force}),
                                ("orthotropy", stiff.edits, {**stiff.null, **stiff.probe})):
        loaded = source.load(edits)
        fitted = {n: v for n, v in found.parameters.as_values().items() if n in loaded.model.parameters}
        start = loaded.model.parameters.as_values() | fitted | values
        there = identification_at(loaded, start, found.local, None)
        made.append(SeparatedModel(name, there, residual_evidence(there)))
    return made


def test_models_part_where_the_load_goes_down_and_not_before(models):
    D = {t.words: t.D for t in separations(*models[:2])}
    assert D["hold the last motion for as long as the test lasted"] < 9.0  # the force says as much as the time so far
    assert D["unload to zero once"] > MIN_SEPARATING_CHI2
    assert recommended(separations(*models[:2])).words == "unload to zero once"


def test_a_camera_that_moves_from_frame_to_frame_stays_where_it_was_in_the_last_one(models):
    slip, _, moving, *_ = models
    assert moving.identification.experiment.model.camera.motion is not None
    found = separations(slip, moving)
    assert len(found) == len(separations(*models[:2]))
    assert all(t.D < 1e-6 for t in found)  # it has not moved: both are the same model
    motion = continued(moving.identification.experiment, Continuation("", (1.0, 0.5), (0.1, 0.2))).model.camera.motion
    np.testing.assert_array_equal(motion.courses[:, -2:],
                                  np.repeat(moving.identification.experiment.model.camera.motion.courses[:, -1:],
                                                                    2, axis=1))


@pytest.mark.parametrize(("one", "other"), combinations(SIDES.values(), 2))
def test_candidates_of_different_sides_are_compared_at_the_nodes_that_both_see(models, one, other):
    """Either way round the same; a lens that takes nodes out of the image is compared like any other candidate."""
    unload = next(entry for entry in menu(1.0) if entry.words == "unload to zero once")
    known = {model.name: model for model in models}
    pair = [known[one], known[other]]
    if "lens" in (one, other):
        assert len({len(model.residual.evidence.seen) for model in pair}) == 2
    D = separation_chi2(*pair, unload)
    assert D > 1.0 and D == pytest.approx(separation_chi2(*pair[::-1], unload), rel=1e-9)


def test_the_programme_is_continued_and_the_recording_stays(models):
    before = models[0].identification.experiment
    after = continued(before, Continuation("half", (0.5, 0.0), (0.1, 0.2)))
    n, duration = before.model.n_frames, before.model.times[-1] - before.model.times[0]
    grip = next(p.drive for p in after.model.prescribed if getattr(p.drive, "column", "") == "grip_mm")
    was = next(p.drive for p in before.model.prescribed if getattr(p.drive, "column", "") == "grip_mm")
    np.testing.assert_array_equal(grip.values[:n], was.values)
    np.testing.assert_allclose(grip.values[n:], [0.5 * was.values[np.argmax(np.abs(was.values))], 0.0])
    np.testing.assert_allclose(after.model.times[n:] - before.model.times[-1], [0.1 * duration, 0.3 * duration])
    assert len(after.model.channels[0].values) == n + 2 == after.model.n_frames


def test_courses_that_the_data_give_stay_as_they_are_in_the_last_frame(models):
    """Friction in the load train, the warmth of a lamp, a motion that a gauge controls."""
    recorded = models[0].identification.experiment
    n, more = recorded.model.n_frames, 2
    hat = np.linspace(0.0, 1.0, n)[None]
    channel = replace(recorded.model.channels[0], hats={knot_name("friction", n - 1): hat[0]})
    warm = TemperatureField(np.outer(hat[0], np.ones(recorded.model.mesh.n_nodes)), "course")
    controlled = Load("RIGHT", "force", Controlled("strain", hat[0], "RIGHT", "x", rates=hat[0]), "x")
    before = replace(recorded, model=replace(recorded.model, channels=(channel,), loads=(controlled,),
                                             temperatures=(Temperature(None, warm, knots=(n - 1,), hats=3.0 * hat),)))
    after = continued(before, Continuation("back", (0.5, 0.0), (0.1, 0.2)))
    way = way_of(after.model.prescribed)
    for frame in range(n, n + more):
        shown = shown_value(after, after.model.channels[0], after.model.parameters, frame, 0.0)
        assert shown.by_name[knot_name("channel.force_N.friction", n - 1)] == way[frame]
    warmth = nodal_temperature(after.model)
    np.testing.assert_array_equal(warmth.values[n:], np.ones((more, recorded.model.mesh.n_nodes)))
    (knot,) = warmth.knots.values()
    np.testing.assert_array_equal(knot[n:], [3.0, 3.0])
    drive = after.model.loads[0].drive
    assert len(drive.course) == len(drive.rates) == after.model.n_frames


def test_an_excluded_frame_before_the_end_is_not_compared_with_the_new_ones(models):
    recorded = models[0].identification
    excluded = (recorded.experiment.model.n_frames - 2,)
    experiment = replace(recorded.experiment, recording=replace(recorded.experiment.recording, excluded=excluded))
    found = identification_at(experiment, recorded.parameters.as_values(), recorded.local, None)
    model, back = SeparatedModel("slip", found, residual_evidence(found)), Continuation("back", (0.5, 0.0), (0.1, 0.2))
    evidence = model.residual.evidence
    assert experiment.recording.excluded[0] not in evidence.frames
    assert len(_shown(model, back, evidence.seen).fields) == len(evidence.frames) + 2


def test_whether_a_recording_comes_back_to_no_load(models):
    before = models[0].identification.experiment
    assert unloads(before.model) is False
    assert unloads(continued(before, Continuation("half", (0.5,), (0.1,))).model) is False
    assert unloads(continued(before, Continuation("down", (0.5, 0.05), (0.1, 0.1))).model) is True
    assert unloads(replace(before.model, prescribed=(), loads=())) is None


def test_the_least_effort_that_suffices_is_recommended():
    tried = [Separation("first", 3.0), Separation("second", 30.0), Separation("third", 300.0)]
    assert recommended(tried).words == "second" and recommended(tried[:1]).words == "first"
    assert recommended([]) is None


@pytest.mark.parametrize("motion", [pytest.param('"measured"', marks=pytest.mark.slow),
                                    '{ virtual = "bspline", modes = 2, time_modes = 3 }'])
def test_a_test_whose_edges_are_known_from_images_alone_is_not_continued(tmp_path, motion):
    """The pulled grip is logged, the other one is not: its motion in images never taken is nobody's."""
    toml = TOML.replace("ux = 0.0\nuy = 0.0", f"ux = {motion}\nuy = {motion}", 1)
    experiment = load_experiment(write_folder(tmp_path / "clean", Side(), toml=toml))
    found = identification_at(experiment, experiment.model.parameters.as_values(),
                   np.zeros((experiment.model.n_frames, build_forward(experiment).drives.n_local)), None)
    model = SeparatedModel("one", found, residual_evidence(found, light=False))
    assert separations(model, model) == ()
    assert reason_against_continuation(experiment.model) == (
        "the motion of LEFT along x, LEFT along y is known from images alone")
    noise = SimpleNamespace(excess=0.0, excess_std=0.1, excess_z=0.0)
    verdict = SimpleNamespace(word="set", indistinguishable=(("one", "other"),), before=noise, after=noise,
                              in_channels=())
    state = SimpleNamespace(setting=SimpleNamespace(margin=Margin(), quick=False), other_axis=None)
    undecided = SimpleNamespace(identification=found, active=None, rounds=(), verdict=verdict, register=None,
                                neglected=None,
                                remainder=SimpleNamespace(local=(), channels=()), corrected=None, enriched=None,
                                state=state, last_parameters=experiment.model.parameters,
                                source=SimpleNamespace(motion_error=None))
    assert "none was simulated" in cautions(undecided)[-1]
