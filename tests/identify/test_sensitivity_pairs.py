"""Every kind of degree of freedom, two ways: the direct derivative against perturbed simulations with frozen steps.

(a) of the simulation: nodal displacement and channels; (b) of the residuals that the identification minimises: pixels
and channels, by moving the parameter and looking at what is left.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_erosion
from twin_bodies import (HOLE, PIXEL, all_rows, corrected_grips, experiment, force_on_the_right, held_left, on_the_move,
                         parametrised, photographed,
                         pulled, responses, uneven, with_hole)

from idic.correlation import build_experiment_reference, camera_at, frame_spline, global_columns, residual_map, view_of
from images.spline_reference import spline_slopes

ELASTIC = {"E": 1000.0, "nu": 0.3}
STEEL = {"E": 1000.0, "nu": 0.3, "yield_stress": 3.0}
CAMERA_DOFS = (("camera.pixel_size", PIXEL, 1e-3), ("camera.rotation_deg", 1.5, 1.0), ("camera.shift_col", 0.2, 1.0),
               ("camera.shift_row", -0.3, 1.0), ("camera.k1", 2e-6, 1e-5), ("camera.tilt_x", 1e-3, 1e-2),
               ("camera.tilt_y", -1e-3, 1e-2))
CHANNEL_DOFS = (("channel.force.scale", 1.02, 0.01), ("channel.force.offset", 0.1, 0.1),
                ("channel.force.drift", 0.02, 0.1), ("channel.force.curvature", 0.05, 0.1),
                ("channel.force.friction", 0.2, 0.1), ("channel.force.friction_share", 0.03, 0.1))
MIXED = (*held_left(), parametrised("x"), parametrised("y"))
LOADED = held_left()

BODIES = {
    "elastic": lambda **o: experiment("elastic", ELASTIC, **o),
    "elastic, finite strain": lambda **o: experiment("elastic", ELASTIC, prescribed=pulled(0.6), kinematics="finite",
                                                     **o),
    "orthotropic": lambda **o: experiment(
        "orthotropic", {"E1": 2000.0, "E2": 800.0, "nu12": 0.25, "G12": 400.0, "angle": 25.0}, **o),
    "laminate": lambda **o: experiment(
        "laminate", {"E1": 2000.0, "E2": 800.0, "nu12": 0.25, "G12": 400.0, "angle": 25.0, "stiffening_1": 6.0,
                     "stiffening_2": 3.0, "shear_softening": 0.4, "shear_exponent": 2.5, "shear_reference": 1.0,
                     "shear_damage": 0.5}, **o),
    "neo_hookean": lambda **o: experiment("neo_hookean", {"C10": 3.0, "kappa": 30.0}, prescribed=pulled(1.2),
                                          kinematics="finite", **o),
    "j2_linear": lambda **o: experiment("j2_linear", STEEL | {"hardening_modulus": 60.0}, kinematics="finite", **o),
    "j2_plateau": lambda **o: experiment("j2_plateau", STEEL | {"plateau": 0.004, "hardening_modulus": 60.0},
                                         kinematics="finite", **o),
    "j2_voce": lambda **o: experiment("j2_voce", STEEL | {"Q": 2.0, "b": 30.0, "hardening_modulus": 30.0},
                                      kinematics="finite", **o),
    "j2_power": lambda **o: experiment("j2_power", STEEL | {"K": 10.0, "n": 0.5}, kinematics="finite", **o),
    "j2_power_reference": lambda **o: experiment("j2_power_reference", STEEL | {"K0": 2.0, "n": 0.5, "ep0": 0.02},
                                                 kinematics="finite", **o),
    "mooney_rivlin": lambda **o: experiment("mooney_rivlin", {"C10": 2.0, "C01": 1.0, "kappa": 30.0},
                                            prescribed=pulled(1.2), kinematics="finite", **o),
    "free_rubber": lambda **o: experiment(
        "free_rubber", {"kappa": 30.0, "I1_range": 0.12, "I1_g1": 2.0, "I1_g2": 2.1, "I1_g3": 2.4, "I1_g4": 3.0},
        prescribed=pulled(1.2),
        kinematics="finite", **o),
    "j2_swift": lambda **o: experiment("j2_swift", {"E": 1000.0, "nu": 0.3, "K": 10.0, "eps0": 0.01, "n": 0.25},
                                       kinematics="finite", **o),
    "j2_hill": lambda **o: experiment(
        "j2_hill", STEEL | {"Q": 2.0, "b": 30.0, "hardening_modulus": 30.0, "r0": 1.8, "r45": 1.2, "r90": 2.0,
                            "angle": 20.0}, kinematics="finite", **o),
    "j2_kinematic": lambda **o: experiment(
        "j2_kinematic", STEEL | {"hardening_modulus": 30.0, "C": 60.0, "gamma": 20.0}, kinematics="finite", **o),
    "j2_chaboche": lambda **o: experiment(
        "j2_chaboche", STEEL | {"Q": -2.0, "b": 30.0, "hardening_modulus": 30.0, "C": 80.0, "gamma": 20.0},
        kinematics="finite", **o),
    "viscoplastic": lambda **o: experiment(
        "viscoplastic", STEEL | {"hardening_modulus": 60.0, "eta": 50.0, "m": 2.0}, kinematics="finite", **o),
    "maxwell": lambda **o: experiment(
        "maxwell", ELASTIC | {"g_1": 0.3, "tau_1": 0.5, "g_2": 0.2, "tau_2": 2.0, "g_3": 0.1, "tau_3": 10.0},
        kinematics="finite", prescribed=LOADED, loads=[force_on_the_right("force", 100.0)], **o),
    "free_relaxation": lambda **o: experiment(
        "free_relaxation", ELASTIC | {"shortest": 0.5, "longest": 10.0, "g_1": 0.3, "g_2": 0.2, "g_3": 0.1},
        kinematics="finite", prescribed=LOADED, loads=[force_on_the_right("force", 100.0)], **o),
    "creep": lambda **o: experiment("creep", ELASTIC | {"rate": 2e-3, "n": 2.0, "stress": 20.0}, kinematics="finite",
                                    **o),
    "elastic_damage": lambda **o: experiment(
        "elastic_damage", ELASTIC | {"threshold": 0.004, "softening": 40.0, "compression": 0.7, "length": 1.0},
        kinematics="finite", **o),
    "nonlinear_elastic": lambda **o: experiment("nonlinear_elastic", ELASTIC | {"nonlinearity": 8.0},
                                                kinematics="finite", **o),
    "j2_pressure": lambda **o: experiment("j2_pressure", STEEL | {"hardening_modulus": 60.0, "friction": 0.2},
                                          kinematics="finite", **o),
    "elastoplastic": lambda **o: experiment("elastoplastic", STEEL, kinematics="finite", **o),
    "elastoplastic, back stress": lambda **o: experiment(
        "elastoplastic(prager)", STEEL | {"backstress_1_C": 60.0}, kinematics="finite", **o),
    "egp": lambda **o: experiment(
        "egp", {"Gr": 60.0, "Sa": 3.0, "r0": 0.965, "r1": 5.0, "r2": -1.0, "tau0": 3.0, "mu": 0.2, "kappa": 600.0,
                "G1": 300.0, "eta0": 200.0},
        kinematics="finite", prescribed=LOADED, loads=[force_on_the_right("force", 80.0)], **o),
    "virtual boundary": lambda **o: experiment(prescribed=MIXED, **o),
    "thickness and time": lambda **o: experiment(
        "j2_linear", STEEL | {"hardening_modulus": 60.0}, kinematics="finite",
        extra=(("geometry.thickness", 1.5, 0.1), ("time.offset", 0.5, 0.1)), **o),
    "thickness under a force": lambda **o: experiment(
        "neo_hookean", {"C10": 3.0, "kappa": 30.0}, kinematics="finite", prescribed=LOADED,
        loads=[force_on_the_right("force", 6.0), force_on_the_right("traction", 0.5, "y")],
        extra=(("geometry.thickness", 1.5, 0.1),), **o),
    "corrected grips": lambda **o: experiment(prescribed=corrected_grips(), **o),
    "heterogeneous": lambda **o: uneven(experiment(**o)),
    "heterogeneous, yielding": lambda **o: uneven(experiment("j2_linear", STEEL | {"hardening_modulus": 60.0},
                                                             kinematics="finite", **o)),
    "hole": lambda **o: with_hole(**o),
    "hole, linear elements": lambda **o: with_hole("quad4", (4, 5, 2), **o),
    "a camera that moves": lambda **o: on_the_move(experiment(extra=CAMERA_DOFS, prescribed=pulled(0.3), **o)),
    "cameras and channels": lambda **o: experiment(extra=(*CAMERA_DOFS, *CHANNEL_DOFS), prescribed=pulled(0.3), **o),
}
# What the images say follows from the displacements, whatever the law: these are repeats where (a) holds.
LIKE_OTHERS = ("elastic, finite strain", "orthotropic", "laminate", "j2_plateau",
               "j2_voce", "j2_power", "j2_power_reference", "mooney_rivlin",
               "free_rubber", "free_relaxation", "j2_swift", "j2_hill", "j2_kinematic", "j2_chaboche",
               "viscoplastic", "maxwell",
               "creep",
               "elastic_damage", "nonlinear_elastic", "j2_pressure",
               "elastoplastic", "elastoplastic, back stress", "egp", "heterogeneous", "thickness and time")
# Gradient of f carried along by F of the element's centre, for that of g. Camera and geometry are seen through the
# gradient of u, which the columns take at the nodes: it jumps from one linear element to the next.
IMAGE_TOLERANCE = 0.01


def perturbed(parameters, name, change):
    return parameters.with_values({name: parameters[name].value + change})


def size_of_step(parameter):
    """Central differences: their own error is 1e-4², that of the solver 1e-8 / 1e-4 or less."""
    return 1e-4 * (abs(parameter.value) or parameter.scale)


def size_of_image_step(parameter):
    """Residuals are float32 (1e-5 GV), so grey values must change by some hundredths at least."""
    if parameter.name.startswith("camera."):
        return 0.05 * parameter.scale
    return 2e-3 * (abs(parameter.value) or parameter.scale)


@pytest.mark.parametrize("name", BODIES)
def test_the_simulation_changes_as_its_direct_derivative_says(name):
    body = BODIES[name]()
    parameters = body.model.parameters
    moving = [n for n in parameters.free if not n.startswith(("camera.", "channel."))]
    found, steps = responses(body, parameters, moving)
    for i, dof in enumerate(moving):
        h = size_of_step(parameters[dof])
        up, down = (responses(body, perturbed(parameters, dof, s * h), steps=steps)[0] for s in (1, -1))
        for what, derivative in (("u", "du"), ("channels", "dchannels")):
            direct = np.array([getattr(frame, derivative)[..., i] for frame in found])
            quotient = np.array([(getattr(a, what) - getattr(b, what)) / (2 * h)
                                 for a, b in zip(up, down, strict=True)])
            values = np.array([getattr(frame, what) for frame in found])
            # the solver's own error (1e-8 of the forces, or better) over the difference; curvature 1e-8
            floor = 1e-9 * np.abs(values).max(initial=0.0) / h
            error = np.abs(direct - quotient).max(initial=0.0)
            relative = 1e-3 if dof.startswith("geometry.hole") else 1e-4  # one-sided runs: curvature times 1e-4
            assert error <= relative * np.abs(direct).max(initial=0.0) + floor, (dof, what)


def test_a_traction_grows_with_the_thickness_and_a_force_does_not():
    for load, same in ((force_on_the_right("traction", 0.5, "y"), True), (force_on_the_right("force", 1.0), False)):
        body = experiment("neo_hookean", {"C10": 3.0, "kappa": 30.0}, kinematics="finite", prescribed=LOADED,
                          loads=[load], extra=(("geometry.thickness", 1.5, 0.1),))
        thin, thick = (responses(body, body.model.parameters.with_values({"geometry.thickness": t}))[0][-1].u
                       for t in (1.5, 3.0))
        assert np.allclose(thin, thick, rtol=1e-6, atol=1e-9) == same  # solver's tolerance


def test_every_law_and_every_kind_of_degree_of_freedom_is_among_the_pairs():
    from idic.images import CAMERA_PARAMETERS
    from idic.laws import all_laws

    bodies = [make() for make in BODIES.values()]
    assert {law.name if hasattr(law, "name") else law for law in all_laws()} <= {b.model.materials[0].law
                                                                                 for b in bodies}
    names = {name for body in bodies for name in body.model.parameters.free}
    kinds = {"boundary.RIGHT.x.offset", "boundary.RIGHT.y.s2t1", "geometry.thickness", "time.offset",
             *(f"camera.{p}" for p in CAMERA_PARAMETERS), *(n for n, *_ in CHANNEL_DOFS), *HOLE}
    assert kinds <= names


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.slow) if name in LIKE_OTHERS else name
                                  for name in BODIES])
def test_the_residuals_change_as_the_columns_of_the_correlation_system_say(name):
    body = photographed(BODIES[name]())
    parameters = body.model.parameters
    shared, rows, found, steps = all_rows(body, parameters)
    last = found[-1]
    column_fields = global_columns(shared, last)  # (2 n_nodes, n)
    pm = shared.reference.pixel_map
    slope = _convected_slope(shared, last)
    for i, dof in enumerate(shared.names):
        h = size_of_image_step(parameters[dof])
        up, down = (all_rows(body, perturbed(parameters, dof, s * h), steps) for s in (1, -1))
        assert_channels_follow(rows, up[1], down[1], i, h)
        L = (slope * pm.interpolate(column_fields[:, i].reshape(-1, 2))).sum(axis=1)
        quotient = -(_residual_image(up[0], up[2][-1]) - _residual_image(down[0], down[2][-1])) / (2 * h)
        seen = np.isfinite(quotient)[pm.iy, pm.ix]
        dr, L = quotient[pm.iy, pm.ix][seen], L[seen]
        if np.std(L) * h < 1e-6:  # grey values: channels, and stiffness where all motion is prescribed
            assert np.std(dr) * h < 1e-4  # float32
            continue
        assert seen.mean() > 0.98, dof  # a camera that moves takes a few pixels along the edge with it
        assert np.corrcoef(dr, L)[0, 1] > 1.0 - IMAGE_TOLERANCE, dof
        assert dr @ L / (L @ L) == pytest.approx(1.0, abs=IMAGE_TOLERANCE), dof


def assert_channels_follow(rows, up, down, i, h):
    """The columns of a parameter against the residuals of the channels a step h above and below."""
    scale = max(np.abs(row.channels.d_global[:, i]).max(initial=0.0) for _, row in rows)
    for k in range(len(rows)):
        quotient = -(up[k][1].channels.residual - down[k][1].channels.residual) / (2 * h)
        direct = rows[k][1].channels.d_global[:, i]
        assert np.all(np.abs(quotient - direct) <= 1e-3 * scale + 1e-8 / h), ("column", i, "channels", k)


def test_the_force_changes_with_the_time_offset_as_its_column_says():
    """The cheapest body; "thickness and time" above is slow."""
    body = photographed(experiment("elastic", ELASTIC, extra=(("time.offset", 0.5, 0.1),)))
    parameters = body.model.parameters
    shared, rows, _, steps = all_rows(body, parameters)
    h = size_of_image_step(parameters["time.offset"])
    up, down = (all_rows(body, perturbed(parameters, "time.offset", s * h), steps)[1] for s in (1, -1))
    assert_channels_follow(rows, up, down, shared.names.index("time.offset"), h)


@pytest.mark.parametrize("name", ["elastic", "virtual boundary", "hole", "cameras and channels"])
def test_the_right_hand_side_falls_as_the_matrix_says_when_a_parameter_leaves_the_truth(name):
    """db_i / dlam_j = -M_ij where the residual vanishes: the columns against what the images really do."""
    body = with_steady_pixels(photographed(BODIES[name]()))
    parameters = body.model.parameters
    _, rows, _, steps = all_rows(body, parameters)
    size = np.array([abs(parameters[dof].value) or parameters[dof].scale for dof in parameters.free])
    gram = sum(row.gram for _, row in rows) * size[:, None] * size  # per relative change
    seen = np.flatnonzero(np.diagonal(gram) > 1e-10 * np.diagonal(gram).max())
    norm = np.sqrt(np.diagonal(gram)[seen])
    for i, j in enumerate(seen):
        dof = parameters.free[j]
        h = size_of_image_step(parameters[dof])
        up, down = (sum(row.rhs for _, row in all_rows(body, perturbed(parameters, dof, s * h), steps)[1])
                    for s in (1, -1))
        fall = -(up - down)[seen] / (2 * h) * size[seen] * size[j] / norm / norm[i]
        camera = dof.startswith("camera.")  # seen through the gradient of u, on these 12 elements to 1.3 %
        assert np.all(np.abs(fall - gram[seen, j] / norm / norm[i]) < (2.0 if camera else 1.0) * IMAGE_TOLERANCE), dof
    assert len(seen) > 1


def with_steady_pixels(body):
    """Masked so that camera and geometry move the edge of the mesh over no pixel that counts."""
    there = body.at_geometry(body.model.parameters)
    pm = build_experiment_reference(there, camera_at(there, body.model.parameters)).pixel_map
    seen = np.isfinite(pm.to_image(np.zeros(pm.n_pixels)))
    return replace(body, recording=replace(body.recording, mask=binary_erosion(seen, iterations=3)))


def _convected_slope(shared, response):
    """F^-T grad f per pixel of the map  # (n_pixels, 2)"""
    pm, body = shared.reference.pixel_map, shared.experiment
    u_px = view_of(body, shared.camera).at(response.frame).motion(body.model.mesh.nodes, response.u)
    deformation = np.repeat(pm.deformation_gradient(u_px), pm.pixels_per_element, axis=0)
    slopes = spline_slopes(body.recording.stack.frame(0), pm.points(), 5)
    return np.linalg.solve(np.swapaxes(deformation, 1, 2), slopes[:, :, None])[:, :, 0]


def _residual_image(shared, response):
    body = shared.experiment
    found = residual_map(shared.reference, frame_spline(body, response.frame),
                         view_of(body, shared.camera).at(response.frame).motion(body.model.mesh.nodes, response.u))
    return shared.reference.pixel_map.to_image(np.where(found.valid, found.r.astype(float), np.nan))
