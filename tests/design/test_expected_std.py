"""What a design promises: the standard deviations of an identification, the laws of scaling, what cannot be known."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tifffile
from planned_tests import (ELASTIC, FORCE, GRIPS, PLAN, PLASTIC, PROGRAM, TRUE, plan_folder,
                           recorded_folder)

from idic.correlation import build_experiment_reference
from idic.errors import InputError
from idic.experiment_file import load_experiment
from idic.identification import Design, JointDesign, Plan, identify
from idic.report.design.summary import compare
from idic.identification.plan.planned_test import virtual_speckle
from idic.run.design import evaluate_plans
from idic.virtual_tests import simulate


def designed(folder, overrides=TRUE, **more):
    plan = Plan.of(folder, overrides, **more)
    return Design.of(folder.name, plan.experiment, plan.local, plan.assumptions)


def stds(design):
    return {name: design.full.std(name) for name in design.names}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    return recorded_folder(tmp_path_factory.mktemp("recorded") / "test")


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    return plan_folder(tmp_path_factory.mktemp("planned") / "plan")


@pytest.fixture(scope="module")
def identified(recorded):
    parameters = identify(load_experiment(recorded)).result["parameters"]
    return {name: parameters[name]["std"] for name in TRUE}


def test_the_design_of_a_recorded_test_promises_the_standard_deviations_that_its_identification_reports(
        recorded, identified):
    """Same pattern, noise and motion; what differs is the values (within some standard deviations)."""
    promised = stds(designed(recorded))
    for name, std in identified.items():
        assert promised[name] == pytest.approx(std, rel=0.02)


def test_without_any_image_a_virtual_speckle_of_like_size_and_contrast_promises_nearly_the_same(
        planned, recorded, identified):
    """Another draw of the speckle on 4320 pixels, some 300 independent dots: five draws scatter by 4 %."""
    experiment = load_experiment(recorded)
    pixels = build_experiment_reference(experiment, experiment.model.camera).pixel_map
    grey = experiment.recording.stack.frame(0)[pixels.iy, pixels.ix].astype(float)
    contrast = float(np.sqrt(grey.var() - experiment.recording.noise.std_gv**2))
    promised = stds(designed(planned, TRUE | {"design.contrast_gv": contrast}))
    for name, std in identified.items():
        assert promised[name] == pytest.approx(std, rel=0.1)


def test_one_photograph_of_the_speckle_is_enough_for_the_same_promise(recorded, identified, tmp_path):
    folder = plan_folder(tmp_path / "photo", ELASTIC + GRIPS + FORCE + PLAN + PROGRAM, 'images = "speckle.tif"')
    tifffile.imwrite(folder / "speckle.tif", load_experiment(recorded).recording.stack.frame(0))
    plan = Plan.of(folder, TRUE)
    assert plan.pattern == "photograph" and plan.experiment.model.n_frames == 6
    promised = stds(Design.of("photo", plan.experiment, plan.local))
    for name, std in identified.items():
        assert promised[name] == pytest.approx(std, rel=0.02)


def test_readings_that_are_not_made_yet_are_no_noise_of_the_load_cell(planned):
    """A planned channel holds zeros; what the simulation differs from them by was taken for correlated noise."""
    plan = Plan.of(planned, TRUE | {"design.n_frames": 30}).experiment
    force = plan.model.channels[0]
    made = replace(force, values=100.0 * np.random.default_rng(3).standard_normal(30))
    coming, other = (stds(Design.of("long", replace(plan, model=replace(plan.model, channels=(channel,)))))
                     for channel in (force, made))
    short = stds(designed(planned))
    for name, std in coming.items():
        assert std == pytest.approx(other[name], rel=1e-12)
        assert std < 0.75 * short[name]  # of six frames


def test_twice_the_noise_of_everything_doubles_every_standard_deviation(planned):
    once = stds(designed(planned))
    twice = stds(designed(planned, TRUE | {"channel.0.noise_std": 2.0}, noise_std_gv=4.0))
    assert [twice[name] / once[name] for name in once] == pytest.approx([2.0, 2.0], rel=1e-9)


def test_twice_the_motion_halves_the_standard_deviations_of_small_strain_elasticity(planned):
    """Sensitivities double; the convected gradient and the area in the image change by the 2 % of strain."""
    once = stds(designed(planned))
    twice = stds(designed(planned, TRUE | {"design.program.grip_mm": [[0, 0], [4, 0.24], [5, 0.2]]}))
    assert [twice[name] / once[name] for name in once] == pytest.approx([0.5, 0.5], rel=0.05)


def test_two_equal_tests_together_are_better_by_the_square_root_of_two(planned):
    """Every test has its own reference image: nothing is shared but the material."""
    one = designed(planned)
    both = JointDesign.of([one, replace(one, name="again")]).full
    for name in one.names:
        assert both.std(name) == pytest.approx(one.full.std(name) / np.sqrt(2.0), rel=1e-9)


def test_a_parameter_of_one_test_only_is_not_shared(tmp_path):
    toml = ELASTIC + GRIPS + FORCE + '[[dof]]\nname = "camera.shift_col"\n' + PLAN + PROGRAM
    plans = [designed(plan_folder(tmp_path / name, toml)) for name in ("a", "b")]
    names = JointDesign.of(plans).full.names
    assert names == ("BODY.E", "BODY.nu", "a/camera.shift_col", "b/camera.shift_col")


PLY = """
[material.BODY]
law = "orthotropic"
E1 = { value = 4000, unit = "MPa", identify = true }
E2 = { value = 2000, unit = "MPa" }
nu12 = 0.3
G12 = { value = 900, unit = "MPa" }
angle = { value = ANGLE, unit = "deg", identify = true }
"""


@pytest.fixture(scope="module")
def off_axis(tmp_path_factory):
    """Plans of a ply by the statement of its angle."""
    def planned_with(angle):
        folder = tmp_path_factory.mktemp("ply") / angle.partition(",")[0]
        ply = PLY.replace("value = ANGLE", f"value = {angle}")
        return designed(plan_folder(folder, ply + GRIPS + FORCE + PLAN + PROGRAM), {})
    return {angle: planned_with(angle) for angle in ("15", "45", "45.0, shared = false")}


def test_plans_share_what_an_identification_of_them_shares(off_axis):
    """As idic identify: directions that differ, and what says shared = false, are each specimen's own."""
    both = JointDesign.of([off_axis["15"], off_axis["45"]])
    assert both.full.names == ("BODY.E1", "15/BODY.angle", "45/BODY.angle") and not both.notes
    said = JointDesign.of([off_axis["45"], off_axis["45.0, shared = false"]]).full.names
    assert said == ("BODY.E1", "BODY.angle", "45.0/BODY.angle")


def test_an_own_direction_gains_from_another_specimen_no_more_than_the_shared_modulus_can_tell(off_axis):
    """At best E1 becomes known: the standard deviation of one parameter given all others is (Cov^-1)_ii^-1/2."""
    plans = [off_axis["15"], off_axis["45"]]
    both = JointDesign.of(plans).full
    for plan in plans:
        i, full = plan.names.index("BODY.angle"), plan.full
        given_the_rest = np.linalg.inv(full.covariance)[i, i] ** -0.5 * abs(full.scaled.slopes[i])
        assert given_the_rest * (1 - 1e-6) <= both.std(f"{plan.name}/BODY.angle") <= full.std("BODY.angle") * (1 + 1e-6)


def test_plans_that_contradict_each_other_are_refused_before_they_are_simulated(planned, tmp_path):
    known = ELASTIC.replace("nu = { value = 0.25, identify = true }", "nu = 0.25")
    other = plan_folder(tmp_path / "other", known + GRIPS + FORCE + PLAN + PROGRAM)
    with pytest.raises(InputError, match="stated in two ways"):
        evaluate_plans([planned, other], workers=0)


def test_plans_may_state_a_modulus_in_several_units(planned, tmp_path):
    other = plan_folder(tmp_path / "other", ELASTIC.replace('1200, unit = "MPa"', '1.2, unit = "GPa"')
                        + GRIPS + FORCE + PLAN + PROGRAM)
    plans = [designed(planned, {}), designed(other, {})]
    both = JointDesign.of(plans)
    assert both.full.names == ("BODY.E", "BODY.nu") and not both.notes
    assert both.full.std("BODY.E") == pytest.approx(plans[0].full.std("BODY.E") / np.sqrt(2.0), rel=1e-9)


def test_without_force_the_modulus_is_open_and_poissons_ratio_is_not(tmp_path):
    design = designed(plan_folder(tmp_path / "plan", ELASTIC + GRIPS + PLAN + PROGRAM))
    assert design.full.std("BODY.E") is None and design.full.std("BODY.nu") is not None
    (entry,) = design.full.summary()["not_identifiable"]
    assert entry["name"] == "BODY.E" and entry["reason"].startswith("no force")


def test_the_images_alone_are_compared_with_images_and_force(planned):
    design = designed(planned)
    assert design.full.std("BODY.E") is not None and design.image.std("BODY.E") is None
    assert design.full.std("BODY.nu") <= design.image.std("BODY.nu") * (1.0 + 1e-9)


def test_modulus_and_thickness_are_found_to_be_one_product(tmp_path):
    toml = ELASTIC + GRIPS + FORCE + '[[dof]]\nname = "geometry.thickness"\n' + PLAN + PROGRAM
    design = designed(plan_folder(tmp_path / "plan", toml))
    assert design.full.std("BODY.E") is None and design.full.std("geometry.thickness") is None
    weak = design.full.spectrum.vectors[:, -1]  # ln E, nu, ln t
    assert not design.full.spectrum.determined[-1]
    assert weak / weak[0] == pytest.approx([1.0, 0.0, -1.0], abs=1e-6)
    assert design.materials.std("BODY.E") is not None  # were the thickness known


def test_a_test_that_goes_on_into_yielding_knows_the_hardening_and_a_short_one_does_not(tmp_path):
    """15 MPa are reached at a grip motion of some 0.03 mm."""
    folder = plan_folder(tmp_path / "plan", PLASTIC + GRIPS + FORCE + PLAN + PROGRAM)
    long = designed(folder, {})
    short = designed(folder, {"design.program.grip_mm": [[0, 0], [5, 0.015]]})
    assert long.full.std("BODY.hardening_modulus") is not None
    assert short.full.std("BODY.hardening_modulus") is None and short.full.std("BODY.yield_stress") is None
    assert short.full.std("BODY.E") is not None
    begins = long.growth_frames[np.isfinite(long.growth[:, long.names.index("BODY.hardening_modulus")])]
    assert begins[0] > 1  # elastic frames say nothing of it
    assert np.allclose(long.growth[-1], [long.full.std(name) for name in long.names], rtol=1e-12)


def test_the_motion_of_a_parameter_is_that_of_a_perturbed_simulation(planned):
    """max |nu dU/dnu| in px against a difference quotient of two simulations."""
    from idic.model import build_forward, solve

    design, step = designed(planned), 1e-4
    field = next(f for f in design.fields if f.name == "BODY.nu")
    experiment = design.experiment
    forward = build_forward(experiment)
    u = [solve(forward, experiment.model.parameters.with_values({"BODY.nu": 0.35 + s})).u[field.frame]
         for s in (step, -step)]
    nodes, camera = experiment.model.mesh.nodes, experiment.model.camera
    moved = (camera.project(nodes + u[0]) - camera.project(nodes + u[1])) / (2 * step) * 0.35
    assert np.allclose(field.phi, moved, atol=1e-6 * field.largest)
    assert field.largest == pytest.approx(np.linalg.norm(moved, axis=1).max(), rel=1e-6)


KINEMATIC = """
[material.BODY]
law = "j2_kinematic"
E = { value = 2000, unit = "MPa", identify = true }
nu = 0.35
yield_stress = { value = 15, unit = "MPa", identify = true }
hardening_modulus = { value = 100, unit = "MPa", identify = true }
C = { value = 200, unit = "MPa", identify = true }
gamma = 0.0
"""


def test_unloading_tells_kinematic_from_isotropic_hardening(tmp_path):
    """Under one load path both only raise the stress; the way back shows the shifted yield surface."""
    folder = plan_folder(tmp_path / "plan", KINEMATIC + GRIPS + FORCE + PLAN + PROGRAM)
    forth = designed(folder, {"design.program.grip_mm": [[0, 0], [5, 0.12]], "design.n_frames": 12})
    back = designed(folder, {"design.program.grip_mm": [[0, 0], [2.5, 0.12], [5, 0.0]], "design.n_frames": 12})
    for name in ("BODY.hardening_modulus", "BODY.C"):
        assert back.full.std(name) < (0.2 * forth.full.std(name) if forth.full.std(name) else np.inf)


VIRTUAL = """
[[boundary]]
nodes = "LEFT"
ux = 0.0
uy = 0.0
[[boundary]]
nodes = "RIGHT"
ux = { virtual = "polynomial", modes = 2, time_modes = 2 }
uy = 0.0
"""


def test_a_boundary_to_be_found_costs_precision_of_the_material(tmp_path):
    course = '[design.program]\n"RIGHT.ux" = [[0, 0], [5, 0.12]]\n'
    design = designed(plan_folder(tmp_path / "plan", ELASTIC + VIRTUAL + FORCE + PLAN + course))
    for name in TRUE:
        assert design.full.std(name) > design.materials.std(name) > 0.0
    assert design.motion_px[-1] == pytest.approx(2.0, rel=0.02)  # 0.12 mm of 0.06 mm px


def test_a_measured_edge_moves_along_its_course(tmp_path):
    edges = '[[boundary]]\nnodes = "LEFT"\nu = "measured"\n[[boundary]]\nnodes = "RIGHT"\nu = "measured"\n'
    courses = "".join(f'"{key}" = [[0, 0], [5, {top}]]\n' for key, top in
                      (("RIGHT.ux", 0.12), ("RIGHT.uy", 0.0), ("LEFT.ux", 0.0), ("LEFT.uy", 0.0)))
    design = designed(plan_folder(tmp_path / "plan", ELASTIC + edges + PLAN + "[design.program]\n" + courses))
    exact = designed(plan_folder(tmp_path / "exact", ELASTIC + GRIPS + PLAN + "[design.program]\n"
                                 "grip_mm = [[0, 0], [5, 0.12]]\n"))
    assert design.motion_px == pytest.approx(exact.motion_px)
    assert design.full.std("BODY.nu") > exact.full.std("BODY.nu")  # what the grips said, the images must now say


def test_a_plan_in_which_nothing_moves_is_refused(tmp_path):
    folder = plan_folder(tmp_path / "plan", ELASTIC + VIRTUAL + FORCE + PLAN)
    with pytest.raises(InputError, match="nothing moves"):
        designed(folder)


def test_the_virtual_speckle_has_the_size_and_the_contrast_that_were_asked_for():
    image = virtual_speckle((160, 200), 4.0, 40.0).astype(float)
    assert image.shape == (160, 200) and image.std() == pytest.approx(40.0, rel=0.01)
    centred = image - image.mean()
    along = [np.mean(centred[:, d:] * centred[:, :200 - d]) / centred.var() for d in (0, 2, 4, 8)]
    # dots of sigma 1.6 px: exp(-d²/(4 sigma²)) = 0.68, 0.21, 0.00; pixel area and non-linearity change that slightly
    assert along == pytest.approx([1.0, 0.68, 0.21, 0.0], abs=0.08)


@pytest.mark.parametrize("size_px, contrast_gv, bits", [(None, None, 8), (12.0, 15.0, 12)])
def test_a_planned_test_is_simulated_with_the_speckle_that_its_design_assumes(tmp_path, size_px, contrast_gv, bits):
    """Contrast, and correlation of pixels 4 px apart. 4320 pixels with some 300 dots (as large ones: 40) know a
    standard deviation to 4 % (10 %); three of them."""
    given = {} if size_px is None else {"design.speckle_px": size_px, "design.contrast_gv": contrast_gv}
    simulate(plan_folder(tmp_path / "plan"), tmp_path / "made", given | {"design.n_frames": 2}, bits, noise_std_gv=0.0)
    experiment = load_experiment(tmp_path / "made")
    image = experiment.recording.stack.frame(0).astype(float) / 2**(bits - 8)
    pixels = build_experiment_reference(experiment, experiment.model.camera).pixel_map
    assumed = virtual_speckle((400, 400), size_px or 4.0, contrast_gv or 50.0).astype(float)
    seen = np.full(image.shape, np.nan)
    seen[pixels.iy, pixels.ix] = image[pixels.iy, pixels.ix]
    assert np.nanstd(seen) == pytest.approx(assumed.std(), rel=0.12 if size_px is None else 0.3)
    assert np.nanmean(seen) == pytest.approx(assumed.mean(), abs=0.4 * assumed.std())
    assert correlation(seen) == pytest.approx(correlation(assumed), abs=0.12)


def correlation(image, distance=4):
    """Of pixels that are so far apart along a row."""
    centred = image - np.nanmean(image)
    return float(np.nanmean(centred[:, distance:] * centred[:, :-distance]) / np.nanvar(centred))


@pytest.mark.slow
def test_a_reduced_domain_with_virtual_edges_costs_conditioning(tmp_path):
    """The same images: the whole specimen with known grips, or the part in view with edges that are unknowns."""
    sys.path.append(str(Path(__file__).parents[1] / "twins"))
    from reduced_domains import clean_images, write_case

    clean = clean_images("plate")
    full, reduced = (designed(write_case(tmp_path / route, "plate", route, clean).parent, {})
                     for route in ("full", "bspline"))
    for name in full.names:
        assert reduced.full.std(name) > full.full.std(name)
        assert reduced.full.std(name) > reduced.materials.std(name)


def test_plans_in_other_units_are_compared_in_one():
    def plan(name, std, unit):
        return {"name": name, "condition": 1.0, "parameters": {"s.E": {"std": std, "unit": unit}}}

    joint = {"parameters": {"s.E": {"unit": "GPa", "value": 70.0, "std": 0.09}}, "condition": 1.0}
    found = compare({"plans": [plan("a", 0.5, "GPa"), plan("b", 100.0, "MPa"), plan("c", 0.01, "px")], "joint": joint})
    assert found["parameters"]["s.E"]["std"] == {"a": 0.5, "b": pytest.approx(0.1)}
    assert found["parameters"]["s.E"]["best"] == "b"
    found = compare({"plans": [plan("a", 0.5, "GPa"), plan("c", 0.01, "px")], "joint": joint})
    assert found["parameters"]["s.E"]["best"] is None
