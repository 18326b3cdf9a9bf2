"""Frames of TIFF stacks: all images along one axis, none along two; missing members, planes and values are told."""

from __future__ import annotations

import numpy as np
import pytest
import tifffile
from PIL import Image

from idic.errors import InputError
from idic.readers import open_stack, read_image

STACK = np.random.default_rng(3).integers(0, 4096, (10, 32, 40)).astype(np.uint16)


def assert_frames(stack, images):
    assert stack.n_frames == len(images)
    assert len(set(stack.labels)) == stack.n_frames
    for k, image in enumerate(images):
        np.testing.assert_array_equal(stack.frame(k), image)


@pytest.mark.parametrize("kind", [{}, {"imagej": True}, {"imagej": True, "metadata": {"axes": "TYX"}},
                                  {"ome": True, "metadata": {"axes": "TYX"}}])
@pytest.mark.parametrize("truncate", [False, True])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_a_stack_along_one_axis_has_all_its_frames_with_one_page_or_many(tmp_path, kind, truncate, dtype):
    if truncate and "ome" in kind:
        pytest.skip("not written with one page")
    images = (STACK >> 4).astype(dtype)
    tifffile.imwrite(tmp_path / "a.tif", images, truncate=truncate, photometric="minisblack", **kind)
    with tifffile.TiffFile(tmp_path / "a.tif") as tiff:
        assert len(tiff.pages) == (1 if truncate else 10)
    stack = open_stack([tmp_path / "a.tif"])
    assert_frames(stack, images)
    axes = "T" if "metadata" in kind else "C" if kind else "Q"
    assert [note for note in stack.notes() if "10 channels (C)" in note] == stack.notes()
    assert len(stack.notes()) == (axes == "C")


def test_a_stack_with_one_page_that_is_cut_off_is_refused(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", STACK, imagej=True, truncate=True)
    content = (tmp_path / "a.tif").read_bytes()
    (tmp_path / "a.tif").write_bytes(content[:len(content) // 2])
    with pytest.raises(InputError, match="truncated"):
        open_stack([tmp_path / "a.tif"])


def test_one_image_with_the_header_of_its_stack_is_one_image_with_a_note(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", STACK, imagej=True)
    with tifffile.TiffFile(tmp_path / "a.tif") as tiff:
        description = tiff.pages[0].description
    tifffile.imwrite(tmp_path / "b.tif", STACK[3], description=description, metadata=None, byteorder=">")
    stack = open_stack([tmp_path / "b.tif"])
    assert_frames(stack, STACK[3:4])
    assert stack.notes() == ["b.tif: 1 of the 10 images that its header states"]


@pytest.mark.parametrize("kind", [{"imagej": True}, {"ome": True}, {}])
@pytest.mark.parametrize("axes, words", [("TZYX", "5 times (T) x 2 planes (Z)"),
                                         ("TCYX", "5 times (T) x 2 channels (C)"),
                                         ("ZCYX", "5 planes (Z) x 2 channels (C)")])
def test_a_stack_along_two_axes_is_refused_with_the_axes(tmp_path, kind, axes, words):
    tifffile.imwrite(tmp_path / "a.tif", STACK.reshape(5, 2, 32, 40), photometric="minisblack",
                     metadata={"axes": axes}, **kind)
    with pytest.raises(InputError, match="no frames of one camera") as problem:
        open_stack([tmp_path / "a.tif"])
    assert problem.value.found == words and "one plane and channel" in problem.value.remedy


def test_an_array_of_two_leading_axes_is_refused(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", STACK.reshape(5, 2, 32, 40), photometric="minisblack")
    with pytest.raises(InputError, match="no frames of one camera") as problem:
        open_stack([tmp_path / "a.tif"])
    assert problem.value.found == "5 images (Q) x 2 images (Q)"


def test_stacks_that_were_appended_are_frames_one_after_the_other(tmp_path):
    for k in range(0, 10, 5):
        tifffile.imwrite(tmp_path / "a.tif", STACK[k:k + 5], append=bool(k), photometric="minisblack")
    assert_frames(open_stack([tmp_path / "a.tif"]), STACK)


def test_colours_of_a_composite_are_no_frames(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", STACK[:3], imagej=True, metadata={"axes": "CYX", "mode": "composite"})
    with pytest.raises(InputError, match="no frames of one camera"):
        open_stack([tmp_path / "a.tif"])


def test_planes_taken_for_times_are_told(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", STACK, imagej=True, metadata={"axes": "ZYX"})
    assert open_stack([tmp_path / "a.tif"]).notes() == [
        "a.tif: 10 planes (Z) by the header, taken as frames that follow each other in time"]


def write_ome_series(folder, axes="T"):
    """Three files with a plane each, as microscopes write them."""
    names = [f"s_{k}.ome.tif" for k in range(3)]
    identities = [f"urn:uuid:00000000-0000-0000-0000-00000000000{k}" for k in range(3)]
    planes = "".join(f'<TiffData First{axes}="{k}" IFD="0" PlaneCount="1"><UUID FileName="{name}">{identity}</UUID>'
                     "</TiffData>" for k, (name, identity) in enumerate(zip(names, identities, strict=True)))
    sizes = " ".join(f'Size{axis}="{3 if axis == axes else 1}"' for axis in "ZCT")
    for k, name in enumerate(names):
        header = (f'<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06" '
                  f'UUID="{identities[k]}"><Image ID="Image:0"><Pixels ID="Pixels:0" DimensionOrder="XYZCT" '
                  f'Type="uint16" SizeX="40" SizeY="32" {sizes}>{planes}</Pixels></Image></OME>')
        tifffile.imwrite(folder / name, STACK[k], description=header, metadata=None)
    return [folder / name for name in names]


def test_the_files_of_an_ome_series_are_a_frame_each(tmp_path):
    stack = open_stack(write_ome_series(tmp_path))
    assert_frames(stack, STACK[:3])
    assert not stack.notes()


def test_files_of_planes_get_one_note(tmp_path):
    notes = open_stack(write_ome_series(tmp_path, "Z")).notes()
    assert len(notes) == 1 and notes[0].startswith("s_0.ome.tif and 2 more: 3 planes (Z)")


@pytest.mark.parametrize("member", [0, 1, 2])
def test_an_ome_series_without_one_of_its_files_is_refused(tmp_path, member):
    paths = write_ome_series(tmp_path)
    paths.pop(member).unlink()
    with pytest.raises(InputError, match="OME series is missing") as problem:
        open_stack(paths)
    assert f"s_{member}.ome.tif" in problem.value.found


def test_an_ome_file_may_have_a_new_name(tmp_path):
    tifffile.imwrite(tmp_path / "a.ome.tif", STACK, ome=True, metadata={"axes": "TYX"})
    (tmp_path / "a.ome.tif").rename(tmp_path / "b.tif")
    assert_frames(open_stack([tmp_path / "b.tif"]), STACK)


def test_pages_of_detectors_are_refused_and_named_pages_told(tmp_path):
    with tifffile.TiffWriter(tmp_path / "sem.tif") as file:
        for image in STACK[:2]:
            file.write(image, metadata=None, extratags=[(34682, "s", 0, "[Scan]\r\nPixelWidth=1e-9\r\n", True)])
    with pytest.raises(InputError, match="no frames of one camera") as problem:
        open_stack([tmp_path / "sem.tif"])
    assert "detectors" in problem.value.found
    with tifffile.TiffWriter(tmp_path / "named.tif") as file:
        for image, name in zip(STACK[:2], ("SE2", "InLens"), strict=True):
            file.write(image, metadata=None, extratags=[(285, "s", 0, name, True)])
    stack = open_stack([tmp_path / "named.tif"])
    assert_frames(stack, STACK[:2])
    assert "SE2, InLens" in stack.notes()[0]


def test_pages_of_different_kinds_are_refused(tmp_path):
    with tifffile.TiffWriter(tmp_path / "a.tif") as file:
        file.write(STACK[0], metadata=None)
        file.write(np.repeat(STACK[1][..., None], 3, axis=-1), photometric="rgb", metadata=None)
    with pytest.raises(InputError, match="no frames of one camera") as problem:
        open_stack([tmp_path / "a.tif"])
    assert "page 1 rgb" in problem.value.found


@pytest.mark.parametrize("nodata, dtype", [("-9999", np.float32), ("-3.4028234663852886e+38", np.float32),
                                           ("-9999", np.float64), ("0", np.uint16)])
def test_heights_with_the_value_for_none_are_missing(tmp_path, nodata, dtype):
    heights = np.linspace(1, 5, 32 * 40).reshape(32, 40).astype(dtype)
    heights[3, 4:7] = dtype(float(nodata))
    tifffile.imwrite(tmp_path / "a.tif", heights, extratags=[(42113, "s", 0, nodata, True)])
    stack = open_stack([tmp_path / "a.tif"], with_gaps=True)
    image = stack.frame(0)
    assert image.dtype == np.float32 and np.isnan(image[3, 4:7]).all() and np.isnan(image).sum() == 3
    np.testing.assert_array_equal(image[np.isfinite(image)], heights.astype(np.float32)[np.isfinite(image)])
    with pytest.raises(InputError, match="without a value"):
        open_stack([tmp_path / "a.tif"]).frame(0)


def test_a_nodata_value_that_the_pixels_cannot_have_changes_nothing(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", STACK[0], extratags=[(42113, "s", 0, "-9999", True)])
    stack = open_stack([tmp_path / "a.tif"])
    assert stack.frame(0).dtype == np.uint16
    assert_frames(stack, STACK[:1])


def with_overlay(n_pixels):
    """Indices up to 229 with some pixels of an overlay, and the palette of a scanning electron microscope."""
    indices = (STACK[0] % 230).astype(np.uint8)
    indices.flat[:n_pixels] = 240
    palette = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)
    palette[230:] = (250, 20, 20)
    return indices, palette


@pytest.mark.parametrize("suffix", [".tif", ".png", ".bmp"])
def test_a_grey_palette_with_overlay_colours_has_its_indices_as_grey_values(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"

    def write(indices, palette):
        if suffix == ".tif":
            tifffile.imwrite(path, indices, photometric="palette", colormap=palette.T.astype(np.uint16) * 257)
        else:
            image = Image.fromarray(indices, "P")
            image.putpalette(palette.tobytes())
            image.save(path)

    indices, palette = with_overlay(12)
    write(indices, palette)
    stack = open_stack([path])
    np.testing.assert_array_equal(stack.frame(0), indices)
    assert len(stack.notes()) == 1 and "overlay" in stack.notes()[0]
    write(*with_overlay(0))
    assert not open_stack([path]).notes()
    write(*with_overlay(300))  # a quarter of the picture
    with pytest.raises(InputError, match="a colour image"):
        open_stack([path])


def test_a_palette_of_bytes_is_not_black(tmp_path):
    indices = (STACK[0] % 256).astype(np.uint8)
    tifffile.imwrite(tmp_path / "a.tif", indices, photometric="palette",
                     colormap=np.tile(np.arange(256, dtype=np.uint16), (3, 1)))
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif"), indices)
