"""Every format of images, meshes, logs, calibrations and measured fields keeps the contract of readers."""

from __future__ import annotations

from importlib.util import find_spec

import h5py
import meshio
import nrrd
import numpy as np
import pytest
import tifffile
from instrument_files import write_cine, write_plu, write_plux, write_zs2
from PIL import Image
from reader_contract import ReaderContract
from test_calibration_files import TEXTS, opencv_yaml
from test_field_exports import GRID, displaced, ncorr_file, ncorr_hdf5, on_image

from experiment_file.small_experiment import LOADS, inp_text
from idic.readers import FieldSeries, Log, open_stack, read_calibration, read_mesh_file, volume_entries

PIXELS = np.arange(600, dtype=np.uint8).reshape(20, 30)
SQUARES = meshio.Mesh(np.array([[x, y, 0.0] for y in range(2) for x in range(3)]),
                      [("quad", np.array([[0, 1, 4, 3], [1, 2, 5, 4]]))])


HEIGHTS = np.random.default_rng(2).normal(size=(20, 30)).astype(np.float32)


def xyz(path):
    path.write_text("# units: um um nm\n" + "".join(f"{0.5 * column:g} {0.5 * row:g} {height}\n"
                                                    for (row, column), height in np.ndenumerate(HEIGHTS)))


class TestImages(ReaderContract):
    files = {"a.tif": lambda path: tifffile.imwrite(path, PIXELS),
             "deflated.tif": lambda path: tifffile.imwrite(path, PIXELS, compression="deflate"),
             "a.png": lambda path: Image.fromarray(PIXELS).save(path), "a.xyz": xyz}

    def read(self, path):
        return open_stack([path]).frame(0)


def film(path, write, **keys):
    """A film whose header lies in a folder of its own for every test."""
    write(path, np.stack([PIXELS, PIXELS[::-1]]).astype(np.uint16), 16, **keys)


@pytest.mark.skipif(None in (find_spec("surfalize"), find_spec("SurfaceTopography")),
                    reason="idic[instruments] is not installed")
class TestImagesOfInstruments(ReaderContract):
    files = {"a.cine": lambda path: film(path, write_cine), "a.plu": lambda path: write_plu(path, HEIGHTS, 0.5),
             "a.plux": lambda path: write_plux(path, HEIGHTS, 0.5)}

    def read(self, path):
        return open_stack([path]).frame(0)


class TestMeshes(ReaderContract):
    files = {"mesh.inp": lambda path: path.write_text(inp_text()),
             "mesh.msh": lambda path: meshio.write(path, SQUARES, file_format="gmsh22", binary=False),
             "mesh.vtu": SQUARES.write, "mesh.vtk": SQUARES.write, "mesh.med": SQUARES.write,
             "mesh.bdf": lambda path: meshio.write(path, SQUARES, file_format="nastran")}

    def read(self, path):
        return read_mesh_file(path)


VOXELS = np.random.default_rng(3).integers(0, 60_000, (6, 20, 30)).astype(np.uint16)
ALL = slice(None)


def compressed_hdf5(path):
    with h5py.File(path, "w") as file:
        file.create_dataset("entry/data", data=VOXELS, chunks=(2, 8, 8), compression="gzip")


class TestVolumes(ReaderContract):
    files = {"scan.tif": lambda path: tifffile.imwrite(path, VOXELS),
             "deflated.tif": lambda path: tifffile.imwrite(path, VOXELS, compression="deflate"),
             "tiles.tif": lambda path: tifffile.imwrite(path, VOXELS, tile=(16, 16)),
             "scan.npy": lambda path: np.save(path, VOXELS), "scan.h5": compressed_hdf5,
             "scan.nrrd": lambda path: nrrd.write(str(path), VOXELS.T, {"encoding": "raw"}),
             "scan.mha": lambda path: path.write_bytes(
                 b"NDims = 3\nDimSize = 30 20 6\nElementType = MET_USHORT\nElementDataFile = LOCAL\n"
                 + VOXELS.tobytes())}

    def read(self, path):
        voxels = volume_entries(path.parent, path.name)[0].block(ALL, ALL, ALL)
        assert voxels.shape == VOXELS.shape
        return voxels


class TestLogs(ReaderContract):
    files = {"comma.csv": lambda path: path.write_text(LOADS),
             "semicolon.csv": lambda path: path.write_text(LOADS.replace(",", ";")),
             "tab.txt": lambda path: path.write_text(LOADS.replace(",", "\t"))}

    def read(self, path):
        return Log.read(path).column("force_kN")


def tdms(path):
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("test", "force_kN", np.arange(50.0), {"wf_increment": 0.1})])


def xlsx(path):
    from openpyxl import Workbook

    workbook = Workbook()
    for cells in (("time_s", "force_kN"), *((k, 2.5 * k) for k in range(9))):
        workbook.active.append(cells)
    workbook.save(path)


@pytest.mark.skipif(find_spec("nptdms") is None, reason="idic[instruments] is not installed")
class TestLogsOfInstruments(ReaderContract):
    files = {"a.tdms": tdms, "a.xlsx": xlsx,
             "a.zs2": lambda path: write_zs2(
                 path, [{1: np.arange(9.0), 2: np.arange(9.0)}], {1: "Zeit", 2: "force_kN"})}

    def read(self, path):
        return Log.read(path).column("force_kN")


class TestCalibrations(ReaderContract):
    files = {name: lambda path, text=text: path.write_text(text()) for name, text in TEXTS.items()} | {
        "cv.yml": opencv_yaml, "cv.xml": opencv_yaml}

    def read(self, path):
        return read_calibration(path)


def vtu(path):
    still = np.zeros((len(GRID), 1))
    meshio.Mesh(np.hstack([GRID, still]), [("vertex", np.arange(len(GRID))[:, None])],
                point_data={"displacement": np.hstack([displaced(1), still])}).write(path)


def mudic(path):
    column, row = np.meshgrid(np.arange(5.0), np.arange(6.0))
    positions = [np.stack([column + on_image(k)[0], row + on_image(k)[1]]) for k in range(3)]
    np.save(path, np.stack(positions, axis=-1)[None])


def py3dic(path):
    """Ten columns of six points, in two images."""
    lines = ["0\t5\t6\t3", "0\t9\t10\t3"]
    lines += [f"{k}.png\t" + "\t".join(f"{x + k},{y}" for x in range(6) for y in range(10)) for k in range(2)]
    path.write_text("\n".join(lines))


def stage_text(header, cells, line_end=""):
    """The text of a stage; cells : (number, place, displacement) -> the cells of a row"""
    return "\n".join([header, *(",".join(map(str, cells(i, *at))) + line_end
                                for i, at in enumerate(zip(GRID, displaced(1), strict=True)))])


STAGES = {
    "pyvale.csv": stage_text('"subset_x","subset_y","disp_u","disp_v","converged","cost_zncc",',
                             lambda i, x, u: (*x, *u, 1, 0.99)),
    "al_dic.csv": stage_text("node_id,x_px,y_px,disp_u,disp_v", lambda i, x, u: (i, *x, *u)),
    "matchid_2d.csv": stage_text("Coordinates.Image X [Pixel],Coordinates.Image Y [Pixel],"
                                 "disp.Horizontal Displacement U [Pixel],disp.Vertical Displacement V [Pixel]",
                                 lambda i, x, u: (*x, *u)),
    "aramis.csv": stage_text("# Units: length:mm time:s\n# Stage: 1\nstage;index;relative_time;date\n1;1;1;now\n"
                             "# Name : Surface\nid;x;y;z;displacement_x;displacement_y;displacement_z",
                             lambda i, x, u: (";".join(map(str, (i, *(x + u), 0, *u, 0))),)),
}


class TestFields(ReaderContract):
    files = {name: lambda path, text=text: path.write_text(text) for name, text in STAGES.items()} | {
             "stage.vtu": vtu, "run.mat": ncorr_file, "run_73.mat": ncorr_hdf5, "fields.npy": mudic,
             "result.dic": py3dic,
             "table.csv": lambda path: path.write_text("x_mm,y_mm,u_mm,v_mm\n" + "\n".join(
                 f"{x},{y},{u},{v}" for (x, y), (u, v) in zip(GRID, displaced(1), strict=True)))}

    def read(self, path):
        return FieldSeries.open([path], unit="mm" if path.suffix == ".vtu" else None, pixel_size_mm=0.05)


pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")
