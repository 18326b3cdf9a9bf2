"""Candidates of the boundary, force, camera and heterogeneity families: named where they are, silent where not, and
recovered by the experiment that they enrich.
"""

from __future__ import annotations

import numpy as np
import pytest
from matrix_of_sides import BULGE, CURVATURE, DISTANCE, FRICTION, LOAD, SEATING, SIDES, TIMES, shaken
from side_twins import PIXEL, RADIUS, TOML, TRUTH, Side, refit, screening, write_folder

from idic.diagnose import candidate_library
from idic.images import Camera

OWN = tuple(c.name for c in candidate_library() if c.family in ("boundary", "force", "camera", "heterogeneity"))
LINEAR = tuple(name for name in OWN if name not in ("heterogeneity", "camera_motion"))
FEW = tuple(name for name in LINEAR if name not in ("grip_slip", "grip_rotation", "hole_geometry"))  # quick columns

# truth of the degree of freedom that the winning variant adds, where there is one number
AMPLITUDES = {"force_offset": 1.5, "force_drift": 0.3, "frame_time_offset": 0.06, "grip_rotation": 0.0015 / 0.12,
              "machine_compliance": 3e-5, "lens_distortion": 2e-6, "magnification": 4e-4 / TIMES[-1],
              "friction": FRICTION, "load_cell_curvature": CURVATURE * (1.0 + CURVATURE),  # over the largest reading
              "seating": SEATING, "hole_geometry": 1.03 * RADIUS, "pixel_size": PIXEL / 1.02, "camera_rotation": 0.5,
              "origin": 0.8, "parallax": 0.004, "sheet_bending": BULGE / DISTANCE, "specimen_motion": BULGE / DISTANCE}


@pytest.fixture(scope="module")
def twin(tmp_path_factory):
    """Folder of an effect, written once."""
    folder, made = tmp_path_factory.mktemp("sides"), {}

    def path(name):
        if name not in made:
            made[name] = write_folder(folder / name, SIDES[name])
        return made[name]

    return path


def test_every_candidate_of_these_sides_is_in_the_library_and_complete():
    library = {candidate.name: candidate for candidate in candidate_library()}
    assert set(OWN) <= set(library)
    for name in OWN:
        assert library[name].rivals and library[name].separating_tests and library[name].null


def test_a_clean_record_names_nothing(twin):
    found, result = screening(twin("clean"), FEW)
    assert not result.significant
    assert found.parameters["BODY.E"].value == pytest.approx(TRUTH["E"], rel=0.005)  # three standard deviations


@pytest.mark.parametrize("name", ["machine_compliance", *(pytest.param(name, marks=pytest.mark.slow)
                                                              for name in ("friction", "pixel_size",
                                                                           "sheet_bending"))])
def test_an_effect_is_ranked_first_and_its_amplitude_and_the_modulus_are_recovered(twin, name):
    found, result = screening(twin(name), FEW)
    _first_and_recovered(twin(name), name, found, result)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(AMPLITUDES))
def test_every_effect_is_ranked_first_among_all_candidates_and_recovered(twin, name):
    found, result = screening(twin(name), None)
    _first_and_recovered(twin(name), name, found, result)


def _first_and_recovered(path, name, found, result):
    best = result.ranked[0]
    assert best.candidate.name == name and best.standing == "significant"
    again = refit(path, best.variant).result["parameters"]
    dof = again[best.variant.new[0]]
    assert abs(dof["value"] - AMPLITUDES[name]) < 3.0 * dof["std"]
    assert abs(again["BODY.E"]["value"] - TRUTH["E"]) < 3.0 * again["BODY.E"]["std"]
    assert abs(again["BODY.E"]["value"] - TRUTH["E"]) < max(abs(found.parameters["BODY.E"].value - TRUTH["E"]),
                                                            3.0 * again["BODY.E"]["std"])


@pytest.mark.slow  # 8 s of CPU time
def test_a_thickness_is_the_modulus_where_that_is_free_and_found_where_it_is_known(twin, tmp_path):
    _, result = screening(twin("thickness"), ("thickness", "force_offset"))
    assert result.of("thickness").visibility < 1e-6 and result.of("thickness").standing == "cannot_tell"
    known = TOML.replace("E = { value = 1800, unit = \"MPa\", identify = true }", f"E = {TRUTH['E']}")
    path = write_folder(tmp_path / "known", SIDES["thickness"], toml=known)
    _, result = screening(path, ("thickness", "force_offset", "force_drift"))
    assert result.ranked[0].candidate.name == "thickness" and result.ranked[0].standing == "significant"
    found = refit(path, result.ranked[0].variant).result["parameters"]["geometry.thickness"]
    assert abs(found["value"] - 1.03 * 1.5) < 3.0 * found["std"]


LATE = {"force_drift": (Side(force=lambda F: F + 2.0 * np.maximum(TIMES - 5.5, 0.0)), 5.5),
        "grip_rotation": (Side(motion={("RIGHT", "x"): np.column_stack([0.0 * TIMES,
                                                                        0.003 * np.maximum(TIMES - 5.5, 0.0) / 5.5])}),
                          5.5)}


@pytest.mark.slow
@pytest.mark.parametrize("name", LATE)
def test_an_effect_that_begins_in_the_middle_of_the_test_is_named_with_its_beginning(name, tmp_path):
    side, begins = LATE[name]
    _, result = screening(write_folder(tmp_path / name, side), None)
    best = result.ranked[0]
    assert best.candidate.name == name
    start = float(best.variant.label.split("from ")[1].split(" s")[0])
    assert abs(start - begins) <= 2.2  # the grid of onsets: a fifth of the test


@pytest.mark.slow
def test_a_platen_that_tilts_until_it_touches_everywhere_is_a_grip_that_turns_and_no_seating(tmp_path):
    """The tilt closes under the first seventh of the load, as a toe does; the mean motion loses nothing."""
    closing = -0.0015 * (1.0 - np.exp(-LOAD / 0.15))
    side = Side(motion={("RIGHT", "x"): np.column_stack([0.0 * TIMES, closing])})
    _, result = screening(write_folder(tmp_path / "platen", side), ("grip_rotation", "seating", "machine_compliance",
                                                                  "grip_slip", "orthotropy"), own_courses=True)
    assert result.ranked[0].candidate.name == "grip_rotation"
    assert result.of("seating").standing != "significant"


@pytest.mark.slow
def test_a_pin_that_turns_with_friction_is_a_grip_that_turns_with_a_course_of_its_own(tmp_path):
    """Held by mu r F the end turns by a third of its free angle on the way up, sticks at first on the way down, and
    slips again where friction has changed its sign: 1 F up, 3 F down."""
    stuck = np.where(TIMES <= 8.0, LOAD, np.minimum(1.0, 3.0 * LOAD))
    side = Side(motion={("RIGHT", "x"): np.column_stack([0.0 * TIMES, -0.0015 * stuck])})
    path = write_folder(tmp_path / "pin", side)
    _, result = screening(path, ("grip_rotation", "seating", "machine_compliance", "grip_slip", "orthotropy",
                                 "friction", "camera_motion", "sheet_bending", "specimen_motion"), own_courses=True)
    assert result.ranked[0].candidate.name == "grip_rotation"
    turns = next(trial for trial in result.trials if trial.variant.free_course
                 and trial.variant.new[0].startswith("boundary.RIGHT.x.rotation_knot"))
    again = refit(path, turns.variant).result["parameters"]
    for name, k in ((name, int(name.partition("[")[2][:-1])) for name in turns.variant.new):
        assert abs(again[name]["value"] - 0.0015 * stuck[k]) < 3.0 * again[name]["std"] + 5e-5, name
    assert abs(again["BODY.E"]["value"] - TRUTH["E"]) < 3.0 * again["BODY.E"]["std"]


def test_a_factor_of_the_force_is_indistinguishable_from_the_modulus_and_reported_as_invisible(twin):
    found, result = screening(twin("force_scale"), ("force_scale", "force_offset"))
    assert result.of("force_scale").visibility < 1e-6 and result.of("force_scale").standing == "cannot_tell"
    assert found.parameters["BODY.E"].value == pytest.approx(1.03 * TRUTH["E"], rel=0.005)


@pytest.mark.slow
def test_a_slip_is_named_and_the_refit_finds_its_onset(twin):
    path = twin("grip_slip")
    _, result = screening(path, LINEAR)
    assert result.ranked[0].candidate.name == "grip_slip"
    fits = {trial.variant.label: refit(path, trial.variant) for trial in result.trials
            if trial.variant.label.startswith("RIGHT slips slowly along x")}
    label, best = min(fits.items(), key=lambda item: item[1].point.system.phi)
    assert label.endswith("from 4.4 s")  # of the grid 0, 2.2, 4.4, ...; the truth is 4 s
    slip = best.result["parameters"]["boundary.RIGHT.x.slip"]
    assert abs(slip["value"] - 0.006) < 3.0 * slip["std"]


@pytest.mark.slow
def test_a_soft_inclusion_is_found_at_its_place(twin):
    """Its edge is sharp, the model's is smooth: without noise the stiffness comes out 0.9 standard deviations low.

    Bounds: mean plus three scatters, in stated standard deviations, over ten other draws of the noise. Noise moves
    place and stiffness of a small spot farther than first order says.
    """
    path = twin("heterogeneity")
    _, result = screening(path, None)
    best = result.ranked[0]
    assert best.candidate.name == "heterogeneity" and best.variant.form == "inclusion"
    assert np.linalg.norm(np.subtract(best.variant.place, (2.5, 1.0))) < 1.2  # its radius
    again = refit(path, best.variant).result["parameters"]
    for last, truth, mean, scatter in (("stiffness", 0.7, 1.4, 1.0), ("x", 2.5, 0.2, 0.8), ("y", 1.0, 0.5, 1.2)):
        dof = again[f"BODY.inclusion.{last}"]
        assert abs(dof["value"] - truth) < (mean + 3.0 * scatter) * dof["std"], last
    assert abs(again["BODY.inclusion.radius"]["value"] - 1.2) < 0.3  # a sharp edge, modelled by a smooth one


@pytest.mark.slow
def test_a_camera_that_shakes_is_found_and_its_motion_recovered(twin):
    path = twin("camera_motion")
    _, result = screening(path, None)
    assert result.ranked[0].candidate.name == "camera_motion"
    again = refit(path, result.ranked[0].variant).result["parameters"]
    still = Camera.from_table(1.0)
    for k in range(1, len(TIMES)):
        moved = shaken(still, k).origin_px - still.origin_px
        for axis, name in enumerate(("col_at", "row_at")):
            dof = again[f"camera.{name}[{k}]"]
            assert abs(dof["value"] - moved[axis]) < 4.0 * dof["std"], (name, k)  # 22 of them


@pytest.mark.slow
def test_light_that_changes_from_place_to_place_is_named_and_patches_take_it_up(twin):
    """It moves neither E nor nu by more than their error bars; patches must not do so either."""
    path = twin("illumination")
    found, result = screening(path, ("illumination", "defocus", "magnification", "grip_slip"))
    best = result.ranked[0]
    assert best.candidate.name == "illumination" and best.standing == "significant"
    again = refit(path, best.variant)
    assert again.point.system.phi < 0.6 * found.point.system.phi
    for name, truth in TRUTH.items():
        entry = again.result["parameters"][f"BODY.{name}"]
        assert abs(entry["value"] - truth) < 3.0 * entry["std"], name


def test_a_loss_of_focus_is_named_and_its_growth_recovered(twin):
    path = twin("defocus")
    found, result = screening(path, ("illumination", "defocus", "magnification"))
    best = result.ranked[0]
    assert best.candidate.name == "defocus" and best.standing == "significant"
    again = refit(path, best.variant)
    blur = np.array([record.brightness[-1] for record in again.point.system.frames])
    slope = np.polyfit(TIMES[1:], blur, 1)[0]
    assert slope == pytest.approx(0.1 / TIMES[-1], rel=0.2)  # Laplacian of the image as recorded, noise included
    assert again.point.system.phi < found.point.system.phi - 100.0
