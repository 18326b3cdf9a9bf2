"""A grip that slips in several jumps: their frames and sizes come back, a ramp stays a ramp.

The truth moves the grip of a finer mesh (`side_twins`).
"""

from dataclasses import replace

import numpy as np
import pytest
from side_twins import TIMES, TRUTH, Side, write_folder
from test_revision import chosen, refit, sets, world

import idic
from idic.diagnose import Variant, candidate_library, identification_at, null_model, residual_evidence, score
from idic.diagnose.physics.edits import with_correction
from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.screen.score_columns import score_columns
from idic.diagnose.screen.situation import situation
from idic.diagnose.selection.moves.few_jumps import few_jumps, idle_jumps, loses_nothing, without_idle_jumps
from idic.diagnose.selection.state import last_cause
from idic.errors import InputError
from idic.experiment_file import load_experiment, read_toml
from idic.model import build_forward, jump_frame, without_knot
from idic.report.diagnosis.words import new_values
from idic.run import diagnose_run

JUMPS = {3: 0.004, 6: 0.006, 9: 0.003}  # mm, by frame
SLIP = "boundary.RIGHT.x.slip"


def lagging(course):
    return Side(motion={("RIGHT", "x"): np.column_stack([-course, np.zeros_like(course)])})


def in_jumps():
    return lagging(sum(size * (TIMES >= frame) for frame, size in JUMPS.items()))


def jump_scores(folder, side):
    """Frames, and scores of the columns of a jump in each, at the true parameters, without a fit."""
    path = write_folder(folder, side)
    experiment = load_experiment(path)
    values = experiment.model.parameters.as_values() | {"BODY.E": TRUTH["E"], "BODY.nu": TRUTH["nu"]}
    local = np.zeros((experiment.model.n_frames, build_forward(experiment).drives.n_local))
    found = identification_at(experiment, values, local, None)
    residual = residual_evidence(found, light=False)
    here = situation(found, residual, read_toml(path))
    frames = [int(k) for k in residual.evidence.frames]
    edits = with_correction(here, 1, "x", {"kind": "slip", "course": "jumps", "jump_frames": frames})
    names = tuple(f"{SLIP}_jump[{frame}]" for frame in frames)
    every = Variant("jumps", edits, names, dict.fromkeys(names, 0.0), dict.fromkeys(names, 1.0), exact=True,
                    free_course=True)
    slip = next(c for c in candidate_library() if c.name == "grip_slip")
    _, columns = score_columns(found, residual, [(slip, every)], lambda own: load_experiment(path, own))
    return frames, score(residual.evidence, null_model(residual.evidence, residual.null), columns)


def test_frames_and_sizes_come_from_the_columns_of_jumps_in_all_frames(tmp_path):
    frames, scores = jump_scores(tmp_path / "test", in_jumps())
    chosen = few_jumps(scores)
    assert [frames[k] for k in chosen] == list(JUMPS)
    assert np.allclose(scores.together(chosen), list(JUMPS.values()), atol=1e-3)
    assert few_jumps(replace(scores, U=np.zeros_like(scores.U))) == []


def test_a_small_motion_of_something_else_makes_no_jumps(tmp_path):
    """A soft spot that the user does not know moves the end a little with the load: noise alone would allow a second
    jump, which explains less than a hundredth of the first."""
    beside = 0.003 * (TIMES / TIMES[-1]) ** 2
    frames, scores = jump_scores(tmp_path / "test", lagging(0.012 * (TIMES >= 6) + beside))
    assert [frames[k] for k in few_jumps(scores)] == [6]


@pytest.mark.parametrize(("size", "loss", "kept"), [(-6.6e-5, 5.0, [7]), (-6.6e-5, 30.0, [1, 7]), (-3e-4, 5.0, [1, 7])])
def test_a_jump_that_bricks_make_idle_is_taken_out(size, loss, kept):
    """Of two jumps, 0.008 mm and one of 1.5 standard deviations beside the bricks; it stays where the whole needs it,
    or where it is 6.7 standard deviations large."""
    names = (f"{SLIP}_jump[1]", f"{SLIP}_jump[7]")
    drive = {"column": "grip_mm", "corrections": [{"kind": "slip", "course": "jumps", "jump_frames": [1, 7]}]}
    (one,) = chosen(("grip_slip",), sets(((), 5000.0), (("grip_slip",), 100.0)))
    tables = [{"nodes": "LEFT", "ux": 0.0}, {"nodes": "RIGHT", "ux": drive}]
    variant = Variant("RIGHT slips in 2 jumps", {"boundary": tables}, names, dict.fromkeys(names, 0.0),
                      dict.fromkeys(names, 1.0), free_course=True)
    winner = replace(one.winner, ranked=replace(one.winner.ranked, variant=variant),
                     refitted=replace(one.winner.refitted, label=variant.label))
    values = dict(zip(names, (size, 0.008), strict=True))
    null = replace(refit(("grip_slip",), 50.0), values=values, stds=dict.fromkeys(names, 4.5e-5))
    place, _ = world({frozenset({"boundary"}): 50.0 + loss})
    state = replace(place, rounds=(replace(one, winner=winner, rivals=(winner,)),), model=FittedModel(one.source, null))
    cause = last_cause(state)
    tried = without_idle_jumps(cause) if idle_jumps(cause) else None
    assert (tried is not None and loses_nothing(cause, tried)) is (kept != [1, 7])
    if kept != [1, 7]:
        (made,), source = tried.rounds, tried.model.source
        assert made.winner.ranked.variant.new == names[1:] and made.rivals == (made.winner,)
        assert source.edits["boundary"][1]["ux"]["corrections"][0]["jump_frames"] == kept
    assert drive["corrections"][0]["jump_frames"] == [1, 7]


def test_a_jump_outside_the_test_is_refused(tmp_path):
    path = write_folder(tmp_path / "test", Side())
    table = {"boundary": read_toml(path)["boundary"]}

    def with_jumps(**own):
        drive = {"column": "grip_mm", "corrections": [{"kind": "slip"} | own]}
        return load_experiment(path, {"boundary": [table["boundary"][0], {"nodes": "RIGHT", "ux": drive, "uy": 0.0}]})

    free = with_jumps(course="jumps", jump_frames=[9, 3]).model.parameters.free
    assert {f"{SLIP}_jump[3]", f"{SLIP}_jump[9]"} <= set(free)
    assert without_knot(f"{SLIP}_jump[3]") == SLIP and jump_frame(f"{SLIP}_jump[3]") == 3
    for own, what in (({"course": "jumps", "jump_frames": [12]}, "outside the test"), ({"course": "jumps"}, "jump"),
                      ({"course": "free", "jump_frames": [3]}, "jump")):
        with pytest.raises(InputError, match=what):
            with_jumps(**own)


def test_jumps_are_said_with_their_frames():
    after = {f"{SLIP}_jump[{frame}]": {"value": size, "std": 2e-4, "unit": "mm"} for frame, size in JUMPS.items()}
    said = new_values({"model": {"parameters_before": {}, "parameters_after": after}}, list(after), 0)
    assert said == ("slip of RIGHT in ux by 0.00400 ± 0.00020 mm in frame 3, 0.00600 ± 0.00020 mm in frame 6 and "
                    "0.00300 ± 0.00020 mm in frame 9")


@pytest.mark.slow
@pytest.mark.usefixtures("shared_server")
@pytest.mark.parametrize("kind", ["jumps", "ramp"])
def test_a_diagnosis_tells_the_jumps_and_leaves_a_ramp(tmp_path, kind):
    few = ("grip_slip", "grip_rotation", "machine_compliance", "plasticity", "force_offset", "seating")
    ramp = 0.012 * np.clip((TIMES - 2.2) / 8.8, 0.0, 1.0)
    write_folder(tmp_path / "test", in_jumps() if kind == "jumps" else lagging(ramp))
    idic.identify(tmp_path / "test", tmp_path / "run")
    content = diagnose_run(tmp_path / "run", library=tuple(c for c in candidate_library() if c.name in few))
    assert content["verdict"] == "single" and content["named"] == ["grip_slip"]
    (course,) = content["courses"]
    entry = content["model"]["parameters_after"]["BODY.E"]
    assert abs(entry["value"] - TRUTH["E"]) < 3.0 * entry["std"]
    if kind == "ramp":
        assert course["jumps"] == []
        return
    assert [jump["frame"] for jump in course["jumps"]] == list(JUMPS)
    assert all(abs(jump["size"] - JUMPS[jump["frame"]]) < 3.0 * jump["std"] for jump in course["jumps"])
    assert "in frame 3" in content["headline"] and "in frame 9" in content["sentence"]
    assert load_experiment(tmp_path / "run" / "enriched" / "experiment.toml").model.parameters.free
