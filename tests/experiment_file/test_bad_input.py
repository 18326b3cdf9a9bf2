"""Bad input: one clear message that names file, key, what was expected, what was found, what to do; nothing written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from experiment_file.small_experiment import change, write_experiment
from idic.errors import InputError
from idic.experiment_file import load_experiment

TOML = "experiment.toml"


def text(old: str, new: str, name: str = TOML):
    return lambda folder: change(folder, name, old, new)


def append(extra: str, name: str = TOML):
    return lambda folder: (folder / name).write_text((folder / name).read_text() + extra)


def image(k: int, pixels: np.ndarray, **options):
    return lambda folder: tifffile.imwrite(folder / "images" / f"frame_{k:03d}.tif", pixels, **options)


def cut(name: str, part: float):
    """The first part of a file only."""
    def do(folder: Path):
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(data[:int(part * len(data))])
    return do


def both(*steps):
    return lambda folder: [step(folder) for step in steps]


def write(name: str, content: str):
    return lambda folder: (folder / name).write_text(content)


def mask(pixels: np.ndarray):
    def do(folder: Path):
        Image.fromarray(pixels).save(folder / "mask.png")
        change(folder, TOML, 'kind =', 'mask = "mask.png"\nkind =')
    return do


GREY = np.zeros((50, 60), np.uint8)
NAN_MAP = np.full((50, 60), np.nan, np.float32)
DOF = '\n[[dof]]\nname = "{}"\n'
BOTTOM = '[[boundary]]\nnodes = "BOTTOM"\nux = 0.0\nuy = 0.0\n'
TOP_BLOCK = '[[boundary]]\nnodes = "TOP"\nux = 0.0\nuy = { column = "grip_um", noise_std = 0.2 }\n'

ORTHOTROPIC = 'nu12 = 0.3\nE1 = { value = 5, unit = "GPa" }\nG12 = { value = 5, unit = "GPa" }\nangle = 0.0'

# name: (how the folder is spoilt, the file named, the key named, a part of what was found)
CASES = {
    # the file itself
    "no experiment file": (lambda f: (f / TOML).unlink(), "", "experiment.toml", "none"),
    "not TOML": (text('title = "small"', "title = small"), TOML, None, "line 3"),
    "not UTF-8": (lambda f: (f / TOML).write_bytes(b'title = "\xe9"\n'), TOML, None, "utf-8"),
    "UTF-16 cut in a character": (lambda f: (f / TOML).write_bytes(b"\xff\xfe\x00"), TOML, None, "utf-16"),
    "unknown table": (append("\n[cameras]\nx = 1\n"), TOML, "cameras", "cameras"),
    "unknown key": (text("thickness_mm", "thicknes_mm"), TOML, "experiment.thicknes_mm", "thicknes_mm"),
    "unknown key in a list of tables": (text("noise_std = 0.005", "noise = 0.005"), TOML, "channel[0].noise", "noise"),
    "a key is missing": (text('kind = "plane_stress"', ""), TOML, "experiment.kind", "no such key"),
    "no material": (lambda f: (f / TOML).write_text((f / TOML).read_text().split("[material")[0]), TOML, "material",
                    "no such"),
    "text for a number": (text("thickness_mm = 2.0", 'thickness_mm = "2.0"'), TOML, "experiment.thickness_mm", "2.0"),
    "true for a number": (text("uy = 0.0", "uy = true"), TOML, "boundary[0].uy", "True"),
    "unknown kind": (text("plane_stress", "plain_stress"), TOML, "experiment.kind", "plain_stress"),
    "negative thickness": (text("thickness_mm = 2.0", "thickness_mm = -2.0"), TOML, "experiment.thickness_mm", "-2.0"),
    "nan for a number": (text("thickness_mm = 2.0", "thickness_mm = nan"), TOML, "experiment.thickness_mm", "nan"),
    "unknown option": (append("\n[options]\nmax_iteration = 3\n"), TOML, "options.max_iteration", "max_iteration"),
    "option out of range": (append("\n[options]\nmax_iterations = 0\n"), TOML, "options.max_iterations", "0"),
    # paths
    "no images": (text("images/*.tif", "images/*.png"), TOML, "experiment.images", "frame_000.tif"),
    "path out of the folder": (text('mesh = "mesh.inp"', 'mesh = "../mesh.inp"'), TOML, "experiment.mesh",
                               "../mesh.inp"),
    "absolute path": (text('loads = "loads.csv"', 'loads = "/loads.csv"'), TOML, "experiment.loads", "/loads.csv"),
    "no such log": (text('loads = "loads.csv"', 'loads = "load.csv"'), TOML, "experiment.loads", "loads.csv"),
    "no such mesh": (text('mesh = "mesh.inp"', 'mesh = "mesh.msh"'), TOML, "experiment.mesh", "mesh.inp"),
    # images
    "images of different size": (image(2, np.zeros((50, 61), np.uint8)), "frame_002.tif", "experiment.images",
                                 "61 x 50"),
    "images of different depth": (image(2, np.zeros((50, 60), np.uint16)), "frame_002.tif", "experiment.images",
                                  "uint16"),
    "truncated TIFF": (cut("images/frame_002.tif", 0.5), "frame_002.tif", "images", "bytes"),
    "empty TIFF": (cut("images/frame_001.tif", 0.0), "frame_001.tif", "images", ""),
    "text called TIFF": (write("images/frame_001.tif", "hello"), "frame_001.tif", "images", "Error"),
    "colour TIFF": (image(0, np.arange(9000, dtype=np.uint8).reshape(50, 60, 3), photometric="rgb"), "frame_000.tif",
                    "images", "3 channels"),
    "32-bit integer TIFF": (image(0, np.zeros((50, 60), np.int32)), "frame_000.tif", "images", "int32"),
    "one image": (text("images/*.tif", "images/frame_000.tif"), TOML, "experiment.images", "1"),
    "JPEG": (both(lambda f: Image.fromarray(GREY).save(f / "images" / "a.jpg"), text("*.tif", "*.jpg")), "a.jpg",
             "images", ".jpg"),
    "mask of another size": (mask(np.full((50, 61), 255, np.uint8)), TOML, "experiment.mask", "61 x 50"),
    "black mask": (mask(GREY), TOML, "experiment.mask", "no pixel"),
    "mask beside the mesh": (mask(np.pad(np.full((5, 5), 255, np.uint8), ((0, 45), (0, 55)))), TOML, "experiment.mask",
                             "rows 0"),
    "unknown frame": (text("kind =", 'exclude_frames = [17]\nkind ='), TOML, "experiment.exclude_frames", "17"),
    "unknown reference": (text("kind =", 'reference = "frame_9.tif"\nkind ='), TOML, "experiment.reference",
                          "frame_9.tif"),
    "reference excluded": (text("kind =", "exclude_frames = [0]\nkind ="), TOML, "experiment.exclude_frames",
                           "frame_000.tif"),
    "height without unit": (text("kind =", 'quantity = "height"\nkind ='), TOML, "experiment", "height_unit = None"),
    # the log
    "missing column": (text("grip_um\n", "grip_nm\n", "loads.csv"), TOML, "boundary[1].uy.column", "grip_nm"),
    "missing channel": (text("force_kN", "load_kN", "loads.csv"), TOML, "channel[0].column", "load_kN"),
    "wrong unit of a column": (both(text("grip_um\n", "grip_MPa\n", "loads.csv"), text("grip_um", "grip_MPa")), TOML,
                               "boundary[1].uy.column", "MPa"),
    "column without a unit": (both(text("grip_um\n", "grip\n", "loads.csv"), text("grip_um", "grip")), TOML,
                              "boundary[1].uy.column", "grip"),
    "NaN in the log": (text("0.200", "nan", "loads.csv"), "loads.csv", "column force_kN, line 4", "nan"),
    "text in the log": (text("0.200", "lost", "loads.csv"), "loads.csv", "column force_kN, line 4", "lost"),
    "empty cell in the log": (text("0.200", "", "loads.csv"), "loads.csv", "column force_kN, line 4", "empty"),
    "fewer log rows than frames": (text("3,3.0,0.300,15.0\n", "", "loads.csv"), "loads.csv", "loads", "3 rows"),
    "more log rows than frames": (both(text("frame,", "point,", "loads.csv"), append("4,4.0,0.4,20.0\n", "loads.csv")),
                                  "loads.csv", "loads", "5 rows"),
    "unsorted times": (text("2,2.0", "2,0.5", "loads.csv"), "loads.csv", "time_s", "0.5"),
    "quote that never ends": (text("1,1.0", '"1,1.0', "loads.csv"), "loads.csv", "line 3", "1 cells"),
    "frame column disagrees": (text("2,2.0", "7,2.0", "loads.csv"), "loads.csv", "column frame", "7"),
    "ragged log": (text("1,1.0,0.100,5.0", "1,1.0,0.100", "loads.csv"), "loads.csv", "line 3", "3 cells"),
    "log without a header": (text("frame,time_s,force_kN,grip_um\n", "", "loads.csv"), "loads.csv", "line 1", "0"),
    "column twice in the log": (text("force_kN", "grip_um", "loads.csv"), "loads.csv", "grip_um", "grip_um"),
    "image outside the log's time": (text("kind =", "frame_interval_s = 5.0\nkind ="), "loads.csv", "time_s",
                                     "image 1 at 5 s"),
    "column but no log": (text('loads = "loads.csv"', ""), TOML, "boundary[1].uy.column", "grip_um"),
    # mesh and sets
    "unknown mesh unit": (text('mesh_unit = "mm"', 'mesh_unit = "furlong"'), TOML, "experiment.mesh_unit", "furlong"),
    "no length as mesh unit": (text('mesh_unit = "mm"', 'mesh_unit = "MPa"'), TOML, "experiment.mesh_unit", "MPa"),
    "mesh in mm without a scale": (text("pixel_size_mm = 0.1", ""), TOML, "camera.pixel_size_mm", "no pixel_size_mm"),
    "no origin": (text("origin_px = [10.0, 40.0]", ""), TOML, "camera.origin_px", "no such key"),
    "mesh wholly outside the image": (text("[10.0, 40.0]", "[1000.0, 40.0]"), TOML, "camera", "columns 1000"),
    "both axes along the columns": (text('"-row"', '"-col"'), TOML, "camera.axes", "-col"),
    "folded element": (text("1006, 107, 108, 113, 112", "1006, 107, 113, 108, 112", "mesh.inp"), "mesh.inp",
                         "experiment.mesh", "1006"),
    "element with a missing node": (text("1006, 107,", "1006, 999,", "mesh.inp"), "mesh.inp", "line", "999"),
    "truncated mesh": (cut("mesh.inp", 0.55), "mesh.inp", None, ""),
    "range of labels without an end": (text("101, 105, 1", "101", "mesh.inp"), "mesh.inp", "line", "101"),
    "unknown element type": (text("CPS4", "CPX4", "mesh.inp"), "mesh.inp", "line", "CPX4"),
    "solid kind for a plane mesh": (text('"plane_stress"', '"solid"'), "mesh.inp", "mesh", "quad4"),
    "a format that is no mesh": (both(text('"mesh.inp"', '"mesh.doc"'), write("mesh.doc", "x")), "mesh.doc", "mesh",
                                 ".doc"),
    "damaged gmsh file": (both(text('"mesh.inp"', '"mesh.msh"'), write("mesh.msh", "$MeshFormat\n2.2 0 8\n")),
                          "mesh.msh", "mesh", ""),
    "unknown node set": (text('nodes = "TOP"', 'nodes = "TPO"'), TOML, "boundary[1].nodes", "TPO"),
    "unknown element set": (text("[material.SPECIMEN]", "[material.SHEET]"), TOML, "material.SHEET", "SHEET"),
    "empty set by position": (append('\n[sets]\nA = { where = "y > 50" }\n'), TOML, "sets.A.where", "none"),
    "no expression": (append('\n[sets]\nA = { where = "__import__(\'os\')" }\n'), TOML, "sets.A.where", "__import__"),
    "set of the mesh again": (append('\n[sets]\nTOP = { where = "y > 2" }\n'), TOML, "sets.TOP", "TOP"),
    # materials and degrees of freedom
    "unknown law": (text('"elastic"', '"elastik"'), TOML, "material.SPECIMEN.law", "elastik"),
    "unknown kinematics": (text('law = "elastic"', 'law = "elastic"\nkinematics = "large"'), TOML,
                           "material.SPECIMEN.kinematics", "large"),
    "unknown parameter of a law": (text("nu = 0.3", "nu = 0.3\nyield_stress = 200.0"), TOML,
                                   "material.SPECIMEN.yield_stress", "yield_stress"),
    "missing parameter of a law": (text("nu = 0.3", ""), TOML, "material.SPECIMEN.nu", "E"),
    "wrong unit of a parameter": (text('"GPa"', '"mm"'), TOML, "material.SPECIMEN.E.unit", "mm"),
    "unknown unit of a parameter": (text('"GPa"', '"Gpascal"'), TOML, "material.SPECIMEN.E.unit", "Gpascal"),
    "parameter out of its bounds": (text("bounds = [10, 200]", "bounds = [80, 200]"), TOML, "material.SPECIMEN.E",
                                    "70"),
    "parameter that is not possible": (text("nu = 0.3", "nu = 0.7"), TOML, "material.SPECIMEN.nu", "0.7"),
    "moduli that were exchanged": (both(text('"elastic"', '"orthotropic"'), text("E = {", "E2 = {"),
                                        text("nu = 0.3", ORTHOTROPIC)), TOML, "material.SPECIMEN", "nu12 = 0.3"),
    "zero stiffness": (both(text("value = 70,", "value = 0,"), text("[10, 200]", "[0, 200]")), TOML,
                       "material.SPECIMEN.E", "0"),
    "bounds in the wrong order": (text("[10, 200]", "[200, 10]"), TOML, "material.SPECIMEN.E", "200"),
    "prior without width": (text("std = 5", "std = 0"), TOML, "material.SPECIMEN.E.prior.std", "0"),
    "unknown degree of freedom": (append(DOF.format("camera.rotation")), TOML, "dof[0].name", "camera.rotation"),
    "degree of freedom twice": (append(DOF.format("camera.k1") * 2), TOML, "dof[1].name", "camera.k1"),
    "degree of freedom of a material": (append(DOF.format("SPECIMEN.E")), TOML, "dof[0].name", "SPECIMEN.E"),
    "stage with a locked parameter": (append('\n[[stage]]\nfree = ["SPECIMEN.nu"]\n'), TOML, "stage[0].free",
                                      "SPECIMEN.nu"),
    "stage with an unknown parameter": (append('\n[[stage]]\nfree = ["E"]\n'), TOML, "stage[0].free", "E"),
    # boundary and channels
    "unconstrained body": (both(text(BOTTOM, ""), text(TOP_BLOCK, '[[boundary]]\nnodes = "TOP"\nuy = 0.0\n')), TOML,
                           "boundary",
                           "move along x"),
    "nothing prescribed": (both(text(BOTTOM, ""), text(TOP_BLOCK, "")), TOML, "boundary", "move freely"),
    "a component of a plane model": (text("ux = 0.0", "uz = 0.0"), TOML, "boundary[0].uz", "z"),
    "unknown drive": (text("uy = 0.0", 'uy = "measurd"'), TOML, "boundary[0].uy", "measurd"),
    "two drives in one": (text('column = "grip_um"', 'column = "grip_um", value = 1.0'), TOML, "boundary[1].uy",
                          "column"),
    "a node driven in two ways": (append('\n[[boundary]]\nnodes = "RIGHT"\nux = 0.1\n'), TOML, "boundary", "node"),
    "boundary that does nothing": (append('\n[[boundary]]\nnodes = "TOP"\n'), TOML, "boundary[2]", "none"),
    "pressure without an edge": (append("\n[[boundary]]\npressure = 1.0\n"), TOML, "boundary[2].pressure.edges",
                                 "none"),
    "force without a direction": (append('\n[[boundary]]\nforce = { value = 1.0, edges = "RIGHT" }\n'), TOML,
                                  "boundary[2].force.component", "none"),
    "force without thickness": (text("thickness_mm = 2.0", ""), TOML, "experiment.thickness_mm", "no such key"),
    "reaction of an unknown set": (text('reaction = "TOP"', 'reaction = "GRIP"'), TOML,
                                   "channel[0].simulated.reaction", "GRIP"),
    "two cameras": (text("[camera]", "[[camera]]\n[[camera]]"), TOML, "camera[1].name", "no such key"),
    "surface of a plane specimen": (text("kind =", 'surface = "TOP"\nkind ='), TOML, "experiment.surface", "TOP"),
    "roi the wrong way round": (text('mesh = "mesh.inp"\nmesh_unit = "mm"',
                                     "mesh = { roi_px = [50, 10, 10, 40], element_px = 5 }"),
                                TOML, "experiment.mesh", "50"),
    "roi without element size": (text('mesh = "mesh.inp"\nmesh_unit = "mm"', "mesh = { roi_px = [10, 10, 50, 40] }"),
                                 TOML,
                                 "experiment.mesh", "no element size"),
    "an outline that crosses itself": (text('mesh = "mesh.inp"\nmesh_unit = "mm"',
                                            "mesh = { outline_px = [[10, 10], [50, 40], [50, 10], [10, 41]], "
                                            "element_px = 5 }"),
                                       TOML, "experiment.mesh", "a crossing of the outline"),
    "a name of an edge that the outline lacks": (
        text('mesh = "mesh.inp"\nmesh_unit = "mm"',
             "mesh = { outline_px = [[10, 10], [50, 10], [50, 40]], element_px = 5, edge_names = { GRIP = [4] } }"),
        TOML, "experiment.mesh.edge_names.GRIP", "[4]"),
    "a triangular hole in a rectangle": (
        text('mesh = "mesh.inp"\nmesh_unit = "mm"',
             "mesh = { roi_px = [10, 10, 50, 40], element_px = 5, holes_px = [[[20, 20], [30, 20], [25, 30]]] }"),
        TOML, "experiment.mesh", "a list of points"),
    "a hole smaller than an element": (
        text('mesh = "mesh.inp"\nmesh_unit = "mm"',
             "mesh = { roi_px = [10, 10, 50, 40], element_px = 5, holes_px = [[20, 20, 8], [40, 25, 2.4]] }"),
        TOML, "experiment.mesh", "radius 2.4, elements of 5"),
    "a hole beside the rectangle": (
        text('mesh = "mesh.inp"\nmesh_unit = "mm"',
             "mesh = { roi_px = [10, 10, 50, 40], element_px = 5, holes_px = [[70, 20, 8]] }"),
        TOML, "experiment.mesh", "[70.0, 20.0, 8.0]"),
}
CASES["elements without a material"] = (
    both(append('\n[sets]\nA = { where = "x < 2" }\n'), text("[material.SPECIMEN]", "[material.A]")), TOML, "material",
    "6 elements")
CASES["NaN in a height map"] = (
    both(*(image(k, NAN_MAP) for k in range(4)), text("kind =", 'quantity = "height"\nheight_unit = "um"\nkind =')),
    None, None, None)


def snapshot(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.parametrize("name", CASES)
def test_bad_input_gives_one_clear_message_and_writes_nothing(name, tmp_path):
    spoil, file, key, found = CASES[name]
    folder = write_experiment(tmp_path / "test")
    spoil(folder)
    before = snapshot(tmp_path)
    with pytest.raises(InputError) as caught:
        experiment = load_experiment(folder)
        experiment.recording.stack.frame(0)  # pixels are read when asked for
    error, message = caught.value, str(caught.value)
    for part in (error.what, error.expected, error.found, error.remedy):
        assert part is not None and str(part).strip(), message
    if file is not None:
        assert file in str(error.file), message
    if key is not None:
        assert key in str(error.key), message
    if found is not None:
        assert found in str(error.found), message
    assert message.count("\n") <= 4 and "Traceback" not in message
    assert snapshot(tmp_path) == before


def test_no_such_folder_is_bad_input(tmp_path):
    with pytest.raises(InputError, match="no such experiment"):
        load_experiment(tmp_path / "nowhere")


@pytest.mark.parametrize("key, value, part", [
    ("options.max_iteration", 3, "max_iteration"), ("SPECIMEN.Q", 3, "SPECIMEN.Q"), ("foo.bar", 1, "foo.bar"),
    ("boundary.9.ux", 0.0, "boundary.9.ux"), ("SPECIMEN.E", "many", "SPECIMEN.E"),
    ("experiment.title.x", 1, "experiment.title.x"),
])
def test_a_bad_override_is_bad_input_and_names_the_key(key, value, part, tmp_path):
    folder = write_experiment(tmp_path / "test")
    with pytest.raises(InputError) as caught:
        load_experiment(folder, {key: value})
    assert part in str(caught.value)
    assert caught.value.remedy
