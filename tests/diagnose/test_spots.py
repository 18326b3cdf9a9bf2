"""Spots: dust stays in the image, lost paint goes with the specimen; both are found, named, left out, and the
parameters are right again.

The truth is that of `side_twins`: motion of a finer mesh, rendered from an analytic pattern; discs are painted over its
images.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import LinearNDInterpolator
from side_twins import NOISE, ORIGIN, PIXEL, SHAPE, TRUTH, Side, truth, write_folder

import idic
from idic.correlation import build_experiment_reference, camera_at
from idic.diagnose import DUST, Fit, LeftOut, PAINT, Spot, identification_at
from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.residual.spots import LEFT_OUT, find_spots
from idic.diagnose.spotless import left_by
from idic.experiment_file import load_experiment
from idic.images import ArrayStack, Camera
from idic.model import build_forward
from idic.report.diagnosis.spots import with_spots
from idic.report.diagnosis.words import is_sure
from idic.run import diagnose_run
from idic_studies.trial.tool_run import FolderSource

CAMERA = Camera.from_table(PIXEL, ORIGIN, centre=((SHAPE[1] - 1) / 2, (SHAPE[0] - 1) / 2))


def disc(centre, radius):
    row, column = np.mgrid[:SHAPE[0], :SHAPE[1]]
    return np.clip(radius + 0.5 - np.hypot(column - centre[0], row - centre[1]), 0.0, 1.0)


def dusty(image, k, centre=(130.0, 40.0), radius=2.5, grey=200.0):
    """A disc that stays in the image."""
    part = disc(centre, radius)
    return image * (1.0 - part) + grey * part


def flaking(centre=(128.0, 80.0), radius=3.0, grey=200.0, onset=8):
    """A disc that goes with the specimen from a frame on  # (image, frame) -> image"""
    mesh, u, _ = truth(Side())
    at = CAMERA.project(mesh.nodes)
    moves = [LinearNDInterpolator(at, CAMERA.project(mesh.nodes + one) - at)(*centre) for one in u]

    def painted(image, k):
        part = disc(np.add(centre, moves[k]), radius)
        return image if k < onset else image * (1.0 - part) + grey * part

    return painted


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A strip without spots, and the model at its true parameters."""
    experiment = load_experiment(write_folder(tmp_path_factory.mktemp("clean") / "test", Side()))
    experiment = replace(experiment, recording=replace(experiment.recording,
                                                       noise=replace(experiment.recording.noise, std_gv=NOISE)))
    values = experiment.model.parameters.as_values() | {"BODY.E": TRUTH["E"], "BODY.nu": TRUTH["nu"]}
    local = np.zeros((experiment.model.n_frames, build_forward(experiment).drives.n_local))
    return experiment, values, local, experiment.recording.stack


def found_in(recording, change):
    experiment, values, local, stack = recording
    frames = np.array([stack.frame(k) for k in range(stack.n_frames)], dtype=float)
    changed = np.rint([change(one, k) for k, one in enumerate(frames)]).astype(np.uint8)
    return find_spots(identification_at(replace(experiment, recording=replace(experiment.recording,
                                                                              stack=ArrayStack(changed))), values,
                                        local, None))


def test_a_clean_recording_has_no_spots(recording):
    assert found_in(recording, lambda image, k: image) == ()


def test_dust_is_found_where_it_is(recording):
    (spot,) = found_in(recording, dusty)
    assert (spot.kind, spot.alternatives, spot.first) == (DUST, (), 0)
    assert np.hypot(spot.column - 130.0, spot.row - 40.0) < 1.0 and abs(spot.radius_px - 2.5) < 1.0
    assert spot.grey > 0.0 and len(spot.left_out) > 1  # under its way, too


def test_lost_paint_is_found_from_its_frame_on(recording):
    (spot,) = found_in(recording, flaking())
    assert (spot.kind, spot.alternatives, spot.first) == (PAINT, (), 8) and spot.agreement > 0.8
    assert np.hypot(spot.column - 128.0, spot.row - 80.0) < 1.0 and abs(spot.radius_px - 3.0) < 1.0
    ((column, row, radius),) = spot.left_out
    assert np.hypot(column - 128.0, row - 80.0) + 3.0 < radius


def test_what_is_no_disc_is_no_spot(recording):
    """A line that darkens: a crack, a scratch."""
    def scratched(image, k):
        image = image.copy()
        if k > 4:
            image[60:100, 140:143] = 25.0
        return image

    assert found_in(recording, scratched) == ()


def test_a_spot_that_the_last_model_explains_is_told_no_more(recording, tmp_path):
    """Of two discs that were left out the images hold one: with their pixels back the model loses the pattern there."""
    _, values, local, _ = recording
    folder = write_folder(tmp_path / "test", Side(image=dusty))
    dust, explained = (Spot(kind, (), *centre, 3.0, 0, 30.0, 0.8, ((*centre, 7.0),))
                       for kind, centre in ((DUST, (130.0, 40.0)), (PAINT, (128.0, 80.0))))
    source = FolderSource.of(folder, load_experiment(folder).recording.stack).with_measured_noise().with_edits(
        {LEFT_OUT: [list(circle) for spot in (dust, explained) for circle in spot.left_out]})
    model = FittedModel(source, Fit("null", "null", "converged", values, {}, local, None, None, None))
    both = LeftOut((dust, explained), {}, ((1.0, 2.0), (3.0, 4.0)))
    assert left_by(None, both) is both
    lasting = left_by(model, both)
    assert (lasting.spots, lasting.place_mm) == ((dust,), ((1.0, 2.0),))
    assert left_by(model, LeftOut((explained,), {}, ((3.0, 4.0),))) is None


def test_pixels_under_a_circle_are_not_correlated(recording):
    path = Path(recording[0].folder) / "experiment.toml"
    pixels = [build_experiment_reference(one, camera_at(one, one.model.parameters)).pixel_map.points() for one in (
        load_experiment(path), load_experiment(path, {"options.left_out_px": [[130.0, 40.0, 5.0]]}))]
    gone = set(map(tuple, pixels[0])) - set(map(tuple, pixels[1]))
    assert len(gone) == 81 and max(np.hypot(x - 130.0, y - 40.0) for x, y in gone) <= 5.0
    far = load_experiment(path, {"options.left_out_px": [[-50.0, 10.0, 5.0], [130.0, 4000.0, 5.0], [130.0, 40.0, 5.0]]})
    rest = build_experiment_reference(far, camera_at(far,
    far.model.parameters)).pixel_map.points()  # dust that comes in later
    assert set(map(tuple, rest)) == set(map(tuple, pixels[1]))
    for circles, what in (([[1.0, 2.0, 0.0]], "a circle without a size"), ([[1.0, 2.0]], "left_out_px")):
        with pytest.raises(idic.errors.InputError, match=what):
            load_experiment(path, {"options.left_out_px": circles})


def test_spots_are_the_first_causes():
    spot = Spot(PAINT, (), 128.0, 80.0, 3.0, 8, 97.0, 0.9, ((128.0, 80.0, 4.5),))
    left = LeftOut((spot,), {}, ((2.19, -1.35),))
    before = {"BODY.E": {"value": 1900.0, "std": 40.0, "unit": "MPa"}}
    after = {"BODY.E": {"value": 2000.0, "std": 3.0, "unit": "MPa"}}
    content = {"verdict": "none", "named": [], "probability": 0.91, "indistinguishable": [],
               "model": {"parameters_before": after, "parameters_after": {}}, "headline": "No missing physics.",
               "sentence": "No candidate."}
    told = with_spots(content, left, before, after, "mm")
    assert (told["verdict"], told["named"]) == ("single", ["paint_loss"])
    assert told["headline"].startswith("Paint loss around (2.19, -1.35) mm (column 128, row 80; 6 px wide, +97 grey "
                                       "values) from frame 8 on: left out")
    assert "E came out 5 % too low" in told["headline"] and "error bar of 40 MPa" in told["headline"]
    assert told["model"]["parameters_before"] == before and told["model"]["parameters_after"] == after
    both = with_spots(content | {"verdict": "single", "named": ["friction"]}, left, before, after, "mm")
    assert (both["verdict"], both["named"]) == ("multiple", ["paint_loss", "friction"])
    assert told["probability"] == 0.91  # of nothing else, as without the spot
    blind = with_spots(content | {"verdict": "blind", "probability": None}, left, before, after, "mm")
    assert (blind["verdict"], blind["named"], is_sure(blind)) == ("blind", ["paint_loss"], False)
    open_kind = replace(left, spots=(replace(spot, alternatives=(DUST,)),))
    assert with_spots(content, open_kind, before, after, "mm")["verdict"] == "set"
    outside = with_spots(content | {"verdict": "outside_library"}, left, before, after, "mm")
    assert outside["verdict"] == "outside_library"


def test_many_spots_are_counted_and_not_told_one_by_one():
    spots = tuple(Spot(PAINT, (DUST,) if k == 2 else (), 100.0 + 10.0 * k, 80.0, 2.0 + 0.5 * k, 8 + k, 40.0, 0.9, ())
                  for k in range(4))
    left = LeftOut(spots, {}, tuple((float(k), 1.0) for k in range(4)))
    content = {"verdict": "none", "named": [], "probability": 0.91, "indistinguishable": [],
               "model": {"parameters_before": {}, "parameters_after": {}}, "headline": "No missing physics.",
               "sentence": "No candidate."}
    told = with_spots(content, left, {}, {}, "mm")
    assert told["headline"] == (
        "Paint loss or dust on lens or sensor in 4 places, the largest around (3, 1) mm (column 130, row 80; 7 px "
        "wide, +40 grey values), the first from frame 8 on, the last one from frame 11 on: left out of all images with "
        "4 px around. Without their pixels: no missing physics.")
    assert len(told["spots"]) == 4 and told["named"] == ["paint_loss"]
    three = with_spots(content, replace(left, spots=spots[:3], place_mm=left.place_mm[:3]), {}, {}, "mm")
    assert three["headline"].count(" px wide") == 3


@pytest.mark.slow
@pytest.mark.usefixtures("shared_server")
@pytest.mark.parametrize("kind", [DUST, PAINT])
def test_a_diagnosis_names_the_spot_and_its_parameters_are_right(tmp_path, kind):
    """Before, dust moved E by 1 % and its error bar to 185 MPa, lost paint was "unexplained motion"."""
    write_folder(tmp_path / "test", Side(image=dusty if kind == DUST else flaking()))
    idic.identify(tmp_path / "test", tmp_path / "run")
    content = diagnose_run(tmp_path / "run")
    assert (content["verdict"], content["named"]) == ("single", [kind]) and content["left_over"] is None
    for name in ("E", "nu"):
        entry = content["model"]["parameters_after"][f"BODY.{name}"]
        assert abs(entry["value"] - TRUTH[name]) < 3.0 * entry["std"] < 0.05 * TRUTH[name]
    assert (tmp_path / "run" / "figures" / "diagnosis_spots.png").exists()
    again = load_experiment(tmp_path / "run" / "enriched" / "experiment.toml")
    assert again.options.left_out_px
