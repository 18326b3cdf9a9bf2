"""Corrections of a logged motion, heterogeneities, moving cameras and defocus in experiment.toml: what becomes of them,
and what is refused.
"""

from __future__ import annotations

import numpy as np
import pytest
from experiment_file.small_experiment import TOML, write_experiment

from idic.correlation import channel_values
from idic.errors import InputError
from idic.experiment_file import load_experiment, locate, read_toml, validated
from idic.experiment_file.tables.heterogeneities import heterogeneities
from idic.fe import Variation
from idic.model import DriveTable, boundary_parameters, build_forward, strayed
from idic.model.heterogeneity import variations_at
from idic.model.load_train import directions
from idic.model.terms.channels.force_drift import drifting

GRIP = 'uy = { column = "grip_um", noise_std = 0.2 }'


def corrected(text, drive=GRIP):
    return TOML.replace(drive, f"{drive[:-1]}, corrections = [{text}] }}" if drive.endswith("}") else
                        f"{drive.partition(' =')[0]} = {{ value = 0.0, corrections = [{text}] }}")


def test_corrections_add_their_courses_to_the_log_in_internal_units(tmp_path):
    text = ('{ kind = "slip", start_s = 1.0 }, { kind = "compliance", column = "force_kN" }, { kind = "rotation" },'
            ' { kind = "misalignment" }')
    experiment = load_experiment(write_experiment(tmp_path / "test", corrected(text)))
    amplitudes = {"slip": 0.002, "compliance": 1e-5, "rotation": 0.1, "misalignment": 0.05}
    names = {f"boundary.TOP.y.{kind}": value for kind, value in amplitudes.items()}
    assert set(names) <= set(experiment.model.parameters.free)
    drives = DriveTable.of(experiment)
    forward = build_forward(experiment)
    assert all(forward.moves(name) for name in names)
    moved = drives.basis @ drives.histories(experiment.model.parameters.with_values(names))[-1]
    grip = np.array([0.0, 5.0, 10.0, 15.0])[-1] * 1e-3 - 0.0  # mm; 0.1 um at the reference is noise
    expected = {}
    for node in experiment.model.mesh.node_sets["TOP"]:
        x = experiment.model.mesh.nodes[node, 0] - 2.0  # from the middle of the set
        expected[2 * node + 1] = grip - 0.002 - 1e-5 * 300.0 + 0.1 * (grip - 1e-4) * x
        expected[2 * node] = 0.05 * (grip - 1e-4)
    found = dict(zip(drives.dofs.tolist(), moved, strict=True))
    assert all(found[dof] == pytest.approx(value, abs=1e-9) for dof, value in expected.items())


def test_a_fixed_end_may_slip_and_turn_with_a_column_too(tmp_path):
    text = '{ kind = "slip", start_s = 0.5, course = "jump" }, { kind = "rotation", column = "force_kN" }'
    toml = TOML.replace("uy = 0.0", f"uy = {{ value = 0.0, corrections = [{text}] }}", 1)
    experiment = load_experiment(write_experiment(tmp_path / "test", toml))
    drives = DriveTable.of(experiment)
    histories = drives.histories(experiment.model.parameters.with_values({"boundary.BOTTOM.y.slip": 0.01}))
    slip = drives.names.index("boundary.BOTTOM.y.slip")
    assert histories[:, slip] == pytest.approx([0.0, 0.01, 0.01, 0.01])


def test_a_rotation_may_begin_at_a_time_and_grips_may_settle_under_the_first_load(tmp_path):
    text = ('{ kind = "rotation", start_s = 0.5, course = "ramp" }, '
            '{ kind = "seating", column = "force_kN", seated_at = 0.1 }')
    experiment = load_experiment(write_experiment(tmp_path / "test", corrected(text)))
    drives = DriveTable.of(experiment)
    histories = drives.histories(experiment.model.parameters)
    turn, settle = (drives.names.index(f"boundary.TOP.y.{kind}") for kind in ("rotation", "seating"))
    values = experiment.model.parameters.with_values({"boundary.TOP.y.rotation": 0.01, "boundary.TOP.y.seating": 0.02})
    moved = drives.histories(values) - histories
    times, force = experiment.model.times, experiment.model.channels[0].values / 1000.0  # kN
    start = np.maximum(times - 0.5, 0.0) / (times[-1] - 0.5)
    assert moved[:, turn] == pytest.approx(0.01 * start)
    assert moved[:, settle] == pytest.approx(-0.02 * (1.0 - np.exp(-force / 0.1)), abs=1e-12)


def without_log(text, times):
    """The small experiment with a fixed side that slips, no log, and perhaps times of the images."""
    toml = TOML.replace("ux = 0.0\nuy = 0.0", f"ux = 0.0\nuy = {{ value = 0.0, corrections = [{text}] }}")
    toml = toml.replace(GRIP, 'uy = "measured"').replace('loads = "loads.csv"\n', times)
    return toml.partition("[[channel]]")[0]


def test_without_a_log_corrections_begin_at_the_times_of_the_images(tmp_path):
    slip, knots = '{ kind = "slip", start_s = 6.0 }', '{ kind = "slip", course = "free", knots = 2 }'
    (tmp_path / "times.csv").write_text("time_s\n0\n5\n15\n25\n")
    for number, (times, seconds) in enumerate([("frame_interval_s = 5.0\n", [0.0, 5.0, 10.0, 15.0]),
                                               ('image_times = "times.csv"\n', [0.0, 5.0, 15.0, 25.0])]):
        folder = write_experiment(tmp_path / f"test{number}", without_log(slip, times))
        (folder / "times.csv").write_bytes((tmp_path / "times.csv").read_bytes())
        experiment = load_experiment(folder)
        (course,) = (own.course for entry in experiment.model.prescribed
                     for own in getattr(entry.drive, "corrections", ()))
        expected = np.maximum(np.array(seconds) - 6.0, 0.0)
        np.testing.assert_allclose(np.abs(course) / np.abs(course).max(), expected / expected.max(), atol=1e-12)
        assert not any("counts frames" in note for note in experiment.notes)
    folder = write_experiment(tmp_path / "knots", without_log(knots, 'image_times = "times.csv"\n'))
    (folder / "times.csv").write_bytes((tmp_path / "times.csv").read_bytes())
    courses = [own.course for entry in load_experiment(folder).model.prescribed
               for own in getattr(entry.drive, "corrections", ())]
    assert [course.tolist() for course in courses] == [[0.0, 1 / 3, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]  # frames 2, 3


def test_seconds_on_a_test_without_times_are_refused_or_said_to_count_frames(tmp_path):
    frames = load_experiment(write_experiment(tmp_path / "frames", without_log('{ kind = "slip", start_s = 1.0 }', "")))
    assert any("corrections: start_s counts frames" in note for note in frames.notes)
    plain, alpha = without_log('{ kind = "slip" }', ""), 'nu = 0.3\nalpha = { value = 1e-5, unit = "1/K" }'
    for number, (toml, said) in enumerate([
            (without_log('{ kind = "slip", start_s = 6.0 }', ""), "the numbers of the frames: the test has no times"),
            (plain + "[[stage]]\nuntil_s = 2.0\n", "stage[0].until_s"),
            (plain.replace("nu = 0.3", alpha)
             + "[[boundary]]\ntemperature = { course = [[0.0, 20.0], [600.0, 80.0]] }\n",
             "a course in seconds on a test without times")]):
        with pytest.raises(InputError) as told:
            load_experiment(write_experiment(tmp_path / str(number), toml))
        assert said in str(told.value) and "frame_interval_s" in str(told.value)


@pytest.mark.parametrize("start, said", [(1.0, None), (9.0, "the drift begins outside the test")])
def test_a_drift_of_a_channel_may_begin_at_a_time_of_the_test(tmp_path, start, said):
    toml = TOML.replace('column = "force_kN"', f'column = "force_kN"\ndrift_from_s = {start}', 1)
    path = write_experiment(tmp_path / "test", toml + '[[dof]]\nname = "channel.force_kN.drift"\n')
    if said is not None:
        with pytest.raises(InputError, match=said):
            load_experiment(path)
        return
    experiment = load_experiment(path)
    seconds = [drifting(experiment.model, experiment.model.channels[0], frame)
               for frame in range(experiment.model.n_frames)]
    assert seconds == pytest.approx(np.maximum(experiment.model.times - start, 0.0))


@pytest.mark.parametrize("motion, found", [
    ([0.0, 1.0, 2.0, 2.0, 1.0, 0.0], [0, 1, 1, 1, -1, -1]),
    ([0.0, -1.0, -1.005, -1.0, -2.0, 1.0], [0, -1, -1, -1, -1, 1]),  # a way back of less than the dead band
    ([0.0, 0.001, -0.001, 0.0, 0.0, 2.0], [0, 0, 0, 0, 0, 1]),
])
def test_the_load_train_keeps_its_direction_while_it_rests(motion, found):
    assert directions(np.array(motion), 0.02).tolist() == found


@pytest.mark.parametrize("text, key, said", [
    ('{ kind = "slip", start_s = 9.0 }', "start_s", "outside the test"),
    ('{ kind = "compliance" }', "corrections", "without a force"),
    ('{ kind = "compliance", column = "grip_um" }', "column", ""),
    ('{ kind = "compliance", column = "strain" }', "column", ""),
    ('{ kind = "slip", column = "force_kN" }', "corrections", "does not belong here"),
    ('{ kind = "seating", column = "force_kN" }', "corrections", "without its force"),
    ('{ kind = "seating", seated_at = 20.0 }', "corrections", "without its force"),
    ('{ kind = "compliance", column = "force_kN", seated_at = 20.0 }', "corrections", "does not belong here"),
    ('{ kind = "rotation", column = "force_kN", start_s = 1.0 }', "corrections", "two courses"),
    ('{ kind = "rotation", start_s = 9.0 }', "start_s", "outside the test"),
    ('{ kind = "slip" }, { kind = "slip", start_s = 1.0 }', "corrections", "given twice"),
    ('{ kind = "shape" }', "corrections", "without its degree"),
    ('{ kind = "shape", degree = 2 }, { kind = "shape", degree = 2 }', "corrections", "given twice"),
    ('{ kind = "rotation", degree = 2 }', "corrections", "does not belong here"),
    ('{ kind = "creep" }', "kind", ""),
])
def test_a_correction_that_cannot_be_meant_is_refused(tmp_path, text, key, said):
    with pytest.raises(InputError) as error:
        load_experiment(write_experiment(tmp_path / "test", corrected(text)))
    assert said in error.value.what and error.value.remedy
    assert key in error.value.key or key == "corrections"


def test_a_shape_moves_the_set_by_a_polynomial_along_it_in_proportion_to_its_largest_motion(tmp_path):
    text = ', '.join(f'{{ kind = "shape", degree = {degree} }}' for degree in range(4))
    experiment = load_experiment(write_experiment(tmp_path / "test", corrected(text)))
    amplitudes = {f"boundary.TOP.y.shape{degree}": 1e-3 * (degree + 1) for degree in range(4)}
    assert set(amplitudes) <= set(experiment.model.parameters.free)
    assert all(experiment.model.parameters[name].unit == "mm" for name in amplitudes)
    drives = DriveTable.of(experiment)
    moved = [dict(zip(drives.dofs.tolist(), drives.basis @ drives.histories(values)[-1], strict=True))
             for values in (experiment.model.parameters, experiment.model.parameters.with_values(amplitudes))]
    for node in experiment.model.mesh.node_sets["TOP"]:
        s = (experiment.model.mesh.nodes[node, 0] - 2.0) / 2.0  # from the middle of the set
        expected = 1e-3 * (1.0 + 2.0 * s + 3.0 * (1.5 * s**2 - 0.5) + 4.0 * (2.5 * s**3 - 1.5 * s))
        assert moved[1][2 * node + 1] - moved[0][2 * node + 1] == pytest.approx(expected, abs=1e-12)
        assert moved[1][2 * node] == moved[0][2 * node]


def test_a_shape_of_a_fixed_set_follows_a_column_or_a_course_of_its_own(tmp_path):
    text = ('{ kind = "shape", degree = 3, course = "free", knots = 2 },'
            ' { kind = "shape", degree = 2, column = "force_kN" }')
    toml = TOML.replace("uy = 0.0", f"uy = {{ value = 0.0, corrections = [{text}] }}", 1)
    experiment = load_experiment(write_experiment(tmp_path / "test", toml))
    drives = DriveTable.of(experiment)
    names = ["boundary.BOTTOM.y.shape3_knot[2]", "boundary.BOTTOM.y.shape3_knot[3]", "boundary.BOTTOM.y.shape2"]
    histories = drives.histories(experiment.model.parameters.with_values(dict(zip(names, (0.2, 0.1, 0.3),
                                                                                  strict=True))))
    assert histories[:, drives.names.index(names[0])] == pytest.approx([0.0, 0.1, 0.2, 0.0])
    assert histories[:, drives.names.index(names[1])] == pytest.approx([0.0, 0.0, 0.0, 0.1])
    assert histories[-1, drives.names.index(names[2])] == pytest.approx(0.3)


def test_a_misalignment_across_a_free_component_is_refused(tmp_path):
    toml = corrected('{ kind = "misalignment" }').replace('nodes = "TOP"\nux = 0.0', 'nodes = "TOP"')
    with pytest.raises(InputError, match="motion that is free"):
        build_forward(load_experiment(write_experiment(tmp_path / "test", toml)))


SPOT = """
[[heterogeneity]]
set = "SPECIMEN"
form = "inclusion"
centre_mm = [1.0, 1.5]
identify_centre = true
radius_mm = { value = 0.8, identify = true }
stiffness = { value = 0.7, identify = true }
"""
GRADIENT = """
[[heterogeneity]]
set = "SPECIMEN"
form = "gradient"
along_x = { value = 0.2, identify = true }
"""


def test_heterogeneities_become_factors_of_the_stress(tmp_path):
    experiment = load_experiment(write_experiment(tmp_path / "test", TOML + SPOT + GRADIENT))
    assert {f"SPECIMEN.inclusion.{last}"
            for last in ("stiffness", "radius", "x", "y")} < set(experiment.model.parameters.free)
    spot, gradient = variations_at(experiment.model, experiment.model.parameters)
    assert spot.factor(np.array([[1.0, 1.5], [3.5, 1.5]])) == pytest.approx([0.7, 1.0], abs=1e-4)  # tanh(5)
    assert gradient.factor(np.array([[0.0, 1.0], [2.0, 1.0], [4.0, 1.0]])) == pytest.approx([0.8, 1.0, 1.2])


LAYERS = """
[[heterogeneity]]
set = "SPECIMEN"
form = "layers"
period_mm = { value = 1.0, identify = true }
direction_deg = 90
stiffness_ratio = { value = 4.0, identify = true }
offset_mm = 0.25
"""


def test_layers_are_stiff_and_soft_about_a_geometric_mean_across_their_direction(tmp_path):
    experiment = load_experiment(write_experiment(tmp_path / "test", TOML + LAYERS))
    assert {f"SPECIMEN.layers.{last}" for last in ("period", "stiffness_ratio")} < set(experiment.model.parameters.free)
    (layers,) = variations_at(experiment.model, experiment.model.parameters)
    x, y = layers.middle + [0.7, 0.25]  # the middle of a stiff layer
    points = np.array([[x, y], [0.0, y + 1.0], [x, y + 0.25], [x, y - 0.5]])
    assert layers.factor(points) == pytest.approx([2.0, 2.0, 1.0, 0.5], rel=1e-3)  # 1 - tanh(1 / LAYER_EDGE)


def test_an_inclusion_whose_centre_leaves_the_specimen_is_reported_as_no_finding(tmp_path):
    experiment = load_experiment(write_experiment(tmp_path / "test", TOML + SPOT + GRADIENT))
    assert strayed(experiment.model, experiment.model.parameters) == []
    right = experiment.model.mesh.nodes[:, 0].max()
    for x, told in ((0.99 * right, 0), (1.01 * right, 1)):
        said = strayed(experiment.model, experiment.model.parameters.with_values({"SPECIMEN.inclusion.x": x}))
        assert len(said) == told and all(f"({x:.4g}, 1.5) lies outside SPECIMEN" in note for note in said)
    held = experiment.model.parameters.with_values({"SPECIMEN.inclusion.x": 2.0 * right}).with_free(())
    assert strayed(experiment.model, held) == []  # so it was given


def test_lengths_of_an_inclusion_are_in_px_without_a_scale(tmp_path):
    folder = write_experiment(tmp_path / "test", TOML + SPOT)
    config, mesh = validated(read_toml(locate(folder)), locate(folder)), load_experiment(folder).model.mesh
    for unit in ("mm", "px"):
        made = {p.name.rpartition(".")[2]: p.unit for p in heterogeneities(config, mesh, unit, folder)[1]}
        assert made == {"stiffness": "", "radius": unit, "x": unit, "y": unit}


def test_shapes_of_a_virtual_boundary_are_in_px_where_no_scale_is_known(tmp_path):
    toml = TOML.replace('uy = { column = "grip_um", noise_std = 0.2 }',
                        'uy = { virtual = "bspline", modes = 2, time_modes = 2 }')
    prescribed = load_experiment(write_experiment(tmp_path / "test", toml)).model.prescribed
    for unit in ("mm", "px"):
        made = boundary_parameters(prescribed, 0.1, unit)
        assert len(made) == 4 and {p.unit for p in made} == {unit}


def test_slopes_of_the_factors_are_those_of_difference_quotients():
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (40, 2))
    values = {"amount": 0.6, "x": 0.1, "y": -0.2, "radius": 0.7}
    for name in values:
        at = [Variation("S", "spot", values | {name: values[name] + h}).factor(points) for h in (1e-6, -1e-6)]
        assert Variation("S", "spot", values).slope(points, name) == pytest.approx((at[0] - at[1]) / 2e-6, abs=1e-8)


def test_slopes_of_layers_are_those_of_difference_quotients():
    points = np.random.default_rng(0).uniform(-3.0, 3.0, (80, 2))
    values = {"stiffness_ratio": 1.7, "period": 1.6, "direction": 33.0, "offset": 0.2, "share": 0.4}
    for name in values:
        at = [Variation("S", "layers", values | {name: values[name] + h}, np.zeros(2), np.ones(2)).factor(points)
              for h in (1e-6, -1e-6)]
        slope = Variation("S", "layers", values, np.zeros(2), np.ones(2)).slope(points, name)
        assert slope == pytest.approx((at[0] - at[1]) / 2e-6, abs=1e-7)


@pytest.mark.parametrize("old, new, said", [
    ("period_mm = { value = 1.0, identify = true }\n", "", "without period_mm"),
    ("period_mm = { value = 1.0", "period_mm = { value = 100.0", "out of range"),
    ("stiffness_ratio = { value = 4.0", "stiffness_ratio = { value = 0.0", "out of range"),
    ("offset_mm = 0.25", "radius_mm = 0.25", "does not belong here"),
])
def test_layers_that_cannot_be_meant_are_refused(tmp_path, old, new, said):
    with pytest.raises(InputError) as error:
        load_experiment(write_experiment(tmp_path / "test", TOML + LAYERS.replace(old, new)))
    assert said in error.value.what and error.value.key.startswith("heterogeneity[")


@pytest.mark.parametrize("old, new, said", [
    ('set = "SPECIMEN"', 'set = "NOBODY"', "without a material"),
    ("centre_mm = [1.0, 1.5]", "centre_mm = [90.0, 1.5]", "outside the body"),
    ("centre_mm = [1.0, 1.5]", "centre_mm = [1.0, 1.5, 0.0]", "more coordinates"),
    ("centre_mm = [1.0, 1.5]\n", "", "without centre_mm"),
    ("radius_mm = { value = 0.8", "along_x = 0.1\nradius_mm = { value = 0.8", "does not belong here"),
    ("stiffness = { value = 0.7", "stiffness = { value = -0.7", "out of range"),
    (SPOT, SPOT + SPOT, "of one name"),
])
def test_a_heterogeneity_that_cannot_be_meant_is_refused(tmp_path, old, new, said):
    with pytest.raises(InputError) as error:
        load_experiment(write_experiment(tmp_path / "test", TOML + SPOT.replace(old, new)))
    assert said in error.value.what and error.value.key.startswith("heterogeneity[")


def test_a_camera_that_moves_brings_its_degrees_of_freedom(tmp_path):
    toml = TOML.replace("noise_std_gv", 'motion = "free"\nmagnification_column = "force_kN"\nnoise_std_gv')
    toml += '[[dof]]\nname = "camera.magnification_load"\n'
    experiment = load_experiment(write_experiment(tmp_path / "test", toml))
    assert {"camera.col_at[1]", "camera.turn_at[3]",
            "camera.magnification_load"} <= set(experiment.model.parameters.free)
    moved = experiment.model.camera.motion.with_values({"magnification_load": 0.03, "col_at[1]": 0.5})
    linear, shift = moved.at(1)
    assert linear == pytest.approx(1.01 * np.eye(2)) and shift == pytest.approx([0.5, 0.0])  # a third of the load
    plain = load_experiment(write_experiment(tmp_path / "plain"))
    assert plain.model.camera.motion is None and plain.model.parameters.free == ("SPECIMEN.E",)


def test_a_magnification_that_follows_no_column_is_refused(tmp_path):
    toml = TOML.replace("noise_std_gv", 'magnification_column = "strain"\nnoise_std_gv')
    with pytest.raises(InputError, match="strain"):
        load_experiment(write_experiment(tmp_path / "test", toml))


def test_a_free_course_has_one_amplitude_per_knot_and_is_linear_between_them(tmp_path):
    text = '{ kind = "rotation", course = "free", knots = 2 }, { kind = "slip", course = "free", knots = 3 }'
    toml = corrected(text).replace("noise_std = 0.005", "drift_knots = 2", 1)
    experiment = load_experiment(write_experiment(tmp_path / "test", toml))
    names = [name for name in experiment.model.parameters.free if "_knot[" in name]
    assert [name for name in names if "rotation" in name] == [f"boundary.TOP.y.rotation_knot[{k}]" for k in (2, 3)]
    assert [name for name in names if "slip" in name] == [f"boundary.TOP.y.slip_knot[{k}]" for k in (1, 2, 3)]
    drives, at = DriveTable.of(experiment), {"boundary.TOP.y.rotation_knot[2]": 0.1,
                                            "boundary.TOP.y.rotation_knot[3]": 0.3}
    histories = drives.histories(experiment.model.parameters.with_values(at))
    turned = histories[:, [i for i, name in enumerate(drives.names) if "rotation" in name]].sum(axis=1)
    half = float(np.interp(experiment.model.times[1], experiment.model.times[[0, 2]], [0.0, 0.1]))
    assert turned == pytest.approx([0.0, half, 0.1, 0.3])
    (channel,) = experiment.model.channels
    drifts = [name for name in names if name.startswith("channel.")]
    shown = [channel_values(experiment, experiment.model.parameters.with_values(dict(zip(drifts, (2.0, 5.0),
                                                                                         strict=True))),
                            np.zeros(1), k)[0] for k in range(4)]
    assert shown == pytest.approx([0.0, 20.0 * half, 2.0, 5.0])


@pytest.mark.parametrize("text, found", [
    ('{ kind = "slip", knots = 3 }', "knots"), ('{ kind = "slip", course = "free", start_s = 1.0 }', "start")])
def test_a_free_course_has_knots_and_no_start(tmp_path, text, found):
    with pytest.raises(InputError, match=found):
        load_experiment(write_experiment(tmp_path / "test", corrected(text)))


def test_the_magnification_of_a_camera_may_have_a_free_course(tmp_path):
    toml = TOML.replace("[camera]", "[camera]\nmagnification_knots = 2")
    camera = load_experiment(write_experiment(tmp_path / "test", toml)).model.camera
    assert camera.motion.names == ("magnification_knot[2]", "magnification_knot[3]")
    assert camera.motion.courses[:, [0, 2, 3]] == pytest.approx(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]))


BENT = ('[camera]\ndistance_mm = 500.0\ndeflections = [{ shape = "bow_y", column = "force_kN" }, '
        '{ shape = "buckle_x", knots = 2 }, { shape = "lean_x" }]')


def test_a_sheet_that_bends_brings_its_degrees_of_freedom(tmp_path):
    experiment = load_experiment(write_experiment(tmp_path / "test", TOML.replace("[camera]", BENT)))
    names = ["bow_y_load", "buckle_x_knot[2]", "buckle_x_knot[3]", "lean_x_drift"]
    parameters, motion = experiment.model.parameters, experiment.model.camera.motion
    assert [f"camera.{name}" for name in names] == [n for n in parameters.free if n.startswith("camera.")]
    assert motion.names == tuple(names) and motion.kinds == ("bow_y", "buckle_x", "buckle_x", "lean_x")
    assert motion.courses[0] == pytest.approx([0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0])
    assert motion.lever == pytest.approx(250.0 * experiment.model.thickness)
    nodes = experiment.model.mesh.nodes
    assert motion.ends == pytest.approx(np.array([nodes.min(axis=0), nodes.max(axis=0)]))
    bent = motion.with_values({"bow_y_load": 0.03}).deflection(1)
    assert bent.ratio(motion.ends.mean(axis=0)[None]) == pytest.approx(0.01)
    assert bent.ratio(motion.ends) == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("old, new, said", [
    ('"force_kN" }', '"force_kN", knots = 3 }', "two courses"), ('"lean_x"', '"wave_x"', "deflections"),
    ('"force_kN" }', '"strain" }', "strain"), ('"lean_x" }', '"bow_y", column = "force_kN" }', "twice")])
def test_a_deflection_that_cannot_be_meant_is_refused(tmp_path, old, new, said):
    with pytest.raises(InputError, match=said):
        load_experiment(write_experiment(tmp_path / "test", TOML.replace("[camera]", BENT.replace(old, new))))


@pytest.mark.parametrize("drive, found", [
    ("uy = 0.01", "found: none"), ('uy = { column = "still_um" }', "still_um without motion")])
def test_friction_that_no_logged_motion_directs_is_refused(tmp_path, drive, found):
    toml = TOML.replace("noise_std = 0.005", "noise_std = 0.005\nfriction_knots = 2")
    moving = load_experiment(write_experiment(tmp_path / "moving", toml)).model.parameters.free
    assert {"channel.force_kN.friction_knot[2]", "channel.force_kN.friction_knot[3]"} < set(moving)
    still = write_experiment(tmp_path / "still", toml.replace('uy = { column = "grip_um", noise_std = 0.2 }', drive))
    log = (still / "loads.csv").read_text().splitlines()
    (still / "loads.csv").write_text("\n".join([f"{log[0]},still_um", *(f"{row},3.0" for row in log[1:])]) + "\n")
    with pytest.raises(InputError) as error:
        load_experiment(still)
    assert error.value.key == "channel[0].friction_knots"
    for word in ("friction without a logged motion", found, "leave friction_knots out"):
        assert word in str(error.value)
