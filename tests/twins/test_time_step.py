"""The increments of a rate-dependent law: chosen by an error estimate, so that the answer does not depend on the
frames.

A strip with a hole is pulled in few frames. The truth is marched on a finer mesh with 24 increments per frame and
rendered pixel by pixel; the model knows nothing of either. With one increment per frame it is wrong by tens of standard
deviations.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from strip_twin import marched, pulled, strip_toml, write_recording, write_rest

from idic.experiment_file import load_experiment
from idic.identification import Analysis, Evaluation, Trial, evaluate_at, identify, scaled_system, time_step_bias
from idic.identification.step.state import IncrementChoice
from idic.identification.loop import advance
from idic.identification.step.increments import increment_notes
from idic.images import Camera
from idic.laws import compile as compile_law
from idic.run import identify_run, systematic
from idic.run.store.state_file import load_state, save_state
from idic.virtual_tests import strip_with_hole

LENGTH, WIDTH, RADIUS, TRUE_INCREMENTS, FORCE_NOISE = 20.0, 10.0, 2.0, 24, 1.0  # mm, per frame, N


@dataclass(frozen=True)
class Case:
    """A law with its true parameters (starts are 10 % off where they are identified), and the pull (share of the
    length)."""

    law: str
    truth: dict
    free: tuple[str, ...]
    strain: float = 0.05
    hold: bool = False  # pulled in the first half of the test, held in the second


CASES = {
    "viscoplastic": Case("viscoplastic", {"E": 2000.0, "nu": 0.35, "yield_stress": 20.0, "hardening_modulus": 300.0,
                                          "eta": 2000.0, "m": 1.0}, ("E", "yield_stress", "hardening_modulus", "eta")),
    "maxwell": Case("maxwell", {"E": 2000.0, "nu": 0.35, "g_1": 0.3, "tau_1": 1.5, "g_2": 0.0, "tau_2": 0.0, "g_3": 0.0,
                                "tau_3": 0.0}, ("E", "g_1", "tau_1"), 0.03, True),
    "creep": Case("creep", {"E": 2000.0, "nu": 0.35, "rate": 1e-3, "n": 4.0, "stress": 20.0}, ("E", "rate", "n")),
    "egp": Case("egp", {"Gr": 26.0, "Sa": 27.0, "r0": 0.965, "r1": 50.0, "r2": -3.0, "tau0": 0.7, "mu": 0.08,
                        "kappa": 3750.0, "G1": 634.0, "eta0": 1.47e11}, ("Gr", "tau0", "G1"), 0.12),
}


def write_folder(folder, case: Case, n_frames: int, pixel: float, noise: float, divisions=(3, 4, 3)):
    """A recording and its experiment.toml; pixel : mm; divisions : of the user's mesh, the truth has a finer one."""
    mesh = strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", *(n + 1 for n in divisions), name="BODY")
    times = np.linspace(0.0, 16.0, n_frames + 1)
    grip = case.strain * LENGTH * np.minimum(times / times[-1] * (2.0 if case.hold else 1.0), 1.0)
    law = compile_law(case.law)
    values = np.array([case.truth[name] for name in law.spec.parameter_names])
    u, force, _ = marched(pulled(mesh, "BODY", law, grip, 1.0), {"BODY": values}, times, TRUE_INCREMENTS)
    shape = (round(1.2 * WIDTH / pixel), round((1.1 + case.strain) * LENGTH / pixel))
    origin = (0.05 * LENGTH / pixel + 0.5 * LENGTH / pixel * (mesh.nodes[:, 0].min() < 0.0), 0.6 * WIDTH / pixel)
    camera = Camera.from_table(pixel, origin)
    rng = np.random.default_rng(11)
    total = write_recording(folder, mesh, u, camera, shape, noise, rng, texture_px=400.0, speckle=(7, 30.0, 225.0),
                            background=30.0)
    force = force + FORCE_NOISE * rng.standard_normal(len(times))
    text = strip_toml(pixel, origin, 1.0, FORCE_NOISE).replace("NOISE", f"{total:.4f}", 1) + material_table(case)
    user = strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", *divisions, name="BODY")
    return load_experiment(write_rest(folder, user, text, times, {"force_N": force, "grip_mm": grip}))


def material_table(case: Case) -> str:
    rows = [f"{name} = {{ value = {1.1 * value:.6g}, identify = true }}" if name in case.free else f"{name} = {value!r}"
            for name, value in case.truth.items()]
    return f'[material.BODY]\nlaw = "{case.law}"\n' + "\n".join(rows) + "\n"


def errors_in_std(found, truth, std="std") -> dict:
    return {name: (entry["value"] - truth[name.partition(".")[2]]) / entry[std]
            for name, entry in found.result["parameters"].items() if entry["std"] is not None}


def with_substeps(experiment, number):
    return replace(experiment, options=replace(experiment.options, substeps=number))


def time_error_in_std(experiment, found, factor=16) -> float:
    """Largest change of a parameter by so many times the increments, one Gauss-Newton step from the identified
    point."""
    values, n = found.state.accepted.values, found.state.increments.per_frame or 1
    finer, weights = evaluate_at(experiment, values, found.local, found.state.generalised, factor * n)
    parameters, steps = experiment.model.parameters.with_values(values), []
    for point in (finer, found.point):
        scaled = scaled_system(point.system, parameters, point.reference_gram, weights.image_noise)
        steps.append(scaled.spectrum().inverse @ scaled.b)
    stds = np.sqrt(np.diagonal(Analysis(experiment, parameters, found.point, weights.image_noise).covariance))
    return float(np.abs((steps[0] - steps[1]) / stds).max())


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """A creeping strip in six frames, and what was identified from it by default."""
    experiment = write_folder(tmp_path_factory.mktemp("time") / "short", CASES["creep"], 6, 0.25, 4.0, (2, 2, 1))
    return experiment, identify(experiment)


def test_the_default_chooses_increments_that_leave_less_than_a_standard_deviation(short):
    experiment, found = short
    entry = found.result["increments"]
    assert found.state.status == "converged" and entry["status"] == "enough" and entry["chosen"] == "error_estimate"
    assert entry["per_frame"] > 1 and entry["extrapolated"] and "per frame" in entry["words"]
    assert not [note for note in found.result["notes"] if "time step" in note]
    assert time_error_in_std(experiment, found, 4) < 1.0
    one = identify(with_substeps(experiment, 1))
    assert time_error_in_std(with_substeps(experiment, 1), one) > 3.0  # what one increment per frame is wrong by
    assert one.result["increments"]["chosen"] == "given" and not one.state.increments.per_frame


def test_the_estimated_time_error_of_given_increments_is_their_error(short):
    """Against the values at the chosen increments: the estimate is of second order, its error a part of it."""
    experiment, found = short
    given = with_substeps(experiment, 2)
    one = identify(given)
    bias = time_step_bias(evaluate_at, given, one.state.accepted.values, one.local, one.state.generalised, one.point)
    for name, estimated in bias.items():
        std = found.result["parameters"][name]["std"] * experiment.model.parameters[name].factor
        error = one.parameters[name].value - found.parameters[name].value
        assert abs(estimated - error) < 0.2 * abs(error) + std


PLASTIC = Case("j2_linear", {"E": 2000.0, "nu": 0.35, "yield_stress": 20.0, "hardening_modulus": 300.0},
               ("E", "nu", "yield_stress", "hardening_modulus"), 0.03)


@pytest.fixture(scope="module")
def plastic(tmp_path_factory):
    """A plastic strip in six frames, and what was identified from it by default and with one increment per frame."""
    experiment = write_folder(tmp_path_factory.mktemp("time") / "plastic", PLASTIC, 6, 0.25, 1.0, (2, 2, 1))
    return experiment, identify(experiment), identify(with_substeps(experiment, 1))


def test_plasticity_in_few_frames_takes_more_than_one_increment_per_frame(plastic):
    experiment, found, one = plastic
    entry = found.result["increments"]
    assert found.state.status == "converged" and entry["status"] == "enough" and entry["per_frame"] > 1
    assert entry["path_dependent_laws"] == ["j2_linear"] and not entry["rate_dependent_laws"]
    assert time_error_in_std(with_substeps(experiment, 1), one, 8) > 0.5
    assert time_error_in_std(experiment, found, 4) < 0.25


def with_noise(experiment, factor: float):
    """The same recording whose noise is said to be so many times larger."""
    noise = experiment.recording.noise
    channels = tuple(replace(channel, noise_std=factor * channel.noise_std) for channel in experiment.model.channels)
    return replace(experiment, model=replace(experiment.model, channels=channels),
                   recording=replace(experiment.recording, noise=replace(noise, std_gv=factor * noise.std_gv)))


def test_one_increment_per_frame_stays_to_the_last_bit_where_its_error_is_small(plastic):
    """The same recording with twenty times its noise: the error of the increments is below a quarter of a std."""
    experiment, _, _ = plastic
    noisy = with_noise(experiment, 20.0)
    found, one = identify(noisy), identify(with_substeps(noisy, 1))
    assert found.state.accepted == one.state.accepted and found.result["end"] == one.result["end"]
    assert found.state.increments.per_frame is None and found.result["increments"]["status"] == "enough"
    assert found.state.evaluations == one.state.evaluations + 1
    for name, entry in found.result["parameters"].items():
        known = one.result["parameters"][name]
        assert (entry["value"], entry["std"]) == (known["value"], known["std"]) and known["time_bias"] is None
        if entry["std"] is not None:
            assert abs(entry["time_bias"]) < 0.25 * entry["std"]


def test_steps_of_two_frames_spare_the_comparison_with_finer_increments(plastic):
    """With sixty times the noise their estimate lies below the part of the limit up to which six frames tell it."""
    experiment, _, _ = plastic
    noisy = with_noise(experiment, 60.0)
    found, one = identify(noisy), identify(with_substeps(noisy, 1))
    compared = [entry for entry in found.state.history if entry.get("compared")]
    assert len(compared) == 1 and compared[0]["phi"] is not None
    assert found.state.accepted == one.state.accepted and found.result["increments"]["status"] == "enough"
    for name, entry in found.result["parameters"].items():
        known = one.result["parameters"][name]
        assert (entry["value"], entry["std"]) == (known["value"], known["std"])
        assert entry["std"] is None or 0.0 < abs(entry["time_bias"]) < 0.25 * entry["std"]
    undecided = identify(experiment)  # the estimate of the clean recording is far above the limit
    assert [entry.get("compared", False) for entry in undecided.state.history].count(True) == 1
    assert undecided.result["increments"]["per_frame"] > 1


@pytest.mark.slow
def test_a_run_compares_with_steps_of_two_frames_as_memory_does(tmp_path):
    experiment = write_folder(tmp_path / "plastic", PLASTIC, 24, 0.25, 12.0, (2, 2, 1))
    found, run = identify(experiment), identify_run(tmp_path / "plastic" / "experiment.toml", tmp_path / "run")
    compared = [entry for entry in found.state.history if entry.get("compared")]
    assert len(compared) == 1 and run["increments"] == found.result["increments"]
    for name, entry in found.result["parameters"].items():
        assert run["parameters"][name]["value"] == pytest.approx(entry["value"], rel=1e-6)
        if entry["std"] is not None:
            assert run["parameters"][name]["time_bias"] == pytest.approx(entry["time_bias"], rel=1e-3)


@pytest.mark.slow
def test_the_time_error_of_plasticity_in_few_frames_is_estimated_and_removed(tmp_path):
    """One increment per frame is wrong by standard deviations where frames are few."""
    experiment = write_folder(tmp_path / "plastic", PLASTIC, 6, 0.1, 1.0)
    given, chosen = with_substeps(experiment, 1), identify(experiment)
    one, fine = identify(given), identify(with_substeps(experiment, 16))
    bias = time_step_bias(evaluate_at, given, one.state.accepted.values, one.local, one.state.generalised, one.point)
    assert experiment.model.path_dependent_laws == ("j2_linear",) and one.state.increments.per_frame is None
    assert chosen.result["increments"]["status"] == "enough" and time_error_in_std(experiment, chosen, 4) < 0.5
    errors = {}
    for name, estimated in bias.items():
        std = fine.result["parameters"][name]["std"] * experiment.model.parameters[name].factor
        errors[name] = (one.parameters[name].value - fine.parameters[name].value) / std
        assert abs(estimated / std - errors[name]) < 0.2 * abs(errors[name]) + 0.1
    assert abs(errors["BODY.hardening_modulus"]) > 2.0


@pytest.mark.slow
def test_searches_that_are_left_before_their_end_lead_to_the_same_values_in_fewer_evaluations(plastic, monkeypatch):
    """A tenth of the noise, as images of a hundred times the pixels: one increment per frame is off by many std."""
    experiment, _, _ = plastic
    sharp = with_noise(experiment, 0.1)
    found = identify(sharp)
    monkeypatch.setattr("idic.identification.step.increments.MAX_KNOWN_ERROR", 0.0)
    whole = identify(sharp)
    assert found.result["increments"] == whole.result["increments"]
    assert found.state.evaluations < whole.state.evaluations
    for name, entry in whole.result["parameters"].items():
        if entry["std"] is not None:
            off = found.result["parameters"][name]["value"] - entry["value"]
            assert abs(off) < 2.0 * experiment.options.tolerance * entry["std"]


@pytest.mark.slow
def test_generalised_least_squares_begin_where_the_ordinary_search_would_have_ended(tmp_path, monkeypatch):
    experiment = write_folder(tmp_path / "plastic", PLASTIC, 12, 0.25, 0.3, (2, 2, 1))
    found = identify(experiment)
    monkeypatch.setattr("idic.identification.step.increments.MAX_KNOWN_ERROR", 0.0)
    whole = identify(experiment)
    assert found.state.generalised and whole.state.generalised
    assert found.state.evaluations == whole.state.evaluations - 1
    for name, entry in whole.result["parameters"].items():
        if entry["std"] is not None:
            off = found.result["parameters"][name]["value"] - entry["value"]
            assert abs(off) < 2.0 * experiment.options.tolerance * entry["std"]


def test_too_few_evaluations_for_finer_increments_are_told(short):
    experiment, _ = short
    few = identify(replace(experiment, options=replace(experiment.options, max_iterations=3)))
    assert few.result["increments"]["status"] != "enough"
    assert [note for note in few.result["notes"] if "time step error not known" in note and "max_iterations" in note]


def test_finer_increments_without_equilibrium_leave_the_coarser_answer_and_a_note(short):
    experiment, found = short
    first = next(entry for entry in reversed(found.state.history) if entry["accepted"])
    accepted, weights = evaluate_at(experiment, first["values"], found.local, found.state.generalised,
                                     found.state.increments.per_frame)
    tried = 2 * found.state.increments.per_frame
    state = replace(found.state, status="running",
                    trial=Trial(first["values"], re_evaluation=True, new_increments=True),
                    increments=IncrementChoice(tried, "open", dict(first["values"])))
    failed = Evaluation(state.evaluations, None, None, "no equilibrium")
    after = advance(state, experiment, failed, accepted, weights.image_noise)
    assert after.status == "converged" and after.accepted == found.state.accepted
    assert (after.increments.per_frame, after.increments.status) == (tried // 2, "failed")
    assert "no equilibrium" in increment_notes(experiment, after.increments)[0]


def test_the_choice_survives_a_checkpoint(short, tmp_path):
    _, found = short
    save_state(tmp_path, found.state)
    assert load_state(tmp_path).increments == found.state.increments


@pytest.mark.slow
def test_a_viscoplastic_law_is_identified_from_sixteen_frames(tmp_path):
    """With one increment per frame E 2028 +- 2, hardening 235 +- 4 (300), eta 2485 +- 32 (2000), by ordinary weights;
    4.6 standard deviations of noise by those of today, and `std` counts the misfit."""
    case = CASES["viscoplastic"]
    experiment = write_folder(tmp_path / "case", case, 16, 0.1, 4.0)
    found = identify(experiment)
    off = errors_in_std(found, case.truth, "std_noise")
    assert max(map(abs, off.values())) < 3.0, off  # noise, and the error of the mesh
    coarse = identify(with_substeps(experiment, 1))
    old = errors_in_std(coarse, case.truth, "std_noise")
    assert max(map(abs, old.values())) > 3.0, old
    counted = errors_in_std(coarse, case.truth)  # the misfit that is left shows it
    assert max(map(abs, counted.values())) < 2.0, counted


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_every_rate_dependent_law_is_within_a_standard_deviation_of_sixteen_times_the_increments(name, tmp_path):
    experiment = write_folder(tmp_path / name, CASES[name], 10, 0.2, 4.0, (2, 2, 2))
    found = identify(experiment)
    assert found.state.increments.status == "enough"
    assert time_error_in_std(experiment, found) < 1.0


@pytest.mark.slow
def test_a_run_folder_chooses_the_same_increments_and_tells_the_parts_of_the_bias(short, tmp_path):
    experiment, found = short
    run = tmp_path / "run"
    result = identify_run(Path(experiment.folder) / "experiment.toml", run)
    assert result["increments"] == found.result["increments"]
    for name, entry in found.result["parameters"].items():
        assert result["parameters"][name]["value"] == pytest.approx(entry["value"], rel=1e-6)
    assessed = systematic(run, spread=False)
    for name, entry in assessed["parameters"].items():
        if entry["std"] is not None:
            assert abs(entry["time_bias"]) < entry["std"]
            assert entry["discretisation_bias"] == pytest.approx(entry["mesh_bias"] + entry["time_bias"])
