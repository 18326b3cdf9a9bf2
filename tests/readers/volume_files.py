"""One scan written in every format of volumes: name of a file or folder -> (writer, states the size of a voxel)."""

from __future__ import annotations

import h5py
import nrrd
import numpy as np
import tifffile
import zarr
from PIL import Image

VOXELS = np.random.default_rng(1).integers(0, 60_000, (7, 20, 30)).astype(np.uint16)  # z, y, x
SIDES_MM = (0.008, 0.006, 0.005)
UM = {"z": 8.0, "y": 6.0, "x": 5.0}
MHD = ("ObjectType = Image\nNDims = 3\nDimSize = 30 20 7\nElementType = MET_USHORT\n"
       "ElementSpacing = 0.005 0.006 0.008\nElementDataFile = voxels.raw\n")
VGI = ("{volume1}\n[representation]\nsize = 30 20 7\ndatatype = float\nbitsperelement = 32\n[file1]\nSkipHeader = 16\n"
       "FileFormat = raw\nSize = 30 20 7\nName = ./scan.vol\nDatatype = unsigned integer\nBitsPerElement = 16\n"
       "{volumeprimitive12}\n[geometry]\nresolution = 5 6 8\nunit = um\n")


def imagej(path, **options):
    tifffile.imwrite(path, VOXELS, imagej=True, resolution=(1 / 5, 1 / 6),
                     metadata={"spacing": 8.0, "unit": "micron", "axes": "ZYX"}, **options)


def ome(path, **options):
    sizes = {f"PhysicalSize{axis.upper()}": 1e-3 * um for axis, um in UM.items()}
    units = {f"PhysicalSize{axis}Unit": "mm" for axis in "XYZ"}
    tifffile.imwrite(path, VOXELS, metadata={"axes": "ZYX", **sizes, **units}, **options)


def imagej_of_one_page(path):
    """As ImageJ writes stacks above 4 GB: one page, the planes behind it."""
    tifffile.imwrite(path, VOXELS[0], resolution=(1 / 5, 1 / 6), byteorder=">",
                     description=f"ImageJ=1.53t\nimages={len(VOXELS)}\nslices={len(VOXELS)}\nunit=micron\nspacing=8.0\n",
                     metadata=None)
    with tifffile.TiffFile(path) as tiff:
        page = tiff.pages[0]
        start, order = page.dataoffsets[0], tiff.byteorder
    content = path.read_bytes()
    assert start + page.nbytes == len(content)  # the page is the last thing in the file
    path.write_bytes(content + VOXELS[1:].astype(order + "u2").tobytes())


def slices(path):
    path.mkdir()
    for k, plane in enumerate(VOXELS):
        Image.fromarray(plane).save(path / f"slice_{k + 3:04d}.png")


def vgi(path):
    path.with_suffix(".vol").write_bytes(bytes(16) + VOXELS.astype("<u2").tobytes())
    path.write_text(VGI)


def mhd(path):
    (path.parent / "voxels.raw").write_bytes(VOXELS.astype(">u2").tobytes())
    path.write_text("BinaryDataByteOrderMSB = True\n" + MHD)


def nrrd_in_another_order(path):
    """Fastest axis z, slowest x."""
    directions = np.array([[0, 0, 0.008], [0, 0.006, 0], [0.005, 0, 0]])
    nrrd.write(str(path), VOXELS, {"encoding": "raw", "space": "left-posterior-superior",
                                   "space directions": directions, "endian": "big"})


def detached_nrrd(path):
    nrrd.write(str(path), VOXELS.T, {"encoding": "raw", "spacings": [5.0, 6.0, 8.0], "units": ["um"] * 3})


def zarr_array(version, **options):
    def write(path):
        array = zarr.create_array(str(path), shape=VOXELS.shape, dtype=VOXELS.dtype, zarr_format=version,
                                  **({"chunks": (3, 8, 16)} | options))
        array[:] = VOXELS
    return write


def ome_zarr(version):
    def write(path):
        group = zarr.open_group(str(path), mode="w", zarr_format=version)
        for level in (0, 1):
            values = VOXELS.transpose(0, 2, 1)[None, :, :: level + 1, :: level + 1]
            group.create_array(f"s{level}", shape=values.shape, chunks=(1, 4, 16, 8), dtype=values.dtype)[:] = values
        axes = [{"name": "c", "type": "channel"}] + [{"name": axis, "type": "space", "unit": "micrometer"}
                                                     for axis in "zxy"]
        scales = [{"path": f"s{level}", "coordinateTransformations":
                   [{"type": "scale", "scale": [1, 4.0, 2.5 * (level + 1), 3.0 * (level + 1)]}]} for level in (0, 1)]
        image = {"axes": axes, "datasets": scales,
                 "coordinateTransformations": [{"type": "scale", "scale": [1, 2.0, 2.0, 2.0]}]}
        if version == 2:
            group.attrs["multiscales"] = [image | {"version": "0.4"}]
        else:
            group.attrs["ome"] = {"version": "0.5", "multiscales": [image]}
    return write


def hdf5(**options):
    def write(path):
        with h5py.File(path, "w") as file:
            values = file.create_dataset("entry/data/data", data=VOXELS.astype(">u2"), **options)
            values.attrs["element_size_um"] = list(UM.values())
            file["entry/flat"] = np.ones((3, 3))
    return write


FILES = {  # name -> (writer, states the size of a voxel)
    "plain.tif": (lambda path: tifffile.imwrite(path, VOXELS), False),
    "printed.tif": (lambda path: tifffile.imwrite(path, VOXELS, resolution=(72, 72), resolutionunit=2), False),
    "big.tif": (lambda path: tifffile.imwrite(path, VOXELS, bigtiff=True, byteorder=">", metadata=None), False),
    "strips.tif": (lambda path: tifffile.imwrite(path, VOXELS, compression="zlib", predictor=True, rowsperstrip=7),
                   False),
    "imagej.tif": (imagej, True), "imagej_of_one_page.tif": (imagej_of_one_page, True),
    "volume.ome.tif": (ome, True), "tiles.ome.tif": (lambda path: ome(path, tile=(16, 16), compression="lzw"), True),
    "slices": (slices, False), "scan.vgi": (vgi, True), "scan.mhd": (mhd, True),
    "order.nrrd": (nrrd_in_another_order, True), "scan.nhdr": (detached_nrrd, True),
    "two.zarr": (zarr_array(2), False), "three.zarr": (zarr_array(3, shards=(6, 16, 32)), False),
    "ome2.zarr": (ome_zarr(2), True), "ome3.zarr": (ome_zarr(3), True),
    "scan.h5": (hdf5(), True), "chunks.h5": (hdf5(chunks=(2, 8, 8), compression="gzip", shuffle=True), True),
    "scan.npy": (lambda path: np.save(path, VOXELS), False),
    "columns.npy": (lambda path: np.save(path, np.asfortranarray(VOXELS)), False)}
