"""`idic init` writes an experiment that `idic check` understands; `check` decodes everything and draws the mesh."""

from __future__ import annotations

import io
import json
import subprocess
import sys

import meshio
import numpy as np
import pytest
import tifffile
from PIL import Image
from typer.testing import CliRunner

from experiment_file.small_experiment import change, write_experiment
from idic.cli.app import app
from idic.errors import InputError
from idic.experiment_file import initial_experiment, load_experiment
from idic.report import check


@pytest.fixture
def folder(tmp_path):
    return write_experiment(tmp_path / "test")


def test_init_writes_a_file_that_loads_once_the_scale_is_filled_in(folder):
    (folder / "experiment.toml").unlink()
    path = initial_experiment(folder)[0]
    text = path.read_text()
    assert 'nodes = "BOTTOM"' in text and 'uy = { column = "grip_um" }' in text and 'column = "force_kN"' in text
    with pytest.raises(InputError, match="scale"):
        load_experiment(folder)
    for key, value in (("pixel_size_mm", "0.1"), ("origin_px", "[10.0, 40.0]"), ("thickness_mm", "2.0")):
        lines = [f"{key} = {value}" if line.startswith(f"# {key} = ")
                 else line for line in path.read_text().split("\n")]
        path.write_text("\n".join(lines))
    e = load_experiment(folder)
    assert e.model.parameters.free == ("SPECIMEN.E", "SPECIMEN.nu") and e.model.channels[0].nodes == "TOP"


def test_init_makes_a_mesh_on_the_image_where_there_is_no_mesh_file(tmp_path):
    for k in range(3):
        tifffile.imwrite(tmp_path / f"shot{k}.tif", np.full((80, 120), 10 * k, np.uint8))
    initial_experiment(tmp_path)[0]
    e = load_experiment(tmp_path)
    assert e.model.length_unit == "px" and e.model.mesh.n_elements > 50 and e.model.prescribed[0].nodes == "OUTER"


def shots(folder, *names, size=(80, 120)):
    for k, name in enumerate(names):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(np.full(size, 10 * k + 5, np.uint8)).save(folder / name)


@pytest.mark.parametrize("mask, others, patterns", [
    ("mask.png", ("shot_00.png", "shot_01.png", "shot_02.png"), "shot_*.png"),
    ("shot_mask.png", ("shot_00.png", "shot_01.png", "shot_02.png"), "shot_[0-9]*.png"),
    ("mask.png", ("reference.png", "shot_01.png", "shot_02.png"), ["reference.png", "shot_*.png"]),
    ("._a.png", ("a.png", "b.png", "c.png"), "*.png"),
    ("mask.png", ("a.png", "b.png", "c.png"), ["a.png", "b.png", "c.png"]),
    ("roi/mask.png", ("shot_00.png", "shot_01.png", "shot_02.png"), "*.png"),
])
def test_init_takes_no_mask_for_an_image_and_offers_it_as_the_mask(tmp_path, mask, others, patterns):
    shots(tmp_path, *others, mask)
    text = initial_experiment(tmp_path)[0].read_text()
    assert f"images = {json.dumps(patterns)}" in text
    assert (f'mask = "{mask}"' in text and "# mask" not in text) or mask.startswith(".")
    assert load_experiment(tmp_path).recording.labels == others


@pytest.mark.parametrize("name", ["microimage", "unmasked"])
def test_init_takes_images_for_images_whose_names_hold_the_word_of_a_mask(tmp_path, name):
    shots(tmp_path, *(f"{name}_{k}.png" for k in range(3)))
    initial_experiment(tmp_path)[0]
    assert len(load_experiment(tmp_path).recording.labels) == 3


def test_the_force_that_init_writes_behind_a_hash_is_that_of_one_end(tmp_path):
    """The force of a whole outline is zero; of a mesh file without a log init names the end that it drives."""
    shots(tmp_path, *(f"shot_{k}.png" for k in range(3)))
    (tmp_path / "loads.csv").write_text("force_N\n0\n1\n2\n")
    text = initial_experiment(tmp_path)[0].read_text()
    for key, value in (("pixel_size_mm", "0.1"), ("thickness_mm", "2.0")):
        text = "\n".join(f"{key} = {value}" if line.startswith(f"# {key} =") else line for line in text.split("\n"))
    for start in ("[[channel]]", "column =", "simulated ="):
        text = text.replace(f"# {start}", start)
    (tmp_path / "experiment.toml").write_text(text)
    force = load_experiment(tmp_path).model.channels[0]
    assert (force.nodes, force.component) == ("RIGHT", "x")


def test_init_names_the_end_that_it_drives_where_there_is_no_log(folder):
    for name in ("experiment.toml", "loads.csv"):
        (folder / name).unlink()
    assert '# simulated = { reaction = "TOP", component = "y" }' in initial_experiment(folder)[0].read_text()


def test_init_names_the_columns_whose_unit_it_does_not_know(folder):
    (folder / "experiment.toml").unlink()
    change(folder, "loads.csv", "frame,time_s,force_kN,grip_um", "frame,time_s,Load,Stroke (MM)")
    told = "\n".join(initial_experiment(folder)[1])
    assert "no column has the unit of a force or of a displacement" in told and "does" not in told
    assert "without a unit that idic knows: Load, Stroke (MM)." in told


def test_init_offers_no_mask_of_another_size(tmp_path):
    shots(tmp_path, "shot_00.png", "shot_01.png", "shot_02.png")
    shots(tmp_path, "overview_roi.png", size=(60, 70))
    text = initial_experiment(tmp_path)[0].read_text()
    assert '# mask = "mask.png"' in text and "overview_roi.png is no mask: it is 70 x 60 px" in text


def test_init_writes_a_pattern_for_a_folder_with_brackets_in_its_name(tmp_path):
    shots(tmp_path, "images [1]/shot_00.png", "images [1]/shot_01.png", "images [1]/shot_02.png", "images 1/wrong.png")
    initial_experiment(tmp_path)[0]
    assert load_experiment(tmp_path).recording.labels == ("shot_00.png", "shot_01.png", "shot_02.png")
    change(tmp_path, "experiment.toml", "images [[]1]", "images [1]")  # as people type it
    assert load_experiment(tmp_path).recording.labels[0] == "shot_00.png"


def test_init_gives_sets_by_position_where_the_mesh_has_none(folder):
    (folder / "experiment.toml").unlink()
    change(folder, "mesh.inp", "NSET=BOTTOM", "NSET=A1")
    assert '[sets]' in initial_experiment(folder)[0].read_text()


def test_init_tells_what_it_found_and_proposes_the_scale(folder):
    """The mesh is 4 x 3 mm, the speckled area 48 x 36 px: 12 px per mm."""
    (folder / "experiment.toml").unlink()
    area = [[6, 8], [54, 8], [54, 44], [6, 44]]
    path, lines = initial_experiment(folder, lambda image: (area, []))
    told, text = "\n".join(lines), path.read_text()
    assert "images/*.tif: 4 of 60 x 50 px" in told and "12 elements" in told and "E from 70 000 MPa" in told
    assert "pixel_size_mm = 0.08333" in told and "origin_px = [6, 44]" in told
    assert "# pixel_size_mm = 0.08333" in text and "# origin_px = [6.0, 44.0]" in text
    assert lines[-1].split(maxsplit=2)[-1] == "thickness_mm, pixel_size_mm, origin_px, E"


def test_init_takes_a_mesh_of_any_format_that_is_read(folder):
    (folder / "experiment.toml").unlink()
    (folder / "mesh.inp").unlink()
    points, quad = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2, 3]])
    meshio.write(folder / "mesh.su2", meshio.Mesh(points[:, :2], [("quad", quad)]))
    assert 'mesh = "mesh.su2"' in initial_experiment(folder)[0].read_text()


def test_init_puts_the_roi_on_the_speckled_area_with_its_holes(tmp_path):
    for k in range(3):
        tifffile.imwrite(tmp_path / f"shot{k}.tif", np.full((80, 120), 10 * k, np.uint8))
    path, lines = initial_experiment(tmp_path, lambda image: ([[20, 10], [99, 10], [99, 69], [20, 69]],
                                                              [[60.0, 40.0, 12.0], [[1, 2], [3, 4]]]))
    text = path.read_text()
    assert "# 1 hole is not round and left out" in text and any("not round" in line for line in lines)
    assert "roi_px = [20, 10, 99, 69]" in text and "holes_px = [[60.0, 40.0, 12.0]]" in text
    assert load_experiment(tmp_path).model.mesh.n_elements > 50


def test_init_overwrites_nothing_and_needs_images(folder, tmp_path):
    before = (folder / "experiment.toml").read_bytes()
    with pytest.raises(InputError, match="already"):
        initial_experiment(folder)[0]
    assert (folder / "experiment.toml").read_bytes() == before
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="no images"):
        initial_experiment(tmp_path / "empty")[0]
    assert list((tmp_path / "empty").iterdir()) == []


def test_check_reports_the_region_that_will_be_correlated(folder, tmp_path):
    report = check(load_experiment(folder), tmp_path / "overlay.png")
    assert (report.n_frames, report.n_elements, report.n_visible, report.image_size) == (4, 12, 12, (60, 50))
    assert report.px_per_element == pytest.approx(100.0) and report.noise.std_gv == 2.0
    assert Image.open(tmp_path / "overlay.png").size[0] > 500
    assert Image.open(io.BytesIO(report.overlay.png)).format == "PNG"
    text = "\n".join(report.lines())
    assert "SPECIMEN.E" in text and "force_kN" in text and "100 px per element" in text


def test_the_picture_shows_the_mesh_where_it_lies_on_the_image(folder, tmp_path):
    """Its outer lines, found by their colour, have the distances that they have in the image."""
    experiment = load_experiment(folder)
    drawn = np.asarray(Image.open(io.BytesIO(check(experiment).overlay.png)), dtype=int)
    is_mesh = drawn[..., 0] - drawn[..., 2] > 60  # orange, also half of it, on grey
    is_mesh[-120:] = False  # the legend
    columns, rows = np.flatnonzero(is_mesh.mean(axis=0) > 0.3), np.flatnonzero(is_mesh.mean(axis=1) > 0.3)
    sides = columns[-1] - columns[0], rows[-1] - rows[0]  # of 4 x 3 elements of 10 px
    assert sides[0] / sides[1] == pytest.approx(4 / 3, rel=0.01)
    grey = drawn[(drawn.max(axis=2) == drawn.min(axis=2)) & (drawn.max(axis=2) > 0) & (drawn.max(axis=2) < 255)]
    assert len(grey) > 10_000  # pixels of the reference image


def test_check_loads_no_matplotlib_and_the_filters_of_scipy_only_to_call_them(folder):
    """Their import was a third of its time."""
    code = """if True:
        import sys
        from idic.cli import main
        from idic.experiment_file import load_experiment
        from idic.report import check

        def show_loaded(*names):
            print("loaded:", [name for name in names if name in sys.modules])

        show_loaded("scipy.ndimage", "scipy.special", "scipy.fft")
        sys.argv = ["idic", "check", sys.argv[1]]
        try:
            main()
        except SystemExit as end:
            print("code:", end.code)
        show_loaded("matplotlib", "cv2", "zarr", "prefect", "distributed")
    """
    answer = subprocess.run([sys.executable, "-c", code, str(folder)], capture_output=True, text=True)
    assert answer.stdout.startswith("loaded: []\n") and answer.stdout.endswith("code: 0\nloaded: []\n"), answer
    assert Image.open(folder / "check" / "mesh.png").size[0] > 500


def test_check_sees_a_mesh_that_reaches_beyond_the_image(folder):
    change(folder, "experiment.toml", "[10.0, 40.0]", "[-15.0, 40.0]")
    report = check(load_experiment(folder))
    assert (report.n_visible, report.n_seen) == (9, 12)


def test_check_warns_of_saturation_and_of_missing_contrast(folder):
    for k in range(4):
        tifffile.imwrite(folder / "images" / f"frame_{k:03d}.tif", np.full((50, 60), 255, np.uint8))
    warnings = " ".join(check(load_experiment(folder)).warnings)
    assert "saturated" in warnings and "no pattern" in warnings


def test_check_finds_the_image_that_cannot_be_decoded(folder):
    path = folder / "images" / "frame_002.tif"
    tifffile.imwrite(path, np.random.default_rng(0).integers(0, 255, (50, 60), dtype=np.uint8), compression="deflate")
    data = bytearray(path.read_bytes())
    data[-1500:-1000] = bytes(500)
    path.write_bytes(bytes(data))
    experiment = load_experiment(folder)
    with pytest.raises(InputError) as caught:
        check(experiment)
    assert "frame_002.tif" in str(caught.value.file)


def test_check_of_a_folder_without_write_permission_reports_it_and_ends(folder, tmp_path):
    """Recordings often lie where nobody may write; root may write everywhere, so a file stands in the way here."""
    (folder / "check").write_text("")
    answer = CliRunner().invoke(app, ["check", str(folder)])
    assert answer.exit_code == 0 and "--out FILE" in answer.stdout, answer.output
    answer = CliRunner().invoke(app, ["check", str(folder), "--out", str(tmp_path / "mesh.png")])
    assert answer.exit_code == 0 and (tmp_path / "mesh.png").exists()
    answer = CliRunner().invoke(app, ["check", str(folder), "--out", str(folder / "check" / "mesh.png")])
    assert answer.exit_code == 2 and "what to do" in answer.stderr


def test_check_runs_on_the_public_case(shared_data):
    report = check(load_experiment(shared_data("open-case-1-plate-with-hole-elastoplastic")))
    assert report.n_visible < report.n_seen == 1196 and not report.warnings


@pytest.mark.parametrize("name", ["machine.txt", "test.TRA", "run.lvm", "export.asc"])
def test_init_finds_the_log_of_a_machine_beside_notes(tmp_path, name):
    shots(tmp_path, "shot_00.png", "shot_01.png", "shot_02.png")
    (tmp_path / "a_note.txt").write_text("Specimen 5, painted on Monday\n12 images\n")
    (tmp_path / name).write_text("Time [s];Force [N]\n0;0\n1;5\n2;9\n")
    path, lines = initial_experiment(tmp_path)
    assert f'loads = "{name}"' in path.read_text() and not any("a_note" in line for line in lines)
