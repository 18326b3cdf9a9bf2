"""The necking polycarbonate strip: the model behind `idic example polycarbonate`."""

import json
from dataclasses import replace

import numpy as np
import pytest

from idic.correlation import build_experiment_reference, nodal_equations, residual_map
from idic.experiment_file import load_experiment
from idic.fe import Reaction, constrain, dofs_of, increments_to_try, make_mesh, march
from idic.images import ArrayStack, RoundedStack, prefilter
from idic.virtual_tests import Sensor, clean_image, write_example, write_virtual_model
from idic_studies.examples import EXAMPLES
from idic_studies.examples.polycarbonate import Size, necking_strip
from idic_studies.examples.polycarbonate_model import TRUTH, Divisions, directions, pull, strip_mesh, strip_model

VALUES = np.array(list(TRUTH.values()))
SMALL = Divisions(16, 2)
STRESSES = [0, 5, 7]  # Gr, tau0, kappa; all moduli and viscosities scale with them


def pulled_until(mesh, times, law="egp", values=VALUES, derivatives=False):
    model = strip_model(mesh, times, law)
    return list(march(model, {"strip": values}, times, directions(model) if derivatives else ()))


def test_one_layer_at_half_thickness_is_two_layers_at_full_thickness():
    times = np.arange(0.0, 66.0, 3.0)  # through the drop of the force into a neck
    half = strip_mesh(SMALL)
    layer = half.nodes.reshape(-1, 2, 3)  # along z first
    full_nodes = np.concatenate([layer * [1, 1, -1], layer], axis=1)[:, [1, 2, 3]].reshape(-1, 3)  # z = -h, 0, h
    cells = half.blocks[0].connectivity
    lower = cells // 2 * 3 + cells % 2
    full = make_mesh(full_nodes, [("hex8", np.vstack([lower, lower + 1]))],
                     element_sets={"strip": np.arange(2 * len(cells))})
    x, _, z = full_nodes.T
    grip = dofs_of(np.flatnonzero(x == 50.0), "x", 3)
    held = [dofs_of(np.flatnonzero(x == 0.0), "x", 3), dofs_of(np.flatnonzero(z == 0.0), "z", 3),
            dofs_of(np.flatnonzero(x == 50.0), "y", 3)]
    none = np.zeros((len(times), 0))
    parts = [(dofs, np.zeros((len(dofs), 0)), none) for dofs in held]
    parts.append((grip, np.ones((len(grip), 1)), 0.05 * times[:, None]))
    model = strip_model(half, times)
    section = replace(model.sections[0], elements=full.element_sets["strip"])
    double = replace(model, mesh=full, sections=(section,), constraints=constrain(parts, len(times)),
                     channels=(Reaction(grip),))
    one, two = pulled_until(half, times)[-1], list(march(double, {"strip": VALUES}, times))[-1]
    assert one.channels[0] == pytest.approx(two.channels[0], rel=1e-6)  # the solver's tolerance, at the neck
    np.testing.assert_allclose(two.u.reshape(-1, 3, 3)[:, 1:], one.u.reshape(-1, 2, 3), atol=1e-5)  # mm
    assert one.channels[0] < 0.9 * max(s.channels[0] for s in pulled_until(half, times))  # it has necked


@pytest.mark.parametrize("n", [1, 3])
def test_sensitivities_with_any_number_of_modes_keep_the_scaling_of_stress(n):
    """All parameters of stress together change the force and nothing else (exact, at every step)."""
    times = np.arange(0.0, 66.0, 3.0)
    law = f"egp_{n}" if n > 1 else "egp"
    extra = np.array([[634.0 / n, 1.47e11 / n * 0.1**i] for i in range(n)]).ravel()
    values = np.concatenate([VALUES[:8], extra])
    scaling = [*STRESSES, *range(8, len(values))]
    largest = 0.0
    for state in pulled_until(strip_mesh(SMALL), times, law, values, derivatives=True):
        terms = state.du[..., scaling] * values[scaling]
        largest = max(largest, np.abs(terms).max())
        assert np.abs(terms.sum(axis=-1)).max() < 1e-6  # mm; terms of millimetres cancel
        assert state.dchannels[0, scaling] @ values[scaling] == pytest.approx(state.channels[0], abs=1e-3)  # N
    assert largest > 0.1  # mm: a hundred thousand times what is left of the sum


@pytest.mark.parametrize("k", [k if k % 3 == 0 else pytest.param(k, marks=pytest.mark.slow) for k in range(10)],
                         ids=list(TRUTH))  # each of them at a point: laws/test_law_contract.py
def test_sensitivities_through_the_neck_are_difference_quotients(k):
    times = np.arange(0.0, 66.0, 3.0)
    mesh, h = strip_mesh(Divisions(12, 2)), 1e-5
    step = h * np.abs(VALUES) * (np.arange(10) == k)
    model = strip_model(mesh, times)
    *_, here = march(model, {"strip": VALUES}, times, (directions(model)[k],))
    (*_, up), (*_, down) = (march(model, {"strip": VALUES + s * step}, times, steps=here.steps) for s in (1, -1))
    scaled = abs(VALUES[k]) * here.du[..., 0]
    # r0 moves the neck by 1 mm per %: truncation 1e5 h^2; the solver's 1e-8 over h is 1e-3 of a small term
    np.testing.assert_allclose(scaled, (up.u - down.u) / (2 * h), atol=2e-3 * np.abs(scaled).max() + 1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_a_neck_is_survived_far_from_the_truth(seed):
    values = VALUES * (1.0 + np.random.default_rng(seed).uniform(-0.5, 0.5, 10))
    run = pull(strip_mesh(SMALL), 50, 1, values)
    assert np.isfinite(run.u).all() and run.force[-1] > 0.0


def test_increments_cut_for_a_poor_start_are_not_kept():
    model, times = strip_model(strip_mesh(Divisions(2, 1)), np.array([0.0, 1.0, 2.0])), np.array([0.0, 1.0, 2.0])
    assert increments_to_try(model, times, 1, None) == [None]
    assert increments_to_try(model, times, 2, (0.5, 1.0, 1.5, 2.0)) == [(0.5, 1.0, 1.5, 2.0), None]
    assert increments_to_try(model, times, 1, (1.0, 1.5, 2.0)) == [(1.0, 2.0), (1.0, 1.5, 2.0), None]


def test_the_images_show_both_sides_of_the_plane_of_symmetry():
    test = necking_strip(Size(0.5, (36, 80), 4, 1, Divisions(20, 2), 2.0))
    texture, sensor = test.texture(np.random.default_rng(0), 256.0), Sensor(test.shape, background=np.nan)
    moved = clean_image(test.displacements[1], test.nodes, test.cells, test.camera, texture, sensor)
    assert np.isfinite(moved[:, :70]).all()  # x = -1 mm is seen, and nothing is torn open at x = 0
    n = len(test.nodes) // 2
    np.testing.assert_array_equal(test.nodes[n:, 0], -test.nodes[:n, 0])


def test_the_folder_starts_at_110_percent_and_says_how_the_images_were_made(tmp_path, monkeypatch):
    size = Size(0.5, (36, 80), 5, 1, Divisions(20, 2), 2.0)
    monkeypatch.setitem(EXAMPLES, "polycarbonate",
                        lambda reduced, foreign: necking_strip(size, *((1.5, 4) if foreign else ())))
    for foreign in (False, True):
        folder = write_example("polycarbonate", tmp_path / str(foreign), foreign=foreign, noise=None).parent
        experiment, truth = load_experiment(folder / "experiment.toml"), json.loads((folder / "truth.json").read_text())
        assert experiment.model.parameters.free == tuple(truth["parameters"])
        for name, value in truth["parameters"].items():
            assert experiment.model.parameters[name].value == pytest.approx(1.1 * value, rel=1e-5)
        assert truth["same_mesh"] is not foreign and truth["added_noise_std_gv"] == 0.0
        assert experiment.model.channels[0].noise_std == 0.5 and truth["channel_noise_std"]["force_N"] == 0.0


def test_with_the_default_options_the_true_motion_leaves_rounding_up_to_a_stretch_of_1_7(tmp_path):
    """Images of 8 bit without noise: sigma is that of rounding, 0.29 GV, an eighth of that of a camera.

    Left of the elements' own jumps of strain, which a blur smooths in the frame and not in the model: 1.03.
    """
    test = necking_strip(Size(0.1862, (97, 210), 5, 10, Divisions(40, 4), 2.2))
    clean = write_virtual_model(tmp_path, test, floor_gv=0.033)
    stack = RoundedStack(ArrayStack(np.stack([clean.frame(k) for k in range(clean.n_frames)])), 8)
    experiment = load_experiment(tmp_path, {"options.element_order": "as_given"}, stack=stack)  # nodes of the truth
    options, nodes = experiment.options, experiment.model.mesh.nodes
    assert options.lowpass_px == 0.6 and options.border_px == 4 and options.edge_margin_px == 3
    reference = build_experiment_reference(experiment, experiment.model.camera)
    assert (np.abs(test.displacements[-1][:len(nodes)]).max() / 0.1862) > 50.0  # px

    def chi2(reference, frame):
        moved = nodes + np.pad(test.displacements[frame][:len(nodes)], ((0, 0), (0, 1)))
        u = experiment.model.camera.project(moved) - experiment.model.camera.project(nodes)
        spline = prefilter(stack.frame(frame), 5, 0.6)
        light = nodal_equations(reference, spline, u).brightness_fit().coefficients
        return residual_map(reference, spline, u, "frame", light).chi2_dof(12**-0.5)

    frames = range(1, len(test.times))
    assert np.mean([chi2(reference, frame) for frame in frames]) < 1.05
    assert np.mean([chi2(replace(reference, image_gv=None), frame) for frame in frames]) > 5.0
