"""An experiment from Python objects is the experiment of a folder with the same content, and is checked like it."""

import doctest
import sys
from html.parser import HTMLParser

import arrays
import meshio
import numpy as np
import pytest
import tifffile

import idic
from idic.errors import InputError
from idic.experiment_file import load_experiment


def made(**changes):
    return idic.Experiment(**arrays.recorded().tables(**changes))


def without_words(record):
    """What decides the numbers: title, folder and identity name the place only."""
    return (record.model.kind, record.model.thickness, record.model.materials, record.model.parameters.as_values(),
            record.model.parameters.free,
            record.model.camera.values(), record.model.reference, record.recording.excluded, record.options,
            record.recording.noise, record.notes,
            [(c.column, c.values.tolist(), c.noise_std, c.unit, c.nodes) for c in record.model.channels],
            [(p.nodes, p.component, str(p.drive)) for p in record.model.prescribed])


def test_a_saved_experiment_is_read_as_the_same(tmp_path):
    experiment = made(mask=np.pad(np.ones((85, 125)), 5), exclude_frames=[2], setup={"camera": "8 bit"})
    experiment.save(tmp_path / "saved")
    again = load_experiment(tmp_path / "saved")
    assert without_words(again) == without_words(experiment.record)
    np.testing.assert_allclose(again.model.mesh.nodes, experiment.record.model.mesh.nodes,
                               rtol=1e-8)  # 9 digits in the file
    assert {name: ids.tolist() for name, ids in again.model.mesh.node_sets.items() if name != "ALL"} == \
        {name: ids.tolist() for name, ids in experiment.record.model.mesh.node_sets.items()}
    assert (again.recording.mask == experiment.record.recording.mask).all() and not again.recording.mask.all()
    for k in range(4):
        assert (again.recording.stack.frame(k) == experiment.record.recording.stack.frame(k)).all()
    assert idic.Experiment.read(tmp_path / "saved").tables == again_tables(tmp_path / "saved")


def again_tables(folder):
    from idic.experiment_file import read_toml

    return read_toml(folder / "experiment.toml")


def test_paths_and_tables_of_other_packages_say_the_same_as_arrays(tmp_path):
    pandas = pytest.importorskip("pandas")
    data, expected = arrays.recorded(), without_words(made().record)
    (tmp_path / "images").mkdir()
    for k, image in enumerate(data.images):
        tifffile.imwrite(tmp_path / "images" / f"f{k}.tif", image)
    frame = pandas.DataFrame(data.loads)
    frame.to_csv(tmp_path / "log.csv", index=False)
    meshio.write(tmp_path / "mesh.vtu", meshio.Mesh(data.mesh.points, data.mesh.cells, point_data={
        name: np.isin(np.arange(len(data.mesh.points)), ids).astype(int)
        for name, ids in data.mesh.point_sets.items()}))
    for changes in ({"images": tmp_path / "images"}, {"images": str(tmp_path / "images" / "*.tif")},
                    {"images": [tmp_path / "images" / f"f{k}.tif" for k in range(4)]}, {"images": list(data.images)},
                    {"loads": frame}, {"loads": tmp_path / "log.csv"}, {"mesh": arrays.users_mesh()}):
        assert without_words(made(**changes).record) == expected, changes
    renamed = made(loads=frame.rename(columns={"force_N": "force"}).assign(force=lambda t: t.force / 1e3),
                   units={"force": "kN"},
                   channels=[{"column": "force", "simulated": {"reaction": "RIGHT", "component": "x"},
                              "noise_std": 5e-3}])
    np.testing.assert_allclose(renamed.record.model.channels[0].values, data.loads["force_N"], rtol=1e-12)
    elements = made(mesh=tmp_path / "mesh.vtu").record.model.mesh
    assert elements.n_elements == made().record.model.mesh.n_elements


def test_image_files_are_saved_as_they_are_in_the_order_in_which_they_were_given(tmp_path):
    """Two single images, then a file of several pages; one that is named twice is written twice."""
    data = arrays.recorded().images
    for name, image in (("b.tif", data[0]), ("a.tif", data[1]), ("pages.TIF", data[2:])):
        tifffile.imwrite(tmp_path / name, image, photometric="minisblack")
    for number, (names, expected) in enumerate(((("b.tif", "a.tif", "pages.TIF"), data),
                                                (("b.tif", "a.tif", "a.tif", "b.tif"), data[[0, 1, 1, 0]]))):
        experiment = made(images=[tmp_path / name for name in names], exclude_frames=[2])
        saved = load_experiment(experiment.save(tmp_path / f"saved {number}"))
        assert saved.recording.excluded == (2,)
        assert all((saved.recording.stack.frame(k) == image).all() for k,
                   image in enumerate(expected)) and saved.model.n_frames == 4
    assert (tmp_path / "saved 0" / "images" / "frame_000.tif").read_bytes() == (tmp_path / "b.tif").read_bytes()


@pytest.mark.parametrize("changes, words", [
    ({"thickness_mm": None}, ("experiment.thickness_mm", "a key is missing")),
    ({"thicknes_mm": 2.0}, ("thicknes_mm", "unknown key", "did you mean thickness_mm")),
    ({"kind": "plane"}, ("experiment.kind", "plane_stress")),
    ({"camera": {"pixel_size": 0.1}}, ("camera.pixel_size", "pixel_size_mm")),
    ({"materials": {"sheet": {"law": "elastik", "E": 1.0, "nu": 0.3}}}, ("material.sheet", "elastik", "elastic")),
    ({"boundaries": [{"nodes": "LEFT", "ux": 0.0}]}, ("boundary", "rigid")),
    ({"loads": {"force_N": np.zeros(3), "grip_mm": np.zeros(3)}}, ("fewer rows than the test has images", "4 rows")),
    ({"loads": {"force_N": np.zeros(4), "grip_mm": np.zeros(3)}}, ("loads", "do not fit together", "grip_mm: (3,)")),
    ({"loads": {"force_N": [0, 1, np.nan, 3], "grip_mm": np.zeros(4)}}, ("column force_N", "not a number", "nan")),
    ({"loads": [1, 2, 3, 4]}, ("loads", "DataFrame", "list")),
    ({"units": {"torque": "N"}}, ("units", "torque", "force_N, grip_mm")),
    ({"images": np.zeros((4, 95, 135, 3), np.uint8)}, ("images", "colour", "images[..., 0]")),
    ({"images": np.zeros((4, 95, 135), np.int64)}, ("images", "int64", "astype(np.uint16)")),
    ({"images": [np.zeros((95, 135), np.uint8), np.zeros((95, 134), np.uint8)]}, ("differ in size", "(95, 134)")),
    ({"images": np.zeros((1, 95, 135), np.uint8)}, ("too few images",)),
    ({"images": "no/such/*.tif"}, ("no images match", "no/such/*.tif")),
    ({"images": None}, ("there are no images",)),
    ({"images": (image for image in np.zeros((4, 95, 135), np.uint8))}, ("one by one", "generator", "list")),
    ({"loads": {"force_N": np.ma.masked_less([0, 1, -9999, 3], 0), "grip_mm": np.zeros(4)}},
     ("column force_N", "not a number")),
    ({"mesh": 3}, ("mesh", "meshio.Mesh", "int")),
    ({"mesh": "no-mesh.inp"}, ("no such file", "no-mesh.inp")),
    ({"mesh": meshio.Mesh(np.zeros((4, 2)), [("quad", np.array([[0, 1, 2, 7]]))])}, ("mesh", "beyond the 4")),
    ({"mask": np.ones((10, 10))}, ("experiment.mask", "135 x 95 px", "10 x 10 px")),
    ({"materials": {"sheet": {"law": "elastic", "E": np.inf, "nu": 0.3}}}, ("material.sheet.E", "finite")),
])
def test_what_is_wrong_is_told_with_key_expected_found_and_remedy(changes, words):
    with pytest.raises(InputError) as told:
        made(**changes)
    text = str(told.value)
    assert all(word in text for word in words), text
    assert told.value.remedy


def test_images_with_pixels_without_a_value_are_refused_where_they_are_read():
    images = arrays.recorded().images.astype(np.float64)
    assert made(images=images).record.recording.stack.frame(1).dtype == np.float32
    images[2, 10, 10] = np.nan
    with pytest.raises(InputError, match="pixels without a value"):
        made(images=images).record.recording.stack.frame(2)
    hidden = np.ma.masked_array(arrays.recorded().images)
    hidden[2, 10, 10] = np.ma.masked  # the value below a mask is no grey value
    assert made(images=hidden).record.recording.stack.frame(1).dtype == arrays.recorded().images.dtype
    with pytest.raises(InputError, match="masked pixels.*\n.*\n.*1 pixels"):
        made(images=hidden).record.recording.stack.frame(2)


def test_laws_of_files_and_gauges_are_those_of_the_file(tmp_path):
    """Keys beside `from` win; the saved folder holds the whole law and the gauges."""
    (tmp_path / "laws").mkdir()
    (tmp_path / "laws" / "sheet.toml").write_text('law = "elastic"\nE = { value = 71, unit = "GPa" }\nnu = 0.33\n')
    gauges = {"probes": [{"name": "hole", "at_mm": [0.0, 3.0]}],
              "extensometers": [{"name": "clip", "from_mm": [-4.0, 3.0], "to_mm": [4.0, 3.0]}],
              "lines": [{"from_px": [20.0, 20.0], "to_px": [110.0, 20.0]}],
              "circles": [{"centre_mm": [0.0, 0.0], "radius_mm": 2.0}]}
    law = {"from": "laws/sheet.toml", "nu": {"value": 0.35, "identify": True}}
    experiment = made(materials={"sheet": law}, folder=tmp_path, **gauges)
    values = {name: p.value for name, p in experiment.parameters.items() if name.startswith("sheet.")}
    assert values["sheet.E"] == 71e3 and values["sheet.nu"] == 0.35 and experiment.parameters.free == ("sheet.nu",)
    assert [gauge.name for gauge in experiment.record.gauges] == ["hole", "clip", "line 1", "circle 1"]
    again = load_experiment(experiment.save(tmp_path / "saved"))
    assert without_words(again) == without_words(experiment.record)
    assert again.gauges == experiment.record.gauges
    with pytest.raises(InputError, match="no such law file") as told:
        made(materials={"sheet": law}, folder=tmp_path / "laws")
    assert told.value.key == "material.sheet.from"


def test_a_changed_experiment_is_another_one_and_the_first_stays():
    experiment = made()
    other = experiment.changed({"sheet.E": 50e3, "options.max_iterations": 3})
    assert other.parameters["sheet.E"].shown == 50e3 and other.record.options.max_iterations == 3
    assert experiment.parameters["sheet.E"].shown == 60e3 and experiment.record.options.max_iterations == 40
    with pytest.raises(InputError, match="no such key"):
        experiment.changed({"sheeet.E": 50e3})


def test_a_changed_experiment_takes_the_place_of_the_saved_one_until_the_run_begins(tmp_path):
    """Values, log, images and mask each make another experiment; the same one again is no change."""
    data, folder = arrays.recorded(), tmp_path / "run" / "experiment-from-python"
    changes = [{}, {"thickness_mm": 3.0}, {"loads": data.loads | {"force_N": 2.0 * data.loads["force_N"]}},
               {"images": data.images[:, ::-1]}, {"mask": np.ones((95, 135))}, {}]
    for number, change in enumerate(changes):
        experiment = made(**change)
        path, overrides = experiment.as_files(folder)
        assert path == folder and overrides == {}
        assert without_words(load_experiment(path)) == without_words(experiment.record), number
        assert (load_experiment(path).recording.stack.frame(1) == experiment.record.recording.stack.frame(1)).all()
        written = (folder / "experiment.toml").stat().st_mtime_ns
        experiment.as_files(folder)
        assert (folder / "experiment.toml").stat().st_mtime_ns == written
    (tmp_path / "run" / "run.zarr").mkdir()
    assert made().as_files(folder) == (folder, {})
    with pytest.raises(InputError, match="another experiment") as told:
        made().changed({"sheet.E": 50e3}).as_files(folder)
    assert "experiment.toml" in told.value.found and "another out" in told.value.remedy
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == ["experiment-from-python", "run.zarr"]


def test_a_notebook_shows_the_experiment_and_escapes_its_words():
    page = made(title="<script>alert(1)</script>")._repr_html_()
    assert "sheet.E" in page and "4 images of 135 × 95 px" in page and "data:image/png;base64," in page
    assert "from column grip_mm" in page and "<script>" not in page
    parser = Balanced()
    parser.feed(page)
    assert not parser.open


class Balanced(HTMLParser):
    """Tags that are open."""

    def __init__(self):
        super().__init__()
        self.open = []

    def handle_starttag(self, tag, attrs):
        self.open += [tag] if tag != "img" else []

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_the_examples_of_the_docstrings_run():
    found = doctest.testmod(sys.modules[idic.Experiment.__module__])
    assert found.attempted >= 5 and not found.failed
