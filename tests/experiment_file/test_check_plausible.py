"""`idic check` speaks where input hardly is meant, and is silent where it may well be."""

import tomllib

import cv2
import numpy as np
import pytest
import tifffile
from scipy.ndimage import gaussian_filter

from experiment_file.small_experiment import change, write_experiment
from idic.errors import InputError
from idic.experiment_file import load_experiment
from idic.images import speckle_size
from idic.report import check
from idic.report.evidence.causes.axes import TURNS
from idic.report.evidence.causes.lines import excluded_frames, free_rigid_motion, other_axes, time_offset
from idic.report.evidence.plausible import pattern_warnings, without_pattern
from report.experiment_kinds import KINDS, in_px


def speckle(shape=(50, 60), sigma=1.8, seed=3):
    """Width of the autocorrelation 3.3 sigma."""
    field = gaussian_filter(np.random.default_rng(seed).normal(size=shape), sigma)
    return np.clip(128 + 45 * field / field.std(), 0, 255)


@pytest.fixture
def folder(tmp_path):
    folder = write_experiment(tmp_path / "test")
    show(folder, speckle())
    return folder


def show(folder, image):
    generator = np.random.default_rng(0)
    for k in range(4):
        noisy = np.clip(np.rint(image + generator.normal(0, 2, image.shape)), 0, 255).astype(np.uint8)
        tifffile.imwrite(folder / "images" / f"frame_{k:03d}.tif", noisy)


def warnings(folder):
    return " ".join(check(load_experiment(folder), draw=False).warnings)


def pattern_told(experiment, image, roi):
    """Warnings of the pattern, of elements of 12 px."""
    width = speckle_size(image, roi, 2.0)
    return list(pattern_warnings(experiment, image, roi, 144.0, width, without_pattern(image, roi, 2.0, width)))


def test_a_sound_experiment_is_told_nothing_but_its_start_values(folder):
    report = check(load_experiment(folder), draw=False)
    assert not report.warnings
    assert any(line == "to identify  SPECIMEN.E from 70 GPa" for line in report.lines())


def test_a_modulus_of_another_unit_is_told_with_the_typical_one(folder):
    change(folder, "experiment.toml", 'value = 70, unit = "GPa"', 'value = 70, unit = "MPa"')
    change(folder, "experiment.toml", "bounds = [10, 200], prior = { mean = 70, std = 5 }", "bounds = [10, 200]")
    assert ("SPECIMEN.E = 70 MPa; typical of elastic: 70 000 MPa. Check its unit; if the value is intended, do nothing"
            in warnings(folder))


def test_a_force_of_the_other_sign_is_told_at_the_moving_and_at_the_held_end(folder):
    change(folder, "experiment.toml", 'reaction = "TOP"', 'reaction = "BOTTOM"')
    assert "goes against the motion of TOP, grip_um; the log shows the opposite. factor = -1" in warnings(folder)
    change(folder, "experiment.toml", 'component = "y" }', 'component = "y", factor = -1.0 }')
    assert not warnings(folder)
    change(folder, "experiment.toml", 'reaction = "BOTTOM"', 'reaction = "TOP"')
    assert "goes with the motion of TOP, grip_um; the log shows the opposite. factor = 1" in warnings(folder)


def test_a_force_of_all_driven_nodes_is_told_as_a_sum_that_is_zero(folder):
    change(folder, "mesh.inp", "*ELSET, ELSET=LAST", "*NSET, NSET=GRIPS\nTOP, BOTTOM\n*ELSET, ELSET=LAST")
    assert not warnings(folder)
    change(folder, "experiment.toml", 'reaction = "TOP"', 'reaction = "GRIPS"')
    assert "GRIPS holds every node that is moved or held along y, and all reactions toge" in warnings(folder)


def test_a_load_at_the_reference_frame_is_told_unless_its_offset_is_identified(folder):
    change(folder, "loads.csv", "0,0.0,0.000", "0,0.0,0.030")
    for told in ("force_kN is 0.03 kN at the reference frame", "channel.force_kN.offset under [[dof]]"):
        assert told in warnings(folder)
    file = folder / "experiment.toml"
    file.write_text(file.read_text() + '\n[[dof]]\nname = "channel.force_kN.offset"\nvalue = 0.0\nunit = "N"\n')
    assert not warnings(folder)


def test_a_mesh_in_two_pieces_is_told_with_a_place_of_the_double_nodes(folder):
    """The upper row of elements has nodes of its own: those of its lower edge are written twice."""
    text = (folder / "mesh.inp").read_text()
    double = "".join(f"{201 + i}, {float(i)}, 2.0, 0.0\n" for i in range(5))
    rows = "".join(f"{1009 + i}, {201 + i}, {202 + i}, {117 + i}, {116 + i}\n" for i in range(4))
    old = text[text.index("1009, "):text.index("*NSET, NSET=BOTTOM")]
    (folder / "mesh.inp").write_text(text.replace(old, rows).replace("*ELEMENT", double + "*ELEMENT", 1))
    assert "the mesh has 2 pieces that share no node" in warnings(folder)
    assert "(the first at x 0, y 2 mm): no force passes between them" in warnings(folder)


def test_a_solid_whose_face_is_seen_edge_on_is_refused(folder):
    """A layer of bricks that lies in the plane of x and z; the camera looks along z."""
    at = {(i, j, k): 1 + i + 5 * j + 20 * k for k in range(2) for j in range(4) for i in range(5)}
    lines = ["*NODE", *(f"{n}, {i}, {0.5 * k}, {-j}" for (i, j, k), n in at.items())]
    lines += ["*ELEMENT, TYPE=C3D8, ELSET=SPECIMEN"]
    corners = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
    lines += [", ".join(map(str, (1 + i + 4 * j, *(at[i + a, j + b, c] for a, b, c in corners))))
              for j in range(3) for i in range(4)]
    lines += ["*NSET, NSET=BOTTOM, GENERATE", "1, 5", "*NSET, NSET=TOP, GENERATE", "16, 20", "*SURFACE, NAME=FRONT",
              "SPECIMEN, S2", "*SURFACE, NAME=LOWER", "1, S3", "2, S3"]
    (folder / "mesh.inp").write_text("\n".join(lines) + "\n")
    change(folder, "experiment.toml", 'kind = "plane_stress"', 'kind = "solid"\nsurface = "FRONT"')
    change(folder, "experiment.toml", "thickness_mm = 2.0\n", "")
    change(folder, "experiment.toml", "ux = 0.0\nuy = 0.0", "ux = 0.0\nuy = 0.0\nuz = 0.0")
    with pytest.raises(InputError, match="edge-on") as refused:
        load_experiment(folder)
    assert refused.value.key == "experiment.surface" and "FRONT: x 0 … 4, y 0.5 … 0.5, z -3 … 0" in refused.value.found


def test_the_modulus_of_a_polymer_is_not_doubted(folder):
    change(folder, "experiment.toml", 'value = 70, unit = "GPa"', 'value = 1.2, unit = "GPa"')
    change(folder, "experiment.toml", "bounds = [10, 200], prior = { mean = 70, std = 5 }", "bounds = [0.1, 200]")
    assert "typical" not in warnings(folder)


def test_a_pixel_size_off_by_ten_is_told_in_both_directions(folder):
    change(folder, "experiment.toml", "pixel_size_mm = 0.1", "pixel_size_mm = 0.01")
    assert "pixel_size_mm may be 6.7 times too small" in warnings(folder)  # 400 px across 60
    change(folder, "experiment.toml", "pixel_size_mm = 0.01", "pixel_size_mm = 1.0")
    assert "pixel_size_mm may be too large" in warnings(folder)


def test_a_mirrored_axis_that_takes_the_mesh_out_of_the_image_is_told(folder):
    change(folder, "experiment.toml", '["+col", "-row"]', '["+col", "+row"]')
    assert "an axis is mirrored" in warnings(folder)


def test_a_mirrored_axis_that_keeps_the_mesh_in_the_image_is_told_by_the_pattern(folder):
    """The mesh lies above row 25 and would lie below; the pattern is where it belongs."""
    image = speckle()
    image[:16] = 20.0
    show(folder, image)
    change(folder, "experiment.toml", "origin_px = [10.0, 40.0]", "origin_px = [10.0, 30.0]")
    assert "mirrored along the rows of the image" in warnings(folder)
    change(folder, "experiment.toml", '["+col", "-row"]', '["+col", "+row"]')
    change(folder, "experiment.toml", "origin_px = [10.0, 30.0]", "origin_px = [10.0, 17.0]")
    assert "mirrored" not in warnings(folder)


def test_still_frames_that_move_are_told_with_their_shift_or_as_another_place(folder):
    image, noise = speckle(), np.random.default_rng(5)
    gradient = np.gradient(image)[1]
    for k, moved in enumerate((0.0, 0.0, 0.25, 0.0)):
        shown = image - moved * gradient + noise.normal(0, 2, image.shape)
        tifffile.imwrite(folder / "images" / f"frame_{k:03d}.tif", np.clip(np.rint(shown), 0, 255).astype(np.uint8))
    change(folder, "experiment.toml", "noise_std_gv = 2.0\n", "")
    change(folder, "experiment.toml", 'thickness_mm = 2.0', 'thickness_mm = 2.0\nstill_frames = [0, 1]')
    lines = " ".join(check(load_experiment(folder), draw=False).lines())
    assert "still frame" not in lines
    change(folder, "experiment.toml", "still_frames = [0, 1]", "still_frames = [0, 1, 2]")
    lines = " ".join(check(load_experiment(folder), draw=False).lines())
    assert "frame_002.tif has moved by 0.25 px" in lines and "another place" not in lines
    tifffile.imwrite(folder / "images" / "frame_002.tif", np.clip(np.rint(speckle(seed=4)), 0, 255).astype(np.uint8))
    assert "shows another place" in warnings(folder)


def test_a_roi_over_background_is_told_as_such_and_not_as_exposure(folder):
    image = speckle()
    image[:, 35:] = 20.0  # the mesh spans columns 10 to 50
    show(folder, image)
    told = warnings(folder)
    assert "of the ROI has no pattern" in told and "background or grips" in told
    assert "exposure" not in told and "saturated" not in told


def test_a_hole_that_the_mesh_covers_is_told_with_its_place_and_one_that_it_has_is_not(tmp_path):
    drawn = load_experiment(in_px(tmp_path / "drawn"))
    rows, columns = np.mgrid[:140, :200]
    hole = np.hypot(columns - 120, rows - 60) < 16
    image = np.where(hole, 12.0, speckle((140, 200))) + np.random.default_rng(0).normal(0.0, 2.0, hole.shape)
    covered = np.zeros(hole.shape, dtype=bool)
    covered[10:130, 10:190] = True
    told, = pattern_told(drawn, image, covered)
    assert "around column 120, row 60): a hole?" in told and "holes_px" in told
    assert not list(pattern_told(drawn, image, covered & ~hole))


def test_images_that_were_compressed_are_told_with_the_place_of_their_blocks(folder):
    experiment = load_experiment(folder)
    image = np.clip(speckle((160, 200)) + np.random.default_rng(0).normal(0.0, 2.0, (160, 200)), 0, 255)
    whole, kept = np.ones(image.shape, dtype=bool), np.rint(image).astype(np.uint8)
    compressed = cv2.imdecode(cv2.imencode(".jpg", kept, [cv2.IMWRITE_JPEG_QUALITY, 80])[1], cv2.IMREAD_GRAYSCALE)
    assert not any("JPEG" in line for line in pattern_told(experiment, kept, whole))
    told, = (line for line in pattern_told(experiment, compressed, whole) if "JPEG" in line)
    assert "blocks of 8 px from column 0, row 0" in told and "TIFF or PNG" in told


def test_a_mesh_around_the_image_is_told_as_a_scale(folder):
    change(folder, "experiment.toml", "pixel_size_mm = 0.1", "pixel_size_mm = 0.01")
    change(folder, "experiment.toml", "origin_px = [10.0, 40.0]", "origin_px = [100.0, 40.0]")
    with pytest.raises(InputError, match="pixel_size_mm, which may be 6.7 times too small"):
        load_experiment(folder)


def test_speckle_too_fine_or_too_coarse_is_told_with_the_remedy(folder):
    show(folder, speckle(sigma=0.3))
    assert "too fine for the pixels" in warnings(folder) and "lowpass_px" in warnings(folder)
    rows, columns = (np.arange(n) // 15 % 2 * 60.0 for n in (50, 60))
    show(folder, 60.0 + np.add.outer(rows, columns))  # sharp tiles
    told = warnings(folder)
    assert "few edges carry the motion" in told and "focus" not in told and "background" not in told


@pytest.mark.parametrize("blur_px, told", [(1.0, False), (3.0, True)])
def test_an_image_out_of_focus_is_told_by_its_edges(folder, blur_px, told):
    show(folder, gaussian_filter(np.kron(np.random.default_rng(2).choice([60.0, 200.0], (10, 12)), np.ones((5, 5))),
                                 blur_px))
    assert ("the edges of the speckle are blurred over" in warnings(folder)) == told


@pytest.mark.parametrize("pixel_size_mm, told", [
    (0.045, "the mesh spans 89 x 67 px, the image 60 x 50 px; 100 % of its elements are seen"),
    (0.06, None),  # longer than the image, but not wider: the camera sees the middle of a strip
])
def test_a_mesh_larger_than_the_image_is_told_alone(folder, pixel_size_mm, told):
    """And nothing of the pattern below it, which is that of another place."""
    change(folder, "experiment.toml", "pixel_size_mm = 0.1", f"pixel_size_mm = {pixel_size_mm}")
    change(folder, "experiment.toml", "origin_px = [10.0, 40.0]", "origin_px = [-14.0, 58.0]")
    found = check(load_experiment(folder), draw=False).warnings
    assert (len(found) == 1 and told in found[0]) if told else not any("mesh spans" in one for one in found)


def test_a_saturated_image_is_told_with_what_can_be_done(folder):
    show(folder, speckle() * 2.2)
    assert "of the pixels in the ROI are saturated" in warnings(folder) and "a mask without them" in warnings(folder)


def pull(folder, top_px, bottom_px):
    """Four images in which row 10 (TOP) and row 40 (BOTTOM) move downwards by so many px until the last one."""
    image, rows = speckle(sigma=1.4), np.arange(50.0)
    for k in range(4):
        moved = k / 3 * (top_px + (bottom_px - top_px) * (rows - 10.0) / 30.0)
        shown = np.column_stack([np.interp(rows, rows + moved, column) for column in image.T])
        tifffile.imwrite(folder / "images" / f"frame_{k:03d}.tif", np.rint(shown).astype(np.uint8))


@pytest.mark.parametrize("top_px, bottom_px, told", [
    (-3.0, 0.0, None),  # as the log says: y of the mesh points upwards
    (-2.2, 0.4, None),  # a grip that slips a little, a camera that moves
    (3.0, 0.0, "the sign of grip_um or of an entry of axes is wrong"),
    (0.0, 3.0, "the ends are exchanged, or an axis is mirrored"),
    (-0.5, 0.0, "pixel_size_mm, mesh_unit or the unit of grip_um may be wrong"),
])
def test_ends_that_move_otherwise_than_the_log_are_told(folder, top_px, bottom_px, told):
    pull(folder, top_px, bottom_px)
    for logged, meant in (("100,5.0", "100,100"), ("200,10.0", "200,200"), ("300,15.0", "300,300")):
        change(folder, "loads.csv", logged, meant)
    found = warnings(folder)
    assert (told in found) if told else "moves TOP" not in found


def test_saturation_at_12_bits_is_told_under_a_noise_by_grey_level_too(folder):
    """Stored in 16 bits, and as transformed grey values, the limit of the sensor was not recognised."""
    image = np.clip(np.rint(speckle() * 2.2 * 16.0), 0, 4095).astype(np.uint16)
    for path in (folder / "images").glob("*.tif"):
        tifffile.imwrite(path, image)
    assert "saturated (grey value 4095)" in warnings(folder)
    change(folder, "experiment.toml", "noise_std_gv = 2.0", "noise_model = { offset_gv2 = 900.0, slope_gv = 0.5 }")
    assert "saturated (grey value 4095)" in warnings(folder)


def test_an_image_that_the_recording_repeated_is_told_unless_the_test_rests(folder):
    again = (folder / "images" / "frame_001.tif").read_bytes()
    (folder / "images" / "frame_002.tif").write_bytes(again)
    assert "frame_002.tif repeats frame_001.tif to the last grey value" in warnings(folder)
    change(folder, "loads.csv", "2,2.0,0.200,10.0", "2,2.0,0.100,5.0")
    assert "repeats" not in warnings(folder)


def test_a_force_that_repeats_its_readings_while_the_grip_moves_is_told(folder):
    image = (folder / "images" / "frame_000.tif").read_bytes()
    for k in range(12):
        noisy = np.clip(tifffile.imread(folder / "images" / "frame_000.tif").astype(int) + k % 3, 0, 255)
        tifffile.imwrite(folder / "images" / f"frame_{k:03d}.tif", noisy.astype(np.uint8))
    (folder / "images" / "frame_000.tif").write_bytes(image)

    def log(force):
        rows = "".join(f"{k},{k}.0,{force(k):.4f},{5.0 * k}\n" for k in range(12))
        (folder / "loads.csv").write_text("frame,time_s,force_kN,grip_um\n" + rows)
        return warnings(folder)

    assert not log(lambda k: 0.1 * k)
    assert not log(lambda k: 0.1 * min(k, 5))  # a plateau
    told = log(lambda k: 0.1 * (k // 3 * 3))
    assert "force_kN: in 8 of the 11 steps in which grip_um changes" in told and "jumps by 0.3 kN" in told


@pytest.mark.parametrize("kind", KINDS)
def test_every_line_can_be_written_into_an_experiment_of_every_kind(tmp_path, kind):
    folder = KINDS[kind](tmp_path / kind)
    experiment = load_experiment(folder)
    tables = tomllib.loads((folder / "experiment.toml").read_text())
    for number, view in enumerate(experiment.views):
        camera = f"camera.{number}" if isinstance(tables.get("camera"), list) else "camera"
        names = {"camera": "scanner" if "scanner" in tables else camera}
        lines = [*free_rigid_motion(view), *excluded_frames(view, [2]), *time_offset(view),
                 *(line for turn in TURNS[:3] for line in other_axes(view, turn) if view.recording.points is None)]
        for line in lines:
            value = {} if line.table == "dof" else tomllib.loads(f"value = {line.value}")["value"]
            load_experiment(folder, {"dof": [{"name": line.key}]} if line.table == "dof"
                            else {f"{names.get(line.table, line.table)}.{line.key}": value})
