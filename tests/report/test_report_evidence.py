"""The evidence of a report of a real run: curves, noise floors, free FE-DIC and facts against what theory says of
them."""

from __future__ import annotations

import json
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

sys.path[:0] = [str(Path(__file__).parents[1] / "identify")]

from twin_runs import ELASTIC, FORCE, GRIPS, NOISE, SHAPE, Twin, write_folder  # noqa: E402

from idic.correlation import build_experiment_reference, frame_spline  # noqa: E402
from idic.measure import Seen, dic_frame  # noqa: E402
from idic.errors import InputError  # noqa: E402
from idic.experiment_file import load_experiment  # noqa: E402
from idic.run import open_run, write_report  # noqa: E402

SETUP = '\n[setup]\ncamera = "a virtual camera"\n'


@pytest.fixture(scope="module")
def run(gallery):
    """A tension test of an elastic plate with force, identified: E and nu."""
    return gallery("plate").shown


@pytest.fixture(scope="module")
def record(gallery):
    return gallery("plate").record


def test_the_band_of_an_elastic_law_is_that_of_its_modulus(record):
    curve, entry = record.curves[0], record.result["parameters"]["BODY.E"]
    # uniaxial tension at small strain: stress = E strain whatever nu, so std = std(E) strain
    assert np.allclose(curve.stress, entry["value"] * curve.strain, rtol=1e-8)
    assert np.allclose(curve.std, entry["std"] * curve.strain, rtol=1e-6)
    assert np.allclose(curve.started, entry["start"] * curve.strain, rtol=1e-8)
    assert curve.seconds == 5.0 and not curve.missing


def test_the_curve_ends_at_the_strain_of_the_specimen(record):
    u = record.fields.u_px
    x = record.nodes_px
    stretch = np.ptp(u[np.argmax(np.abs(u[..., 0]).max(axis=1)), :, 0]) / np.ptp(x[:, 0])  # mean over the length
    assert stretch < record.curves[0].strain[-1] < 4.0 * stretch  # strain concentrates at grips and edges


def test_the_noise_floor_of_the_free_dic_is_its_theory(run, record):
    experiment = open_run(str(run)).experiment
    reference = build_experiment_reference(experiment, experiment.model.camera)
    seen = Seen.by(experiment, reference)
    u = np.zeros((experiment.model.mesh.n_nodes, 2))
    frame = dic_frame(reference, frame_spline(experiment, experiment.model.reference), u, seen.smoother)
    theory = np.sqrt(np.nanmean(frame.node_std(reference, experiment.recording.noise.std_gv) ** 2))
    n = 2 * experiment.model.mesh.n_nodes
    # one draw of n values, of which smoothing leaves perhaps a third independent: 1/sqrt(2 n/3) = 10 %, thrice that
    assert record.practice.floor.free_px == pytest.approx(theory, rel=3.0 / np.sqrt(2.0 * n / 3.0))
    assert 0.0 < record.practice.floor.free_strain < 0.05


def test_the_floor_of_the_model_follows_from_the_covariance(record):
    phi, table = record.sensitivities, record.result["correlation"]
    stds = np.array([record.result["parameters"][name]["std"] for name in phi.names])
    assert list(phi.names) == table["names"] == ["BODY.E", "BODY.nu"]
    rng = np.random.default_rng(0)
    covariance = np.array(table["matrix"]) * np.outer(stds, stds)
    draws = rng.multivariate_normal(np.zeros(2), covariance, 4000) / np.array(phi.sizes)
    moved = np.einsum("di,iac->dac", draws, phi.phi_px)
    # rms over draws and nodes; 4000 draws know it to 1.1 %
    assert record.practice.floor.model_px == pytest.approx(np.sqrt(np.mean(moved**2)), rel=0.04)
    assert record.practice.floor.model_px < 0.2 * record.practice.floor.free_px


def test_the_free_dic_finds_the_simulated_motion_and_no_more_than_noise(record):
    floor = record.practice.floor.free_px
    assert record.free_fields.frames == record.residuals.frames
    rms = np.sqrt(np.nanmean(record.free_fields.difference_px**2))
    assert rms == pytest.approx(floor, rel=0.35)  # noise of the frames and of their reference; the mesh's own error
    assert np.allclose(record.free_fields.chi2_dof, 1.0, atol=0.06)  # 8000 pixels: 1.6 %, the interpolant the rest


def test_the_facts_are_those_of_the_images(record):
    facts = record.practice
    assert (facts.columns, facts.rows) == SHAPE[::-1] and facts.depth == "uint8" and facts.frame_s == 1.0
    assert facts.setup == {"camera": "a virtual camera"} and facts.channel_noise == (("force_N", "N", 1.0, "given"),)
    assert facts.speckle_px == pytest.approx(4.0 * 1.6 * np.sqrt(np.log(2.0)), rel=0.15)
    assert facts.n_elements == 24 and facts.cell == "quad8"
    assert record.noise_gv == pytest.approx(NOISE, rel=0.05)


def test_the_views_are_frames_with_their_residuals(run, record):
    assert [view.frame for view in record.views] == [1, 2, 3, 4, 5]
    final = record.residuals.identified[list(record.residuals.frames).index(5)]
    assert np.array_equal(record.views[-1].residual, final, equal_nan=True)
    moved = record.views[-1].nodes_px - record.nodes_px
    assert np.allclose(moved, record.fields.u_px[list(record.fields.frames).index(5)])


def test_the_processor_time_is_counted(record):
    cost = record.result["cost"]
    assert 0.0 < cost["cpu_s"] < 1.5 * cost["wall_s"] + 1.0 and "cpu_before_s" not in cost


def test_a_report_leaves_its_frames_as_files(gallery, tmp_path):
    run = gallery("plate").copied(tmp_path).run
    page = write_report(run)
    assert (run / "figures" / "frame_0005.jpeg").read_bytes().startswith(b"\xff\xd8")
    assert (run / "figures" / "stress_strain_BODY.png").exists() and (run / "figures" / "free_dic.png").exists()
    assert page.stat().st_size < 3e6


def test_words_on_the_laboratory_change_no_result(tmp_path):
    plain, worded, misspelt = (write_folder(tmp_path / name, Twin(seed=1), ELASTIC + GRIPS + FORCE + text).parent
                               for name, text in (("a", ""), ("b", SETUP), ("c", '\n[setup]\ncamra = "x"\n')))
    assert load_experiment(plain).recording.identity == load_experiment(worded).recording.identity
    with pytest.raises(InputError, match="camra"):
        load_experiment(misspelt)


def test_an_identified_law_becomes_a_table_and_cards(run, tmp_path):
    from idic.run import export_laws

    written, = export_laws(run, tmp_path / "laws")
    assert [file.name for file in written.files] == ["BODY.toml", "BODY.abaqus.inp", "BODY.calculix.inp"]
    E = json.loads((run / "result.json").read_text())["parameters"]["BODY.E"]["value"]
    assert tomllib.loads(written.files[0].read_text())["E"]["value"] == pytest.approx(E)
    assert float(written.files[2].read_text().split("*ELASTIC\n")[1].split(",")[0]) == pytest.approx(E, rel=1e-7)
    assert not any(written.missing.values())


def test_a_card_of_a_set_with_any_letters_is_written(run, tmp_path, monkeypatch):
    from idic.laws.composed.material_card import Card
    from idic.run import export_laws

    monkeypatch.setattr("idic.run.reporting.law_files.material_card",
                        lambda *_, **__: Card("*MATERIAL, NAME=PRÜFLING\n", ()))
    written, = export_laws(run, tmp_path / "laws")
    assert all("PRÜFLING" in file.read_text(encoding="utf-8") for file in written.files[1:])


def test_a_free_hardening_curve_is_drawn_with_its_band_and_the_nearest_forms():
    from idic.laws import classical_fits, knots
    from idic.report.figures.hardening import hardening_curve
    from idic.report.result.record import HardeningCurve
    from idic.report import RunRecord

    p = knots(0.1, 8)
    stress, covariance = 200.0 + 120.0 * (1.0 - np.exp(-15.0 * p)), 0.25 * np.eye(8)
    curve = HardeningCurve("sheet", p, stress, 0.5 * np.ones(8), p, 0.1,
                           classical_fits(p, stress, covariance, range(8)))
    picture = hardening_curve(RunRecord(title="", result={"parameters": {}}), curve)
    assert "voce: yield_stress + Q (1 - exp(-b p)), yield_stress = 200 MPa, Q = 120 MPa, b = 15" in picture.caption


def test_a_free_spectrum_is_drawn_with_its_band_and_the_form_that_it_came_from():
    """Weights of one relaxation time of 5 s and their covariance by hand: the standard linear solid is inside."""
    from types import SimpleNamespace

    from scipy.optimize import nnls

    from idic.laws import grid, relaxing
    from idic.parameters import Parameter, ParameterSet
    from idic.report import RunRecord
    from idic.report.evidence.relaxation import relaxation_curves
    from idic.report.figures.relaxation import relaxation_curve

    times, taus = np.linspace(0.0, 60.0, 31), grid(0.5, 50.0, 5)
    weights = np.array([0.0, 0.0, 0.4, 0.0, 0.0])  # 5 s is on the grid
    values = {"E": 1000.0, "nu": 0.25, "shortest": 0.5, "longest": 50.0}
    values |= {f"g_{k}": w for k, w in enumerate(weights, 1)}
    parameters = ParameterSet([Parameter(f"BAR.{name}", value) for name, value in values.items()])
    free = ["BAR.E", *(f"BAR.g_{k}" for k in range(1, 6))]
    stds = np.array([2.0, *[0.01] * 5])
    result = {"parameters": {name: {"std": std} for name, std in zip(free, stds, strict=True)},
              "correlation": {"names": free, "matrix": np.eye(6).tolist()}}
    bar = SimpleNamespace(law="free_relaxation(5)", element_set="BAR")
    model = SimpleNamespace(materials=[bar], times=times, reference=0, free_curves=())
    curve, = relaxation_curves(model, parameters, result)
    loss = relaxing(curve.time, taus)
    np.testing.assert_allclose([curve.time[0], curve.time[-1]], [2.0, 60.0])
    np.testing.assert_allclose(curve.modulus, 400.0 * (1.0 - 0.4 * (1.0 - np.exp(-curve.time / 5.0))), rtol=1e-12)
    # half of the weight 0.4 may lie at 2.81 s or 8.89 s, in the middle of two times, which the grid meets up to a rest
    between = relaxing(curve.time, 5.0 * np.array([0.1, 10.0]) ** 0.25).T
    rests = [share - loss @ nnls(loss, share)[0] for share in between]
    np.testing.assert_allclose(curve.std**2, (2.0 * curve.modulus / 1000.0) ** 2 + (
        400.0 * 0.01) ** 2 * (loss**2).sum(axis=1) + (400.0 * 0.2) ** 2 * (np.array(rests) ** 2).sum(axis=0))
    nearest = next(fit for fit in curve.fits if fit.form == "standard linear solid")
    assert nearest.inside and [nearest.parameters[key] for key in ("G", "g", "tau")] == pytest.approx([400.0, 0.4, 5.0],
                                                                                                      rel=1e-3)
    picture = relaxation_curve(RunRecord(title="", result={"parameters": {}}), curve)
    assert "standard linear solid (inside): G = 400 MPa, g = 0.4, tau = 5 s" in picture.caption
