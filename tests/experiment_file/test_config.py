"""experiment.toml means what docs/experiment-file.md says."""

from __future__ import annotations

import re

import numpy as np
import pytest
import tifffile

from experiment_file.small_experiment import TOML, change, inp_text, load, load_experiment, write_experiment
from idic.errors import InputError
from idic.experiment_file import load_experiment as load_with_its_defaults
from idic.model import Column, Constant, Measured, Parametrised


@pytest.fixture
def folder(tmp_path):
    return write_experiment(tmp_path / "test")


def test_linear_elements_are_computed_as_quadratic_ones_unless_the_options_say_otherwise(folder):
    given, raised = load_experiment(folder), load_with_its_defaults(folder)
    assert given.model.mesh.blocks[0].cell == "quad4" and raised.model.mesh.blocks[0].cell == "quad8"
    assert raised.model.mesh.n_elements == given.model.mesh.n_elements
    assert raised.model.mesh.n_nodes > given.model.mesh.n_nodes
    np.testing.assert_array_equal(raised.model.mesh.element_labels, given.model.mesh.element_labels)
    assert any("computed as quadratic" in note for note in raised.notes)
    assert any("too stiff" in note for note in given.notes) and not any("too stiff" in note for note in raised.notes)
    with pytest.raises(InputError, match="options.element_order"):
        load_with_its_defaults(folder, {"options.element_order": "cubic"})


# the whole ----------------------------------------------------------------------------------------------
def test_everything_arrives_in_internal_units(folder):
    e = load(folder)
    assert (e.title, e.model.kind, e.model.thickness, e.model.length_unit, e.model.reference,
            e.model.n_frames) == ("small", "plane_stress", 2.0, "mm", 0, 4)
    stiffness = e.model.parameters["SPECIMEN.E"]
    assert (stiffness.value, stiffness.shown, stiffness.unit, stiffness.free) == (70e3, 70.0, "GPa", True)
    assert stiffness.bounds == (10e3, 200e3) and (stiffness.prior_mean, stiffness.prior_std) == (70e3, 5e3)
    assert stiffness.transform == "log" and e.model.parameters["SPECIMEN.nu"].transform == "linear"
    assert not e.model.parameters["SPECIMEN.nu"].free and e.model.parameters.free == ("SPECIMEN.E",)
    top = [p for p in e.model.prescribed if p.nodes == "TOP" and p.component == "y"][0]
    np.testing.assert_allclose(top.drive.values, [0.0001, 0.005, 0.01, 0.015], rtol=1e-14)  # um to mm
    assert top.drive.noise_std == pytest.approx(0.2e-3) and top.drive.column == "grip_um"
    np.testing.assert_allclose(top.drive.rates, [0.0049, 0.00495, 0.005, 0.005], rtol=1e-12)  # central differences
    (force,) = e.model.channels
    np.testing.assert_allclose(force.values, [0, 100, 200, 300], rtol=1e-14)
    assert (force.noise_std, force.nodes, force.component, force.factor, force.unit) == (5.0, "TOP", "y", 1.0, "N")
    np.testing.assert_allclose(e.model.camera.project(np.array([[0.0, 0.0], [1.0, 2.0]])), [[10, 40], [20, 20]])
    np.testing.assert_array_equal(e.model.times, [0, 1, 2, 3])
    assert e.recording.noise.std_gv == 2.0 and e.recording.noise.source == "given"
    assert e.recording.stack.shape == (50, 60) and e.recording.labels[3] == "frame_003.tif"
    assert e.model.materials[0].law == "elastic" and e.model.materials[0].kinematics == "small"


def test_the_folder_and_the_file_are_the_same_experiment(folder):
    assert load_experiment(folder).recording.identity == load_experiment(folder / "experiment.toml").recording.identity


def test_the_identity_follows_the_settings_that_decide_the_result(folder):
    first = load_experiment(folder).recording.identity
    assert load(folder, 'title = "small"', 'title = "renamed"').recording.identity == first
    assert load_experiment(folder, {"SPECIMEN.nu": 0.31}).recording.identity != first
    change(folder, "loads.csv", "0.300", "0.301")
    second = load_experiment(folder).recording.identity
    assert second != first
    image = folder / "images" / "frame_001.tif"
    tifffile.imwrite(image, 255 - tifffile.imread(image))
    assert load_experiment(folder).recording.identity != second


def test_a_comment_in_the_mesh_makes_no_other_experiment(folder):
    first = load_experiment(folder)
    mesh = next(folder.glob("*.inp"))
    lines = mesh.read_text().splitlines()
    mesh.write_text("** exported anew\n" + "\n".join(line.replace(",", " ,\t") + "  " for line in lines) + "\n\n")
    same = load_experiment(folder)
    assert same.recording.identity == first.recording.identity
    moved = [line.replace("1.", "1.0001", 1) if line[:1].isdigit() else line for line in lines]
    assert moved != lines
    mesh.write_text("\n".join(moved))
    assert load_experiment(folder).recording.identity != first.recording.identity


def test_overrides_reach_every_kind_of_key(folder):
    e = load_experiment(folder, {"SPECIMEN.E": "72", "SPECIMEN.nu": "0.25", "SPECIMEN.nu.identify": "true",
                                 "options.max_iterations": "7",
                                 "boundary.0.uy": 0.25, "experiment.title": "from outside",
                                 "material.SPECIMEN.E.bounds": "[1, 300]",
                                 "channel.0.noise_std": 0.01})
    assert e.model.parameters["SPECIMEN.E"].value == 72e3 and e.model.parameters["SPECIMEN.E"].bounds == (1e3, 300e3)
    assert e.model.parameters["SPECIMEN.nu"].free and e.options.max_iterations == 7 and e.title == "from outside"
    assert e.model.prescribed[1].drive == Constant(0.25) and e.model.channels[0].noise_std == 10.0


FURTHER = """
[[dof]]
name = "camera.rotation_deg"
value = 0.5
[[dof]]
name = "channel.force_kN.offset"
unit = "kN"
bounds = [-1, 1]
prior = { mean = 0.0, std = 0.01 }
[[dof]]
name = "geometry.thickness"
identify = false
[[dof]]
name = "time.offset"
[[stage]]
free = ["SPECIMEN.E"]
max_iterations = 3
[[stage]]
free = "all"
[options]
interpolation = "quintic"
brightness = "none"
weighting = "paper"
step_limit = 0.05
substeps = 2
"""


def test_options_stages_and_degrees_of_freedom_are_read(folder):
    with (folder / "experiment.toml").open("a") as stream:
        stream.write(FURTHER)
    e = load_experiment(folder)
    assert e.model.parameters.free == ("SPECIMEN.E", "camera.rotation_deg", "channel.force_kN.offset", "time.offset")
    offset = e.model.parameters["channel.force_kN.offset"]
    assert offset.bounds == (-1000.0, 1000.0) and offset.prior_std == 10.0 and offset.factor == 1000.0
    assert e.model.parameters["geometry.thickness"].value == 2.0
    assert e.model.parameters["camera.rotation_deg"].value == 0.5
    assert [stage.free for stage in e.stages] == [("SPECIMEN.E",), "all"] and e.stages[0].max_iterations == 3
    assert (e.options.interpolation, e.options.weighting, e.options.step_limit,
            e.options.substeps) == ("quintic", "paper", 0.05, 2)
    assert load_experiment(folder, {"camera.rotation_deg": 0.25}).model.parameters["camera.rotation_deg"].value == 0.25


def test_every_further_degree_of_freedom_of_the_contract_has_a_name(folder):
    names = [f"camera.{n}" for n in ("pixel_size", "rotation_deg", "shift_col", "shift_row", "k1", "tilt_x", "tilt_y")]
    names += [f"channel.force_kN.{n}" for n in ("scale", "offset", "drift", "curvature", "friction",
                                                "friction_share")] + ["geometry.thickness", "time.offset"]
    with (folder / "experiment.toml").open("a") as stream:
        stream.writelines(f'[[dof]]\nname = "{name}"\n' for name in names)
    e = load_experiment(folder)
    assert set(names) <= set(e.model.parameters.free)
    assert all(np.isfinite(e.model.parameters[name].scale) and e.model.parameters[name].scale > 0 for name in names)
    assert e.model.parameters["channel.force_kN.scale"].value == 1.0
    assert e.model.parameters["camera.pixel_size"].value == pytest.approx(0.1)


# frames and images --------------------------------------------------------------------------------------
def test_a_log_of_other_length_is_matched_by_time(folder):
    rows = "".join(f"{0.5 * k},{0.05 * k},{2.5 * k}\n" for k in range(9))
    (folder / "loads.csv").write_text("time_s,force_kN,grip_um\n" + rows)
    e = load(folder, "kind =", "frame_interval_s = 1.25\nfirst_frame_s = 0.25\nkind =")
    np.testing.assert_allclose(e.model.times, [0.25, 1.5, 2.75, 4.0])
    np.testing.assert_allclose(e.model.channels[0].values, 100.0 * e.model.times, rtol=1e-12)  # linear log: exact


def test_image_times_come_from_a_file_too(folder):
    (folder / "times.csv").write_text("time_ms\n0\n900\n1900\n3000\n")
    times = load(folder, "kind =", 'image_times = "times.csv"\nkind =').model.times
    np.testing.assert_allclose(times, [0.0, 0.9, 1.9, 3.0], rtol=1e-14)  # ms to s


# drives and loads ---------------------------------------------------------------------------------------
def test_a_displacement_counts_from_the_reference_unless_that_is_noise(folder):
    change(folder, "loads.csv", "0.000,0.1", "0.000,7.0")
    e = load_experiment(folder)
    drive = [p.drive for p in e.model.prescribed if isinstance(p.drive, Column)][0]
    assert drive.values[0] == 0.0 and drive.values[1] == pytest.approx(-0.002)
    assert any("relative to the reference" in note for note in e.notes)


def test_every_drive_of_the_contract_is_read(folder):
    change(folder, "experiment.toml", 'uy = { column = "grip_um", noise_std = 0.2 }',
           'uy = { column = "grip_um", noise_std = 0.2, identify_offset = true }')
    with (folder / "experiment.toml").open("a") as stream:
        stream.write('[sets]\nMID = { where = "y > 0.5 and y < 1.5 and x < 0.5" }\nRIM = { boundary = "outer" }\n'
                     '[[boundary]]\nnodes = "MID"\nux = { virtual = "bspline", modes = 2, time_modes = 3 }\n'
                     '[[boundary]]\npressure = { column = "p_kPa", edges = "RIGHT", follower = true }\n'
                     '[[boundary]]\nforce = { value = 3.0, unit = "kN", edges = "RIGHT", component = "x" }\n'
                     '[[boundary]]\ntemperature = { column = "room_C", nodes = "TOP" }\n')
    rows = "".join(f"0.{k},{k},{10 * k},2{k}\n" for k in range(4))
    (folder / "loads.csv").write_text("force_kN,grip_um,p_kPa,room_C\n" + rows)
    e = load_experiment(folder)
    drives = {(p.nodes, p.component): p.drive for p in e.model.prescribed}
    assert drives["BOTTOM", "x"] == Constant(0.0) and drives["TOP", "y"].identify_offset
    assert drives["MID", "x"] == Parametrised("bspline", 2, 3)
    assert len([name for name in e.model.parameters.free if name.startswith("boundary.MID.x.")]) == 6
    assert "boundary.TOP.y.offset" in e.model.parameters.free
    pressure, force = e.model.loads
    assert pressure.kind == "pressure" and pressure.follower and pressure.edges == "RIGHT"
    np.testing.assert_allclose(pressure.drive.values, [0, 0.01, 0.02, 0.03], rtol=1e-12)  # kPa to MPa
    assert force.drive == Constant(3000.0) and force.component == "x"
    (warm,) = e.model.temperatures
    assert warm.nodes == "TOP" and warm.drive.column == "room_C" and list(warm.drive.values) == [20, 21, 22, 23]
    assert any("no material has alpha" in note for note in e.notes)
    assert "RIM" in e.model.mesh.edge_sets and len(e.model.mesh.node_sets["RIM"]) == 14


def test_a_measured_boundary_moves_in_all_components(folder):
    e = load(folder, 'ux = 0.0\nuy = { column = "grip_um", noise_std = 0.2 }', 'u = "measured"')
    assert [(p.component, p.drive) for p in e.model.prescribed if p.nodes == "TOP"] == [("x", Measured()),
                                                                                        ("y", Measured())]


def test_capitals_of_set_names_do_not_matter_where_only_one_is_meant(folder):
    assert len(load(folder, 'nodes = "TOP"', 'nodes = "Top"').model.mesh.node_sets["Top"]) == 5


def test_an_edge_set_serves_as_a_node_set(folder):
    e = load(folder, 'reaction = "TOP"', 'reaction = "RIGHT"')
    assert len(e.model.mesh.node_sets["RIGHT"]) == 4


# lengths ------------------------------------------------------------------------------------------------
def test_a_mesh_in_metres_is_converted_and_its_sets_are_in_metres(folder):
    text = re.sub(r"^(\d+), (\d)\.0, (\d)\.0, 0\.0$", r"\1, 0.00\2, 0.00\3, 0.0", inp_text(), flags=re.M)
    (folder / "mesh.inp").write_text(text)
    with (folder / "experiment.toml").open("a") as stream:
        stream.write('[sets]\nHIGH = { where = "y > 0.0029" }\n')
    e = load(folder, 'mesh_unit = "mm"', 'mesh_unit = "m"')
    np.testing.assert_allclose(e.model.mesh.nodes.max(axis=0), [4.0, 3.0], rtol=1e-12)
    assert len(e.model.mesh.node_sets["HIGH"]) == 5


def test_a_matrix_maps_mesh_units_to_pixels(folder):
    e = load(folder, 'pixel_size_mm = 0.1\norigin_px = [10.0, 40.0]\naxes = ["+col", "-row"]',
             "origin_px = [10.0, 40.0]\nmatrix_px_per_unit = [[10.0, 0.0], [0.0, -10.0]]")
    np.testing.assert_allclose(e.model.camera.project(np.array([[1.0, 2.0]])), [[20, 20]])


NO_FORCE = TOML.split("[[channel]]")[0].replace("thickness_mm = 2.0\n", "").replace('loads = "loads.csv"\n', "") \
    .replace('uy = { column = "grip_um", noise_std = 0.2 }', "uy = 0.1")


def test_no_scale_no_log_and_no_thickness_are_needed_where_no_force_is_compared(tmp_path):
    toml = re.sub(r"\[camera\].*?\n\n", "", NO_FORCE, flags=re.S).replace('mesh_unit = "mm"\n', "")
    e = load_experiment(write_experiment(tmp_path / "a", toml))
    assert e.model.length_unit == "px" and e.model.thickness is None and e.model.channels == ()
    np.testing.assert_allclose(e.model.camera.project(np.array([[3.0, 2.0]])), [[3, 2]])
    assert e.model.times.tolist() == [0, 1, 2, 3] and any("no scale" in note for note in e.notes)


@pytest.mark.parametrize("camera", ["",
                                    '[camera]\npixel_size_mm = 0.1\naxes = ["+col", "-row"]\n'
                                    "origin_px = [0.0, 49.0]\n"])
def test_a_mesh_is_made_on_the_image(camera, tmp_path):
    toml = re.sub(r"\[camera\].*?\n\n", camera, NO_FORCE, flags=re.S)
    toml = toml.replace('mesh = "mesh.inp"\nmesh_unit = "mm"',
                        "mesh = { roi_px = [5, 5, 55, 45], element_px = 5, holes_px = [[30, 25, 9]] }")
    e = load_experiment(write_experiment(tmp_path / "a", toml))
    px = e.model.camera.project(e.model.mesh.nodes)
    assert e.model.length_unit == ("mm" if camera else "px")
    assert px.min() == pytest.approx(5.0) and px.max() == pytest.approx(55.0)
    assert px[e.model.mesh.node_sets["TOP"]][:, 1] == pytest.approx(5.0)  # the top of the image
    radius = np.hypot(*(px[e.model.mesh.node_sets["HOLE1"]] - (30, 25)).T)
    np.testing.assert_allclose(radius, 9.0, rtol=1e-9)
    edge = np.array([px[e.model.mesh.face_nodes(face)] for face in e.model.mesh.edge_sets["TOP"]])
    assert edge[:, :, 1] == pytest.approx(5.0)


@pytest.mark.parametrize("hole", [(30, 25, 4), (28, 24, 12), (5, 25, 8), (12, 12, 6), (30, 25, 18),
                                  (31.3, 26.1, 7.7)])
def test_every_hole_leaves_a_mesh_of_sound_elements(hole, tmp_path):
    toml = re.sub(r"\[camera\].*?\n\n", "", NO_FORCE, flags=re.S)
    toml = toml.replace('mesh = "mesh.inp"\nmesh_unit = "mm"',
                        f"mesh = {{ roi_px = [5, 5, 55, 45], element_px = 4, holes_px = [{list(hole)}] }}")
    e = load_with_its_defaults(write_experiment(tmp_path / "a", toml))  # checks that it is one piece
    e.model.mesh.check_elements()
    faces = e.model.mesh.boundary_faces()
    ends = e.model.camera.project(e.model.mesh.nodes)[np.array([e.model.mesh.face_nodes(face)
                                                                for face in faces])]  # corners, middle
    at = np.hypot(*(ends - hole[:2]).transpose(2, 0, 1))  # (n_faces, 3)
    rim = np.abs(at[:, :2] - hole[2]).max(axis=1) < 1e-6 * hole[2]
    assert rim.any() and "HOLE1" in e.model.mesh.node_sets
    np.testing.assert_allclose(at[rim, 2], hole[2], rtol=1e-9)  # round between the corners too


@pytest.mark.parametrize("elements", ["quads", "triangles"])
@pytest.mark.parametrize("camera",
                         ["", '[camera]\npixel_size_mm = 0.1\naxes = ["+col", "-row"]\norigin_px = [0.0, 49.0]\n'])
def test_a_drawn_outline_is_meshed_with_its_arcs_holes_and_names(camera, elements, tmp_path):
    toml = re.sub(r"\[camera\].*?\n\n", camera, NO_FORCE, flags=re.S)
    toml = toml.replace('mesh = "mesh.inp"\nmesh_unit = "mm"',
                        "mesh = { outline_px = [[5, 5], [55, 5], [50, 25, 55, 45], [5, 45]], element_px = 5, "
                        "holes_px = [[30, 25, 6], [[10, 12], [18, 12], [14, 18]]], edge_names = { TOP = [1], BOTTOM = "
                        "[3] }, "
                        f'elements = "{elements}" }}')
    e = load_with_its_defaults(write_experiment(tmp_path / "a", toml))
    px = e.model.camera.project(e.model.mesh.nodes)
    assert e.model.length_unit == ("mm" if camera else "px")
    assert px[e.model.mesh.node_sets["TOP"]][:, 1] == pytest.approx(5.0)
    assert px[e.model.mesh.node_sets["BOTTOM"]][:, 1] == pytest.approx(45)
    assert {block.cell for block in e.model.mesh.blocks} >= {"quad8" if elements == "quads" else "tri6"}
    for name, centre, radius in (("HOLE1", (30, 25), 6.0), ("EDGE2", (92.5, 25), 42.5)):  # 42.5 = (20² + 5²) / (2 · 5)
        rim = px[np.unique(np.concatenate([e.model.mesh.face_nodes(face) for face in e.model.mesh.edge_sets[name]]))]
        np.testing.assert_allclose(np.hypot(*(rim - centre).T), radius, rtol=1e-9)  # mid-side nodes included
    assert "HOLE2" in e.model.mesh.edge_sets
    again = load_with_its_defaults(tmp_path / "a")
    assert np.array_equal(again.model.mesh.nodes,
                          e.model.mesh.nodes) and again.recording.identity == e.recording.identity


def test_a_drawn_outline_in_mm_needs_the_scale(tmp_path):
    toml = NO_FORCE.replace('mesh = "mesh.inp"',
                            "mesh = { outline_mm = [[0, 0], [4, 0], [4, 3], [0, 3]], element_mm = 1, "
                           "edge_names = { BOTTOM = [1], TOP = [3] } }")
    e = load_with_its_defaults(write_experiment(tmp_path / "a", toml))
    assert e.model.mesh.nodes.max(axis=0) == pytest.approx([4, 3])
    unscaled = re.sub(r"\[camera\].*?\n\n", "", toml, flags=re.S).replace('mesh_unit = "mm"\n', "")
    with pytest.raises(InputError, match="scale"):
        load_with_its_defaults(write_experiment(tmp_path / "b", unscaled))


# materials ----------------------------------------------------------------------------------------------
@pytest.mark.parametrize("pair", ["K = { value = 58.3333333333333, unit = \"GPa\" }\nG = 26923.0769230769",
                                  "E = 70e3\nG = 26923.0769230769", "E = 70e3\nK = 58333.3333333333",
                                  "lam = 40384.6153846154\nmu = 26923.0769230769"])
def test_other_pairs_of_elastic_constants_are_converted(pair, folder):
    text = (folder / "experiment.toml").read_text()
    start, stop = text.index("E = {"), text.index("[[boundary]]")
    (folder / "experiment.toml").write_text(text[:start] + pair + "\n" + text[stop:])
    e = load_experiment(folder)
    assert e.model.parameters["SPECIMEN.E"].value == pytest.approx(70e3)
    assert e.model.parameters["SPECIMEN.nu"].value == pytest.approx(0.3)


def test_one_material_means_the_whole_mesh_where_the_mesh_names_no_sets(folder):
    (folder / "mesh.inp").write_text(inp_text().replace(", ELSET=SPECIMEN", "").split("*ELSET")[0])
    e = load_experiment(folder)
    assert len(e.model.mesh.element_sets["SPECIMEN"]) == 12 and any("no element sets" in note for note in e.notes)


def test_two_materials_share_the_mesh_by_position(folder):
    with (folder / "experiment.toml").open("a") as stream:
        stream.write('[sets]\nLEFT_HALF = { where = "x < 2" }\nRIGHT_HALF = { where = "x > 2" }\n'
                     '[material.RIGHT_HALF]\nlaw = "elastic"\nE = 1.0\nnu = 0.4\n')
    e = load(folder, "[material.SPECIMEN]", "[material.LEFT_HALF]")
    assert [len(e.model.mesh.element_sets[m.element_set]) for m in e.model.materials] == [6, 6]


def test_a_rate_dependent_law_needs_times(folder):
    log = (folder / "loads.csv").read_text().splitlines()
    (folder / "loads.csv").write_text("\n".join(",".join(row.split(",")[:1] + row.split(",")[2:]) for row in log))
    load_experiment(folder)  # an elastic one needs none
    creep = 'law = "elastoplastic"\nyield_stress = 100.0\nrate = { kind = "norton", eta = 100.0, m = 5.0 }'
    with pytest.raises(InputError, match="the frames have no times"):
        load(folder, 'law = "elastic"', creep)


CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))
CUBE = "*NODE\n" + "".join(f"{4 * k + j + 1}, {2 * x}, {2 * y}, {0.5 * k}\n"
                           for k in range(2) for j, (x, y) in enumerate(CORNERS)) + """
*ELEMENT, TYPE=C3D8, ELSET=SPECIMEN
1, 1,2,3,4,5,6,7,8
*SURFACE, NAME=FRONT
1, S2
*NSET, NSET=BOTTOM
1,2,5,6
*NSET, NSET=TOP
3,4,7,8
*NSET, NSET=BACK
1,2,3,4
"""


def test_a_solid_is_seen_through_its_surface(folder):
    (folder / "mesh.inp").write_text(CUBE)
    change(folder, "experiment.toml", "thickness_mm = 2.0\n", 'surface = "FRONT"\n')
    change(folder, "experiment.toml", '"plane_stress"', '"solid"')
    with pytest.raises(InputError, match="unconstrained"):
        load_experiment(folder)  # nothing holds z
    with (folder / "experiment.toml").open("a") as stream:
        stream.write('[[boundary]]\nnodes = "BACK"\nuz = 0.0\n')
    e = load_experiment(folder)
    assert e.model.n_dim == 3 and e.model.thickness is None
    assert e.model.surface == "FRONT" and e.model.mesh.edge_sets["FRONT"].tolist() == [[0, 1]]
    with pytest.raises(InputError, match="face set"):
        change(folder, "experiment.toml", 'surface = "FRONT"\n', "")
        load_experiment(folder)


def test_a_plane_strain_section_is_seen_from_above(folder):
    change(folder, "experiment.toml", '"plane_stress"', '"plane_strain"')
    assert load(folder, "kind =", 'surface = "TOP"\nkind =').model.mesh.edge_sets["TOP"].shape == (4, 2)


# whole data sets ----------------------------------------------------------------------------------------
@pytest.mark.parametrize("name, n_frames, n_elements, free", [
    ("open-case-1-plate-with-hole-elastoplastic", 26, 1196, 4), ("open-case-2-wrong-model-clear", 26, 1368, 2),
    ("open-case-3-concealed", 36, 1196, 2),
])
def test_the_experiments_of_the_public_data_load_as_they_are(name, n_frames, n_elements, free, shared_data):
    e = load_experiment(shared_data(name))
    assert (e.model.n_frames, e.model.mesh.n_elements, len(e.model.parameters.free)) == (n_frames, n_elements, free)
    assert e.recording.noise.std_gv == 2.55 and e.recording.stack.frame(1).dtype == np.uint8
    assert e.model.channels[0].column == "force_N"


@pytest.mark.parametrize("mesh, unit, cell", [("abaqus_q4_m.inp", "m", "quad4"), ("gmsh_t3_mm.msh", "mm", "tri3"),
                                              ("bride.msh", "m", "quad4")])
def test_the_open_hole_coupon_loads_without_force_times_and_thickness(mesh, unit, cell, shared_data, tmp_path):
    source = shared_data("open-hole-composite")
    (tmp_path / "images").symlink_to(source / "images")
    (tmp_path / mesh).symlink_to(source / "meshes" / mesh)
    scale = 1.0 if unit == "m" else 1e-3
    (tmp_path / "experiment.toml").write_text(f"""
[experiment]
images = "images/*.tif"
mesh = "{mesh}"
mesh_unit = "{unit}"
kind = "plane_stress"
exclude_frames = [78]
[camera]
origin_px = [854.611, 1014.558]
matrix_px_per_unit = [[{-32.281 * scale}, {-10526.266 * scale}], [{-10526.266 * scale}, {32.281 * scale}]]
[material.COUPON]
law = "orthotropic"
E1 = {{ value = 60, unit = "GPa", identify = true }}
E2 = {{ value = 60, unit = "GPa", identify = true }}
nu12 = {{ value = 0.3, identify = true }}
G12 = {{ value = 20, unit = "GPa", identify = true }}
angle = 0.0
[sets]
LOW = {{ where = "x < {0.0001 / scale}" }}
HIGH = {{ where = "x > {0.0899 / scale}" }}
[[boundary]]
nodes = "LOW"
u = "measured"
[[boundary]]
nodes = "HIGH"
u = "measured"
""")
    e = load_experiment(tmp_path)
    assert e.recording.labels[e.recording.excluded[0]] == "zoom-0078_1.tif"
    assert e.model.mesh.blocks[0].cell == cell and e.model.thickness is None
    np.testing.assert_allclose(e.model.mesh.nodes.max(axis=0), [90, 30], rtol=1e-3)  # mm; the file has seven digits
    hole = e.model.camera.project(np.array([[45.1, 15.34]]))[0]
    np.testing.assert_allclose(hole, [691.7, 540.3], atol=1.0)  # the README: within 1 px
    with pytest.raises(InputError, match="no such frame"):
        load_experiment(tmp_path, {"experiment.exclude_frames": [79]})


def test_without_a_force_stresses_are_said_to_be_no_measurement(folder):
    held = {"value": 70.0, "unit": "GPa"}
    said = [[note for note in load_experiment(folder, overrides).notes if "no force" in note]
            for overrides in ({}, {"channel": []}, {"channel": [], "material.SPECIMEN.E": held})]
    assert said[0] == [] and len(said[1]) == len(said[2]) == 1
    assert said[1][0].endswith("SPECIMEN.E cannot be identified")
    assert "the fixed values of SPECIMEN.E" in said[2][0]
