"""Scans of volumes in every format: blocks come back value by value, voxel sizes in mm; bad files are refused."""

from __future__ import annotations

import json
import pickle
import tracemalloc

import h5py
import numpy as np
import pytest
import tifffile
import zarr
from PIL import Image

from idic.errors import InputError
from idic.readers import VolumeEntry, volume_entries
from readers.volume_files import FILES, MHD, SIDES_MM, VOXELS, imagej, mhd, slices, zarr_array

ALL = slice(None)


@pytest.mark.parametrize("name", FILES)
def test_blocks_come_back_value_by_value_with_the_size_of_a_voxel_in_mm(name, tmp_path):
    write, has_size = FILES[name]
    write(tmp_path / name)
    entry: VolumeEntry
    entry, = pickle.loads(pickle.dumps(volume_entries(tmp_path, name)))  # as it goes to a worker
    assert entry.shape == VOXELS.shape and entry.dtype == VOXELS.dtype and entry.name.startswith(name)
    assert entry.voxel_mm == (pytest.approx(SIDES_MM, rel=1e-9) if has_size else None)
    block = entry.block(slice(1, 6), slice(3, 17), slice(4, 29))
    assert block.dtype.isnative and np.array_equal(block, VOXELS[1:6, 3:17, 4:29])
    assert np.array_equal(entry.block(ALL, ALL, ALL), VOXELS)
    assert entry.block(slice(5, 99), slice(-3, None), slice(4, 4)).shape == (2, 3, 0)


@pytest.mark.parametrize("dtype", ["uint8", "int16", "float32", "float64"])
def test_depths_are_kept(dtype, tmp_path):
    values = (VOXELS // 256).astype(dtype)
    tifffile.imwrite(tmp_path / "a.tif", values)
    block = volume_entries(tmp_path, "a.tif")[0].block(ALL, ALL, slice(1, 4))
    assert block.dtype == dtype and np.array_equal(block, values[..., 1:4])


def test_every_match_is_a_scan_in_natural_order_and_the_reference_is_first(tmp_path):
    for name in ("scan_10.tif", "scan_2.tif", "scan_ref.tif", ".hidden.tif"):
        tifffile.imwrite(tmp_path / name, VOXELS)
    assert [entry.name for entry in volume_entries(tmp_path, "scan*.tif")] == ["scan_ref.tif", "scan_2.tif",
                                                                              "scan_10.tif"]
    assert len(volume_entries(tmp_path, ["scan_2.tif", "scan_10.tif"])) == 2


def test_folders_of_slices_are_scans(tmp_path):
    for name in ("scan 1", "scan 2"):
        slices(tmp_path / name)
    assert [entry.name for entry in volume_entries(tmp_path, "scan*")] == ["scan 1", "scan 2"]


def test_an_axis_of_time_gives_scans_with_their_times(tmp_path):
    stack = np.stack([VOXELS, VOXELS + 1])
    tifffile.imwrite(tmp_path / "t.tif", stack, imagej=True, metadata={"axes": "TZYX", "finterval": 30.0})
    group = zarr.open_group(str(tmp_path / "t.zarr"), mode="w", zarr_format=2)
    group.create_array("0", shape=stack.shape, chunks=(1, 4, 8, 8), dtype=stack.dtype)[:] = stack
    axes = [{"name": "t", "type": "time", "unit": "minute"}] + [{"name": axis, "type": "space"} for axis in "zyx"]
    group.attrs["multiscales"] = [{"axes": axes, "datasets": [
        {"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [0.5, 1, 1, 1]}]}]}]
    for name in ("t.tif", "t.zarr"):
        entries = volume_entries(tmp_path, name)
        assert [entry.time_s for entry in entries] == [0.0, 30.0]
        assert all(np.array_equal(entry.block(ALL, ALL, ALL), volume)
                   for entry, volume in zip(entries, stack, strict=True))


def test_a_block_of_a_large_scan_takes_no_more_memory_than_it_needs(tmp_path):
    shape = (160, 200, 300)  # 19 MB
    np.lib.format.open_memmap(tmp_path / "large.npy", "w+", np.uint16, shape)[80, 50, 60] = 7
    entry, = volume_entries(tmp_path, "large.npy")
    tracemalloc.start()
    block = entry.block(slice(70, 90), slice(40, 60), slice(50, 70))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert block[10, 10, 10] == 7 and block.sum() == 7
    assert peak < 2**20  # the block, and rows of one plane


def test_chunks_that_were_decoded_are_kept_for_the_next_block(tmp_path, monkeypatch):
    tifffile.imwrite(tmp_path / "a.tif", VOXELS, compression="zlib")
    entry, = volume_entries(tmp_path, "a.tif")
    first = entry.block(slice(0, 4), ALL, ALL)
    (tmp_path / "a.tif").rename(tmp_path / "b.tif")
    assert np.array_equal(entry.block(slice(0, 4), slice(3, 5), ALL), first[:, 3:5])


def refusal(folder, pattern):
    with pytest.raises(InputError) as error:
        for entry in volume_entries(folder, pattern, file=folder / "experiment.toml"):
            entry.block(ALL, ALL, ALL)
    assert error.value.expected and error.value.found and error.value.remedy
    return str(error.value)


def saved(path, values, **options):
    tifffile.imwrite(path, values, **options)


@pytest.mark.parametrize("words, write", [
    ("not a volume", lambda d: saved(d / "a.tif", VOXELS[0])),
    ("3 (S)", lambda d: saved(d / "a.tif", np.stack([VOXELS] * 3, -1).astype(np.uint8), photometric="rgb")),
    ("2 (C)", lambda d: saved(d / "a.tif", np.stack([VOXELS[:, 0]] * 2).transpose(1, 0, 2)[:, :, None].repeat(4, 2),
                              imagej=True, metadata={"axes": "ZCYX"})),
    ("frames)", lambda d: saved(d / "a.tif", VOXELS, imagej=True, metadata={"axes": "TYX"})),
    ("unit that idic does not know", lambda d: saved(d / "a.tif", VOXELS, imagej=True, resolution=(1, 1),
                                                     metadata={"axes": "ZYX", "unit": "furlong"})),
    ("differ in size", lambda d: (saved(d / "a.tif", VOXELS), saved(d / "b.tif", VOXELS[:-1]))),
    ("differ in depth", lambda d: (saved(d / "a.tif", VOXELS), saved(d / "b.tif", VOXELS.astype(np.uint8)))),
    ("differ in the size of a voxel", lambda d: (saved(d / "a.tif", VOXELS), imagej(d / "b.tif"))),
    ("grey values that idic does not read", lambda d: np.save(d / "a.npy", VOXELS > 3)),
    ("4 axes", lambda d: np.save(d / "a.npy", VOXELS[None])),
    ("object", lambda d: np.save(d / "a.npy", np.array([[[{}]]]), allow_pickle=True)),
    ("no header", lambda d: (d / "a.raw").write_bytes(VOXELS.tobytes())),
    ("not a format of volumes", lambda d: (d / "a.dcm").write_bytes(VOXELS.tobytes()))])
def test_what_is_no_volume_is_refused(words, write, tmp_path):
    write(tmp_path)
    assert words in refusal(tmp_path, "*")


@pytest.mark.parametrize("change, words", [
    (("voxels.raw", "missing.raw"), "missing"), (("voxels.raw", "../voxels.raw"), "another folder"),
    (("voxels.raw", "/etc/hosts"), "another folder"), (("voxels.raw", "slice%03d.raw 1 7 1"), "many files"),
    (("30 20 7", "30 20 8"), "truncated"), (("30 20 7", "30 20"), "not complete"),
    (("NDims", "CompressedData = True\nNDims"), "without compression"),
    (("NDims", "TransformMatrix = 0.8 0.6 0 -0.6 0.8 0 0 0 1\nNDims"), "turns or mirrors"),
    (("NDims", "TransformMatrix = -1 0 0 0 1 0 0 0 1\nNDims"), "turns or mirrors"),
    (("0.008", "0"), "size that cannot be"), (("MET_USHORT", "MET_USHORT_ARRAY"), "not complete")])
def test_a_bad_header_of_raw_voxels_is_refused(change, words, tmp_path):
    mhd(tmp_path / "scan.mhd")
    (tmp_path / "scan.mhd").write_text(MHD.replace(*change))
    assert words in refusal(tmp_path, "scan.mhd")


def test_axes_that_a_header_permutes_are_put_in_order(tmp_path):
    mhd(tmp_path / "scan.mhd")
    (tmp_path / "scan.mhd").write_text("TransformMatrix = 0 0 1 1 0 0 0 1 0\nBinaryDataByteOrderMSB = True\n" + MHD)
    entry, = volume_entries(tmp_path, "scan.mhd")  # the fastest axis is z, then x, then y
    assert entry.shape == (30, 7, 20) and entry.voxel_mm == (0.005, 0.008, 0.006)
    assert np.array_equal(entry.block(ALL, ALL, ALL), VOXELS.transpose(2, 0, 1))


def test_missing_and_odd_slices_are_refused(tmp_path):
    slices(tmp_path / "a")
    (tmp_path / "a" / "slice_0005.png").unlink()
    assert "slice_0006.png after slice_0004.png" in refusal(tmp_path, "a")
    Image.fromarray(VOXELS[0, :10]).save(tmp_path / "a" / "slice_0005.png")
    assert "differ in size" in refusal(tmp_path, "a")
    (tmp_path / "b").mkdir()
    for k in range(3):
        tifffile.imwrite(tmp_path / "b" / f"{k}.tif", VOXELS)
    assert "several pages" in refusal(tmp_path, "b")


def test_a_file_that_shrinks_while_it_is_open_is_refused(tmp_path):
    np.save(tmp_path / "a.npy", VOXELS)
    entry, = volume_entries(tmp_path, "a.npy")
    content = (tmp_path / "a.npy").read_bytes()
    (tmp_path / "a.npy").write_bytes(content[:-500])
    with pytest.raises(InputError, match="truncated"):
        entry.block(ALL, ALL, ALL)


# nothing that a file names is followed or run -----------------------------------------------------------
def test_links_out_of_an_hdf5_file_are_not_followed(tmp_path):
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["data"] = VOXELS
    VOXELS.tofile(tmp_path / "secret.bin")
    layout = h5py.VirtualLayout(VOXELS.shape, VOXELS.dtype)
    layout[:] = h5py.VirtualSource(str(tmp_path / "secret.h5"), "data", VOXELS.shape)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["link"] = h5py.ExternalLink("secret.h5", "/data")
        file["soft"] = h5py.SoftLink("/link")
        file["loop"] = h5py.SoftLink("/loop")
        file.create_virtual_dataset("virtual", layout)
        file.create_dataset("raw", VOXELS.shape, VOXELS.dtype,
                            external=[(str(tmp_path / "secret.bin"), 0, VOXELS.nbytes)])
        file["real"] = VOXELS
        file["to_real"] = h5py.SoftLink("real")
    for name, words in (("link", "link into secret.h5"), ("soft", "link into secret.h5"), ("virtual", "put together"),
                        ("raw", "lies in"), ("loop", "lead to each other"), ("no", "no such dataset")):
        assert words in refusal(tmp_path, f"a.h5::{name}")
    assert "3 with three axes" in refusal(tmp_path, "a.h5")
    entry, = volume_entries(tmp_path, "a.h5::to_real")
    assert np.array_equal(entry.block(ALL, ALL, ALL), VOXELS)


@pytest.mark.parametrize("version", [2, 3])
def test_a_codec_that_runs_code_is_refused(version, tmp_path):
    zarr_array(version)(tmp_path / "a.zarr")
    path = tmp_path / "a.zarr" / (".zarray" if version == 2 else "zarr.json")
    metadata = json.loads(path.read_text())
    if version == 2:
        metadata["filters"] = [{"id": "pickle", "protocol": 5}]
    else:
        metadata["codecs"].insert(0, {"name": "numcodecs.pickle", "configuration": {}})
    path.write_text(json.dumps(metadata))
    assert "pickle" in refusal(tmp_path, "a.zarr")


def test_a_group_with_several_arrays_needs_a_name(tmp_path):
    group = zarr.open_group(str(tmp_path / "a.zarr"), mode="w")
    for name in ("absorption", "phase"):
        group.create_array(name, shape=VOXELS.shape, chunks=(4, 8, 8), dtype=VOXELS.dtype)[:] = VOXELS
    assert "2 arrays" in refusal(tmp_path, "a.zarr") and "no 'dark'" in refusal(tmp_path, "a.zarr::dark")
    assert volume_entries(tmp_path, "a.zarr::phase")[0].shape == VOXELS.shape


def test_a_pattern_that_matches_nothing_says_what_is_there(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", VOXELS)
    assert "a.tif" in refusal(tmp_path, "*.mhd") and "leaves the experiment folder" in refusal(tmp_path, "../*.tif")
