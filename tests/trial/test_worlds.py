"""Trials in drawn worlds: specimens, bricks, kinds kept from development, scores."""

import json
from dataclasses import replace

import numpy as np
import pytest

from idic.diagnose.residual.heldout import grid_of, misfit_of
from idic.diagnose import residual_evidence
from idic.errors import InputError
from idic.experiment_file import load_experiment
from idic.identification import identify
from idic_studies.trial.evaluation import TrialRecord, _implied, generated_values, told_as_cut
from idic_studies.trial.kinds import BEYOND, LIBRARY, is_unseen
from idic_studies.trial.plan import (CLEAR, KNOWN_WORLDS, WORLDS, Campaign, Truth, draw, effect_named,
                                       scene_of)
from idic_studies.trial.pool import target_table
from idic_studies.trial.scenes import solve as solve_module
from idic_studies.trial.scenes.recording import MODEL, Paint, model_mesh, write_public
from idic_studies.trial.scenes.scene import NULLS, Geometry, plain_scene
from idic_studies.trial.scenes.solve import DIVISIONS, Motion, campaign_mesh, solve, true_mesh
from idic_studies.trial.scenes.specimens import SPECIMENS, bricks, specimen_mesh
from idic_studies.trial.scenes.worlds import as_solid, drawn_world, view_of, world_geometry, world_scene
from idic_studies.trial.seal import Folder, seal
from idic_studies.trial.tool_run import FolderSource
from idic_studies.trial.world_scores import world_goals
from idic_studies.trial.world_strength import amplitude_in

WORLD = {"specimen": "hole", "columns": 132, "frames": 16, "programme": "monotonic", "thickness": 1.5, "solid": False,
         "finite": False, "noise": "white"}


def area(mesh):
    """By the corners of the elements."""
    x = mesh.nodes[mesh.blocks[0].connectivity[:, :4]]
    a, b = x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]
    return 0.5 * float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())


@pytest.mark.parametrize("columns", [150, 400])
def test_the_true_mesh_is_finer_than_the_users_whatever_the_images(columns):
    """It was coarser in large ones, and clean D-shapes were told an orthotropy of the truth's own mesh."""
    for kind in SPECIMENS:
        scene = world_scene(WORLD | {"specimen": kind, "columns": columns}, "elastic", 1.0, NULLS["elastic"].truth)
        true, users = campaign_mesh(scene), model_mesh(scene.geometry, scene.view)
        assert true.n_elements > 1.9 * users.n_elements, kind
    yielding = replace(scene, law="j2_linear")
    assert users.n_elements < campaign_mesh(yielding).n_elements <= true.n_elements


@pytest.mark.parametrize("kind", SPECIMENS)
def test_a_specimen_fills_its_outline_and_the_image_shows_all_of_it(kind):
    geometry = world_geometry(WORLD | {"specimen": kind}, 1.0)
    mesh = specimen_mesh(geometry, DIVISIONS, "BODY")
    plate, removed = geometry.length * geometry.width, np.pi * geometry.radius**2
    wanted = {"hole": plate - removed, "two_holes": plate - 2.0 * removed, "bending": plate,
              # bells of the radius' height and width; a parabola that falls by twice the radius over the half length
              "notches": plate - 2.0 * np.sqrt(np.pi) * geometry.radius**2,
              "shear": plate - 2.0 * np.sqrt(np.pi) * geometry.radius**2,
              "d_shape": plate - geometry.length * (geometry.radius - 2.0 * geometry.radius * (0.25 - 1.0 / 12.0))}
    assert area(mesh) == pytest.approx(wanted[kind], rel=5e-3)
    assert {"LEFT", "RIGHT"} <= set(mesh.node_sets) and len(np.unique(mesh.nodes.round(6), axis=0)) == mesh.n_nodes
    view = view_of(geometry, 200)
    assert view.shape[1] == 200 and (np.ptp(mesh.nodes, axis=0)[::-1] < np.array(view.shape) * view.pixel).all()
    for null in ("elastic", "rubber"):
        scene = world_scene(WORLD | {"specimen": kind}, null, 1.0, NULLS[null].truth)
        half = np.array(scene.view.shape)[::-1] * scene.view.pixel / 2.0
        assert (np.abs(mesh.nodes).max(axis=0) + np.abs(scene.grip).max() < half).all()  # at the end of the motion, too


def test_bricks_have_the_nodes_of_the_surface_first_and_its_volume():
    flat = specimen_mesh(world_geometry(WORLD, 1.0), (3, 3, 2), "BODY")
    solid = bricks(flat, 0.75)
    np.testing.assert_array_equal(solid.nodes[:flat.n_nodes, :2], flat.nodes)
    np.testing.assert_array_equal(solid.node_labels[:flat.n_nodes], flat.node_labels)
    assert (solid.nodes[:flat.n_nodes, 2] == 0.75).all() and (solid.nodes[solid.node_sets["MIDDLE"], 2] == 0.0).all()
    x = solid.nodes[solid.blocks[0].connectivity[:, :8]]
    edges = np.stack([x[:, 1] - x[:, 0], x[:, 3] - x[:, 0], x[:, 4] - x[:, 0]], axis=1)
    assert (np.linalg.det(edges) > 0.0).all()  # corners turn as those of C3D20R do


def test_a_right_end_that_moves_across_loads_the_load_cell_across():
    world = WORLD | {"specimen": "bending", "frames": 3}
    motion = solve(world_scene(world, "elastic", 1.0, NULLS["elastic"].truth))
    geometry, E, grip = SPECIMENS["bending"], 2000.0, 4.0 * NULLS["elastic"].grip
    slender = 12.0 * E * (1.5 * geometry.width**3 / 12.0) * grip / geometry.length**3  # clamped on both sides
    shear = 1.0 + 2.0 * 1.35 * 1.2 * (geometry.width / geometry.length) ** 2  # Timoshenko, nu 0.35, shear area 5/6
    assert motion.force[-1] == pytest.approx(slender / shear, rel=0.05)  # the clamps hold the section, 3 % measured


def test_a_third_of_the_kinds_is_kept_from_development():
    kinds = {**LIBRARY, **BEYOND}
    unseen = {kind for kind in kinds if is_unseen(kind)}
    assert len(unseen) >= len(kinds) / 3 and unseen & set(LIBRARY) and unseen & set(BEYOND)
    shown = {name for trial in Campaign(KNOWN_WORLDS).trials for name, _ in trial.effects}
    assert not shown & unseen
    assert unseen <= {name for trial in Campaign(WORLDS).trials for name, _ in trial.effects}


@pytest.mark.parametrize("tool", [{"commit": "abc", "changed": True}, {"commit": "", "changed": None}])
def test_unseen_kinds_are_refused_to_a_tool_that_is_not_frozen(tool, tmp_path):
    with pytest.raises(InputError, match="development must not see"):
        seal(Folder(tmp_path), Campaign(WORLDS), (), {"version": "0", "thresholds": {}} | tool)
    seal(Folder(tmp_path), Campaign(WORLDS), (), {"version": "0", "thresholds": {}, "commit": "abc", "changed": False})


def test_a_truth_in_a_world_survives_its_file():
    truth = Truth("singles/orthotropy-clear-0", "elastic", (("orthotropy", "clear"),), "", (0.5,), {"radius": 1.1},
                  {"E": 2000.0, "nu": 0.35}, {"texture": 1, "noise": 2}, 3, "calculix", WORLD | {"solid": True})
    assert Truth.read(json.loads(json.dumps(truth.content))) == truth
    scene = scene_of(truth)
    assert scene.solid and scene.law == "orthotropic" and len(scene.times) == 16
    assert not scene_of(replace(truth, world=WORLD)).solid


@pytest.mark.slow  # 10 s of CPU time: two worlds are identified
def test_a_world_that_shows_nothing_of_its_effect_is_drawn_again():
    """The first one moves evenly: a rolling shutter shows by 0.03 standard deviations there."""
    trial, = Campaign(KNOWN_WORLDS, 8123).select(["outside/rolling_shutter-0"])
    truth = draw(trial, 8123)
    assert (truth.world["columns"], truth.world["frames"]) != (158, 18)
    _, shown = amplitude_in(truth.world, truth.null, truth.parameters, effect_named("rolling_shutter"), CLEAR)
    assert shown


@pytest.mark.slow  # 8 s of CPU time: rubber is identified
def test_a_specimen_that_leaves_the_image_leaves_no_excess(tmp_path):
    scene = world_scene(WORLD | {"columns": 140, "frames": 40}, "rubber", 1.0, NULLS["rubber"].truth)
    scene = replace(scene, view=view_of(scene.geometry, 140))  # shows the end until it has moved by half a millimetre
    found = identify(load_experiment(tmp_path, stack=write_public(tmp_path, scene, solve(scene), Paint(1, 2))))
    residual = residual_evidence(found)
    pixels = {one.n_pixels for one in found.point.system.frames}
    assert min(pixels) < 0.95 * max(pixels) and residual.evidence.n_pixels % len(residual.evidence.frames) == 0
    assert abs(misfit_of(residual, grid_of(residual)).excess_z) < 3.0  # 4.6 with pixels that some frames do not show


@pytest.mark.parametrize(("null", "law", "world", "implied"), [
    ("elastic", "elastic", {}, False), ("elastic", "elastic", {"solid": True}, True),
    ("elastic", "elastic", {"solid": True, "finite": True}, False), ("elastic", "maxwell", {}, True),
    ("plastic", "j2_voce", {}, False)])
def test_finite_strains_under_a_law_of_small_ones_are_in_the_truth(null, law, world, implied):
    scene = as_solid(WORLD | world, world_scene(WORLD | world, null, 1.0, NULLS[null].truth))
    scene = replace(scene, law=law)
    assert (scene.has_finite_strains and scene.user_has_small_strains) is implied


def test_the_truth_of_a_law_with_a_memory_has_no_error_in_time(monkeypatch):
    """Metal under reversed load, 18 frames: three increments per frame leave 0.002 px, which a diagnosis names."""
    world = WORLD | {"programme": "reversed", "frames": 18, "columns": 396}
    scene = world_scene(world, "plastic", 1.0, NULLS["plastic"].truth)
    mesh = specimen_mesh(scene.geometry, MODEL, "BODY")
    given = solve(scene, mesh)
    with monkeypatch.context() as finer:
        finer.setattr(solve_module, "INCREMENTS_WITH_MEMORY", 8)
        exact = solve(scene, mesh)
    monkeypatch.setattr(solve_module, "has_memory", lambda scene: False)  # three increments, not extrapolated
    coarse = solve(scene, mesh)
    off = [np.sqrt(np.mean((one.u - exact.u) ** 2, axis=(1, 2))).max() / scene.view.pixel for one in (given, coarse)]
    assert off[0] < 0.00015 and off[1] > 0.001  # px


@pytest.mark.parametrize(("null", "solver", "implied"), [("plastic", "calculix", True), ("plastic", "built-in", False),
                                                         ("elastic", "calculix", False)])
def test_the_flow_stress_of_calculix_is_a_cauchy_stress(null, solver, implied):
    """2 % strain: J = 1.0045 at the yield stress; in idic's Kirchhoff stress tension yields later than compression."""
    truth = Truth("clean/0", null, (), "", (), {"radius": 1.0}, dict(NULLS[null].truth), {}, 1, solver, WORLD)
    scene = scene_of(truth)
    assert ("pressure_dependence" in _implied(truth)) is implied
    if null == "plastic":
        values = scene.values
        ratio = generated_values(truth, scene)["yield_stress"] / values["yield_stress"]
        assert ratio == pytest.approx(1.0 + implied * (1.0 - 2.0 * values["nu"]) * values["yield_stress"] / values["E"])


@pytest.mark.parametrize(("noise", "ratio"), [("white", 1.0), ("photons", np.sqrt(1.0 + 127.5 / 255.0))])
def test_the_tool_counts_the_noise_that_the_images_show(noise, ratio, tmp_path):
    scene = world_scene(WORLD | {"frames": 4, "noise": noise}, "elastic", 1.0, NULLS["elastic"].truth)
    mesh = true_mesh(scene)
    still = Motion(mesh, np.zeros((4, mesh.n_nodes, 2)), np.linspace(0.0, 9.0, 4))
    source = FolderSource.of(tmp_path, write_public(tmp_path, scene, still, Paint(1, 2)))
    stated = source.load().recording.noise
    found = source.with_measured_noise().with_edits({"camera.k1": 1e-7}).load().recording.noise
    assert (found == stated) if noise == "white" else found.std_gv == pytest.approx(ratio * stated.std_gv, rel=0.05)


def test_damage_is_never_drawn_without_unloading():
    rng = np.random.default_rng(1)
    assert {drawn_world(rng, ["damage"], "elastic")["programme"] for _ in range(20)} == {"unloading"}


def record(key, truth, named=(), verdict="single", **more):
    """A made-up record; more : its other fields."""
    given = {"strength": "clear", "solver": "", "reported": named, "alarm": verdict != "none", "family_first": False,
             "inside": bool(truth) and set(truth) <= set(named), "as_set": False, "side_right": False,
             "onset_error": None, "overlap": None, "excess_ratio": None, "drop_ratio": None, "bias_before": None,
             "bias_ratio": None, "blocks_better": None, "cpu_s": 1.0, "attempt": 1, "ablations": None, "sentence": "",
             "world": WORLD}
    return TrialRecord(key=key, number="0", truth=tuple(truth), verdict=verdict, named=tuple(named), **given | more)


def test_the_scores_count_what_they_say():
    records = [
        record("singles/creep-clear-0", ["creep"], ["creep"], probability=0.9, intervals=(2, 2)),
        record("singles/creep-clear-1", ["creep"], ["damage"], probability=0.8, false_physics=True, unseen=True),
        record("singles/creep-clear-2", ["creep"], [], "outside_library", side_right=True),
        record("clean/0", [], [], "none", probability=1.0, intervals=(1, 2)), record("clean/1", [], ["creep"]),
        record("clean/2", [], ["geometric_nonlinearity"], probability=0.9, alarm=False)]  # bricks of finite strains
    got = {goal.what.partition(":")[0].partition(" (")[0]: goal for goal in world_goals(records)}
    assert got["alarms on clean recordings"].got.startswith("1 of 3")
    assert got["false physics"].got.startswith("1 of 6") and not got["false physics"].met
    assert got["cause in the set, or its side flagged"].got.startswith("2 of 3")
    assert got["95 % intervals of the last model that hold the truth"].got.startswith("3 of 4")
    assert got["Brier score of the probability"].got == "0.165 (n = 4)"  # 0.01, 0.64, 0, 0.01 by four
    header, *rows = target_table(records).splitlines()
    assert "unseen kinds" in header and any("≤ 3 %" in row and "1 of 1" in row for row in rows)


@pytest.mark.parametrize(("form", "at", "right"), [("void", (0.1, 1.6), True), ("void", (0.1, 3.5), False),
                                                   ("void", (-1.0, 1.6), False), ("inclusion", (0.1, 1.6), False)])
def test_a_slit_that_is_called_a_cut_at_its_place_is_no_false_physics(form, at, right):
    """From the edge of the hole at 1.2 mm to 2.4 mm, above its middle; radius of the void 0.5 mm."""
    scene = replace(plain_scene("elastic", Geometry(radius=1.2), NULLS["elastic"].truth), slit=1.2)
    found = {"x": at[0], "y": at[1], "radius": 0.5}
    answer = {"candidates": [{"name": "heterogeneity", "form": form, "named": True}],
              "model": {"parameters_after": {f"BODY.inclusion.{name}": {"value": v} for name, v in found.items()}}}
    assert told_as_cut(scene, answer) is right
    assert not told_as_cut(replace(scene, slit=0.0), answer)


@pytest.mark.parametrize(("start", "direction", "right"), [((0.0, 1.2), 90.0, True), ((0.2, 1.3), 110.0, True),
                                                           ((0.0, 1.2), 0.0, True), ((0.0, -1.2), -90.0, False)])
def test_a_slit_that_is_called_a_crack_at_its_place_is_no_false_physics(start, direction, right):
    """The same slit; the crack is 1.5 mm long. Its direction is not judged, its place is."""
    scene = replace(plain_scene("elastic", Geometry(radius=1.2), NULLS["elastic"].truth), slit=1.2)
    crack = {"start_mm": list(start), "direction_deg": direction, "length_mm": [0.0, 0.9, 1.5]}
    answer = {"candidates": [{"name": "crack", "named": True}], "cracks": {"suspect": crack}, "model": {}}
    assert told_as_cut(scene, answer) is right
