"""[[boundary]] temperature: columns, infrared images, what is refused, what makes the identity, what simulate
copies."""

import numpy as np
import pytest
import tifffile
from experiment_file.small_experiment import LOADS, TOML, change, write_experiment

from idic.errors import InputError
from idic.experiment_file import load_experiment
from idic.model import Column, TemperatureField
from idic.report import check
from idic.virtual_tests import simulate

ALPHA = 'nu = 0.3\nalpha = { value = 2e-5, unit = "1/K", identify = true }\n'
COLUMN = '[[boundary]]\ntemperature = { column = "oven_C", nodes = "ALL" }\n'
PICTURES = '[[boundary]]\ntemperature = { images = "infrared/*.tif", unit = "C", noise_std = 0.1%s }\n'


def folder_with(tmp_path, temperature, material=ALPHA, infrared=None):
    """The small experiment with a log that has oven_C, and infrared images where given."""
    folder = write_experiment(tmp_path / "test", TOML.replace("nu = 0.3\n", material) + temperature)
    rows = LOADS.strip().split("\n")
    heads = [rows[0] + ",oven_C", *(f"{row},{20 + 30 * k}" for k, row in enumerate(rows[1:]))]
    (folder / "loads.csv").write_text("\n".join(heads) + "\n")
    if infrared is not None:
        (folder / "infrared").mkdir()
        for k, image in enumerate(infrared):
            tifffile.imwrite(folder / "infrared" / f"ir_{k}.tif", image)
    return folder


def slope(shape=(50, 60), factor=1.0, dtype=np.float32):
    """Four images: 20 °C + k times 2 K per column."""
    columns = np.arange(shape[1]) * np.ones(shape)
    return [((20.0 + 2.0 * k * columns) * factor).astype(dtype) for k in range(4)]


def refused(folder, *words):
    with pytest.raises(InputError) as caught:
        load_experiment(folder)
    for word in words:
        assert word in str(caught.value), str(caught.value)


def test_a_column_warms_the_whole_body_and_alpha_is_a_parameter_of_any_law(tmp_path):
    e = load_experiment(folder_with(tmp_path, COLUMN))
    (warm,) = e.model.temperatures
    assert warm.nodes is None and isinstance(warm.drive, Column) and list(warm.drive.values) == [20, 50, 80, 110]
    alpha = e.model.parameters["SPECIMEN.alpha"]
    assert alpha.free and alpha.value == 2e-5 and alpha.unit == "1/K" and alpha.transform == "linear"
    (note,) = [note for note in e.notes if "oven_C" in note]
    assert "20 to 110" in note and "+90 K" in note
    assert any("oven_C from 20 to 110" in line for line in check(e).lines())


def test_infrared_images_of_the_same_camera_are_read_onto_the_nodes_of_the_final_mesh(tmp_path):
    images = slope()
    images[1][20, 30] = np.nan
    e = load_experiment(folder_with(tmp_path, PICTURES % ", edge_margin_px = 2", infrared=images))
    (warm,) = e.model.temperatures
    assert isinstance(warm.drive, TemperatureField) and warm.drive.values.shape == (4, e.model.mesh.n_nodes)
    columns = e.model.camera.project(e.model.mesh.nodes)[:, 0]
    # the smoothing takes 0.1 px x 6 K/px off the ends of a slope, where there are pixels up to the ends
    np.testing.assert_allclose(warm.drive.values[3], 20.0 + 6.0 * columns, atol=2 * 0.1 * 6.0)
    (note,) = [note for note in e.notes if "infrared" in note]
    assert "4 infrared images" in note and "scatters by" in note and "6 K" in note


def test_a_coarser_infrared_camera_with_its_own_calibration_and_whole_numbers(tmp_path):
    """Half as many pixels, hundredths of a degree as 16-bit numbers from 0 at -50 °C."""
    x = (np.arange(30) - 5.0) / 5.0  # mm: 5 px per mm, origin at column 5
    images = [np.tile(((20.0 + 10.0 * k * x + 50.0) * 100.0).round(), (25, 1)).astype(np.uint16) for k in range(4)]
    more = ", scale = 0.01, offset = -50.0, matrix_px_per_unit = [[5, 0], [0, -5]], origin_px = [5, 20]"
    e = load_experiment(folder_with(tmp_path, PICTURES % more, infrared=images))
    values, x = e.model.temperatures[0].drive.values, e.model.mesh.nodes[:, 0]
    inner = (x > 0.9) & (x < 3.1)
    np.testing.assert_allclose(values[2, inner], 20.0 + 20.0 * x[inner], atol=1.0)
    np.testing.assert_allclose(values[0], 20.0, atol=0.01)


def test_temperatures_that_do_not_fit_are_refused_with_a_remedy(tmp_path):
    for k, (temperature, infrared, words) in enumerate([
        (COLUMN.replace("oven_C", "kiln_C"), None, ("kiln_C",)),
        (COLUMN.replace("oven_C", "grip_um"), None, ("wrong unit",)),
        (COLUMN.replace("ALL", "ROOF"), None, ("no such set of nodes", "ROOF")),
        (PICTURES % "", slope()[:3], ("number of infrared images differs", "4, one per frame", "3")),
        (PICTURES % "", slope((25, 30)), ("of another size", "60 x 50 px", "30 x 25 px", "matrix_px_per_unit")),
        (PICTURES % ", origin_px = [0, 0]", slope(), ("infrared camera is incomplete",)),
        (PICTURES % ", edge_margin_px = 20", slope(), ("nothing is left", "edge_margin_px")),
        (PICTURES % "", [np.full((50, 60), np.nan, np.float32)] * 4, ("without a value", "some finite values")),
        (PICTURES % ', column = "oven_C"', slope(), ("exactly one of column, images",)),
        (COLUMN.replace("nodes", "scale = 2.0, nodes"), None, ("scale does not belong here",)),
        ("", None, ("thermal expansion without a temperature", "SPECIMEN.alpha")),
    ]):
        refused(folder_with(tmp_path / str(k), temperature, infrared=infrared), *words)


def test_alpha_of_zero_needs_no_temperature_and_a_wrong_unit_is_refused(tmp_path):
    zero = "nu = 0.3\nalpha = 0.0\n"
    assert load_experiment(folder_with(tmp_path / "zero", "", zero)).model.parameters["SPECIMEN.alpha"].value == 0.0
    refused(folder_with(tmp_path / "unit", COLUMN, ALPHA.replace("1/K", "MPa")), "wrong unit", "alpha")


def test_the_identity_of_an_experiment_knows_its_infrared_images(tmp_path):
    folder = folder_with(tmp_path, PICTURES % "", infrared=slope())
    before = load_experiment(folder).recording.identity
    assert load_experiment(folder).recording.identity == before
    tifffile.imwrite(folder / "infrared" / "ir_2.tif", slope()[2] + 1.0)
    assert load_experiment(folder).recording.identity != before


@pytest.mark.parametrize("temperature, infrared", [(COLUMN, None), (PICTURES % "", slope())], ids=["column", "images"])
def test_a_simulated_experiment_brings_its_temperature_along(tmp_path, temperature, infrared):
    folder = folder_with(tmp_path, temperature, infrared=infrared)
    made, e = load_experiment(simulate(folder, tmp_path / "virtual")), load_experiment(folder)
    a, b = made.model.temperatures[0].drive.values, e.model.temperatures[0].drive.values
    np.testing.assert_allclose(a, b, rtol=1e-6)
    assert made.model.parameters["SPECIMEN.alpha"].value == 2e-5


def test_a_course_warms_the_whole_body_linearly_between_its_points(tmp_path):
    course = '[[boundary]]\ntemperature = { course = [[0.0, 20.0], [2.0, 30.0]] }\n'
    e = load_experiment(folder_with(tmp_path, course))
    (warm,) = e.model.temperatures
    assert warm.nodes is None and isinstance(warm.drive, TemperatureField)
    np.testing.assert_allclose(warm.drive.values.T, np.tile(np.interp(e.model.times, [0.0, 2.0], [20.0, 30.0]),
                                                             (e.model.mesh.n_nodes, 1)))
    assert any("+10 K" in note for note in e.notes)


@pytest.mark.parametrize(("table", "words"), [
    ("{ course = [[0.0, 20.0]] }", ("course",)),
    ("{ course = [[0.0, 20.0], [0.0, 30.0]] }", ("do not increase", "course")),
    ("{ course = [[-60.0, 20.0], [0.0, 30.0]] }", ("before or after all images", "0 … 3 s")),
    ('{ course = [[0.0, 20.0], [1.0, 30.0]], column = "oven_C" }', ("exactly one of",)),
    ("{ course = [[0.0, 20.0], [1.0, 30.0]], scale = 2.0 }", ("scale does not belong here",))])
def test_a_course_that_is_none_is_refused(tmp_path, table, words):
    refused(folder_with(tmp_path, f"[[boundary]]\ntemperature = {table}\n"), *words)


FREE = '[[boundary]]\ntemperature = { course = "free", knots = 2 }\n'
SOFTENS = """nu = 0.3
yield_stress = { value = 170, unit = "MPa" }
reference_temperature = { value = 20, unit = "C" }
temperature = [{ kind = "linear", of = "E", slope = -1e-3 }]
"""


@pytest.mark.parametrize(("temperature", "material", "words"), [
    (FREE + COLUMN, ALPHA, ("next to a temperature that is given", "1 more", "leave one or the other out")),
    (FREE.replace("temp", 'nodes = "BOTTOM"\ntemp'), ALPHA, ("of a part", "nodes = 'BOTTOM'", "of its own")),
    (FREE, SOFTENS, ("where a law depends on its value", "SPECIMEN.reference_temperature", "give the temp")),
], ids=["two", "nodes", "law"])
def test_a_free_course_stands_alone_and_has_no_value_for_a_law(tmp_path, temperature, material, words):
    folder = folder_with(tmp_path, temperature, material)
    if material is SOFTENS:
        change(folder, "experiment.toml", 'law = "elastic"', 'law = "elastoplastic"')
    refused(folder, *words)


def test_a_free_course_of_the_whole_body_has_knots(tmp_path):
    e = load_experiment(folder_with(tmp_path, FREE))
    assert {"temperature_knot[2]",
            "temperature_knot[3]"} < set(e.model.parameters.free) and e.model.temperatures[0].nodes is None
