"""Reads image files: TIFF (also multi-page), PNG, XYZ grid, video, film or height map of an instrument; 8 or 16 bit
grey, 32-bit float; frame by frame."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import tifffile
from PIL import Image

from idic.errors import InputError
from idic.remote_files import fetch, image_facts
from idic.readers.delimited.xyz_grid import XYZ_SUFFIXES, XyzGrid, check_alike, read_xyz_heights, xyz_grid
from idic.readers.frames.file_orders import orders_of_files
from idic.readers.frames.written_times import exif_time, tiff_time
from idic.readers.image_formats.orientation import (
    TAG, UPRIGHT, orientation_note, orientation_of, upright, upright_shape,
)
from idic.readers.image_formats.palettes import OVERLAY_NOTE, grey_of_palette
from idic.readers.image_formats.electron_microscopes import Micrograph, micrograph
from idic.readers.image_formats.electron_microscopes import FORMAT as SEM
from idic.readers.image_formats.tiff_axes import stack_notes, stated_images
from idic.readers.paths import called_the_reference, reading_of_names
from idic.readers.formats.format import HEIGHTS, IMAGES, Format
from idic.readers.instruments.film import Film
from idic.readers.instruments.phantom import FORMAT as PHANTOM
from idic.readers.instruments.phantom import phantom_film, read_phantom
from idic.readers.instruments.photron import FORMAT as PHOTRON
from idic.readers.instruments.photron import photron_film, read_photron
from idic.readers.instruments.profilometers import FORMAT as PROFILOMETERS
from idic.readers.instruments.profilometers import height_grid, read_heights
from idic.readers.video import SUFFIXES as VIDEO_SUFFIXES
from idic.readers.video import read_video_frame, video_headers, video_notes

TIFF_SUFFIXES, PNG_SUFFIXES = (".tif", ".tiff"), (".png", ".bmp")
PICTURE_SUFFIXES = TIFF_SUFFIXES + PNG_SUFFIXES  # of images that may be photographs
_PILLOW_FORMATS = ("PNG", "BMP")  # Pillow detects the format by the content and passes some formats to other programs
_NODATA = 42113
_EXPECTED = "grey TIFF or PNG images, 8 or 16 bit, 32-bit float TIFF, XYZ grids of heights, or a video"
logging.getLogger("tifffile").setLevel(logging.CRITICAL + 1)  # damaged files get one message, that of idic
_COLOUR = "convert them to grey (one channel of the raw data; not a JPEG)"


@dataclass(frozen=True)
class ImageEntry:
    """The place of one frame: a page of a file, or a plane behind the one page of a stack.

    grid : pitch and units, of formats that state them; note : on the effect of the format on the measurement, ""
    without; written_s : when the header says that it was taken; time_s : the same by the clock of a device, from any
    start; None unknown; bar_rows : of a data bar at the lower edge, which are left out
    """

    path: Path
    page: int
    shape: tuple[int, int]
    dtype: str
    label: str
    orientation: int = UPRIGHT
    grid: XyzGrid | None = None
    note: str = ""
    written_s: float | None = None
    time_s: float | None = None
    bar_rows: int = 0


class FileStack:
    """Frames in files, read on demand; `frame` may be called from several threads.

    Parameters
    ----------
    entries : list of ImageEntry
        One per frame; all of one size (`open_stack` checks).
    with_gaps : bool
        Height images: pixels without a value (NaN) are allowed, the values come as float32.
    """

    def __init__(self, entries: list[ImageEntry], with_gaps: bool = False):
        self.entries = tuple(entries)
        self.with_gaps = with_gaps

    @property
    def n_frames(self) -> int:
        return len(self.entries)

    @property
    def shape(self) -> tuple[int, int]:
        return self.entries[0].shape

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple(entry.label for entry in self.entries)

    @property
    def grid(self) -> XyzGrid | None:
        """Pitch and units of the frames, of formats that state them."""
        return self.entries[0].grid

    def reading_of_names(self, folder: Path) -> str:
        """How file names are read that are not in the order of their digits, in words; "" elsewhere."""
        return reading_of_names([entry.path for entry in self.entries], folder)

    def orders(self, frames: Sequence[int]) -> dict[str, list[int]]:
        """The orders that names, headers and times of the files propose, as places in `frames`; none of frames that
        share a file."""
        paths = [self.entries[k].path for k in frames]
        named = [called_the_reference(path.stem) for path in paths]
        return orders_of_files(paths, [self.entries[k].written_s for k in frames], int(named[0] and sum(named) == 1))

    @property
    def times_s(self) -> np.ndarray | None:
        """Times of the frames from the first on, where the files state one later than the other  # (n_frames,) s"""
        if any(entry.time_s is None for entry in self.entries):
            return None
        times = np.array([entry.time_s for entry in self.entries])
        return times - times[0] if (np.diff(times) > 0.0).all() else None

    def notes(self) -> list[str]:
        """Notes on effects of the file format on the measurement."""
        videos = dict.fromkeys(e.path for e in self.entries if e.path.suffix.lower() in VIDEO_SUFFIXES)
        turned = orientation_note([(entry.label, entry.orientation) for entry in self.entries])
        files: dict[str, dict[str, None]] = {}
        for entry in self.entries:
            if entry.note:
                files.setdefault(entry.note, {})[entry.path.name] = None
        formats = [f"{next(iter(names))}{f' and {len(names) - 1} more' if len(names) > 1 else ''}: {note}"
                   for note, names in files.items()]
        return turned + formats + [note for path in videos for note in video_notes(path)]

    def frame(self, k: int) -> np.ndarray:
        """Frame `k`: uint8, uint16 or float32  # (ny, nx)"""
        if not 0 <= k < self.n_frames:
            raise IndexError(f"frame {k} of a stack of {self.n_frames}")
        entry = self.entries[k]
        image = _read_page(entry, self.with_gaps)
        if image.shape != self.shape:
            raise InputError("the image changed its size since it was opened", file=entry.path,
                             expected=f"{self.shape}", found=f"{image.shape}",
                             remedy="do not change the images while idic runs; start the command again")
        if self.with_gaps:
            image = np.where(np.isfinite(image), image, np.nan).astype(np.float32)
        return np.ascontiguousarray(image)


def open_stack(paths: list[Path], *, file=None, key: str = "images", with_gaps: bool = False) -> FileStack:
    """The stack of these files after a check of the headers: size, depth, colour, completeness. Pixels are read of
    formats without a header only (videos, XYZ grids).

    Raises
    ------
    InputError
        A file is not an image, is truncated or in colour, or differs from the first in size, depth, pitch or unit.
    """
    entries = [entry for path in paths for entry in image_entries(path)]
    if not entries:
        raise InputError("no image in the files", file=file, key=key, expected=_EXPECTED, found="none",
                         remedy="check that the files hold images")
    first = entries[0]
    for entry in entries[1:]:
        if entry.shape != first.shape:
            raise InputError("the images differ in size", file=entry.path, key=key,
                             expected=f"{_size(first)}, as {first.label}",
                             found=_size(entry),
                             remedy="crop all images alike, or remove this file from the pattern")
        if entry.dtype != first.dtype:
            raise InputError("the images differ in depth", file=entry.path, key=key,
                             expected=f"{first.dtype}, as {first.label}",
                             found=entry.dtype, remedy="store all images with one depth")
        check_alike(entry.grid, first.grid, entry.path, key, first.label)
    return FileStack(entries, with_gaps)


def read_image(path: Path) -> np.ndarray:
    """One grey image, e.g. a mask  # (ny, nx)"""
    return _read_page(image_entries(path)[0])


def image_entries(path: Path) -> list[ImageEntry]:
    """The frames of a file, by its header, or as the driver has read them."""
    facts = image_facts(path)
    if facts is None:
        return _headers(path)
    return [ImageEntry(path, page, tuple(shape), dtype, label, turn)
            for page, shape, dtype, label, turn in facts.entries]


def _size(entry: ImageEntry) -> str:
    return f"{entry.shape[1]} x {entry.shape[0]} px"


def _headers(path: Path) -> list[ImageEntry]:
    suffix = path.suffix.lower()
    if not path.is_file():  # a pipe has no end
        raise InputError("not a file", file=path, key="images", expected="an image, or a link to one",
                         found="a folder, a pipe or a device" if path.exists() else "nothing there",
                         remedy="name the images only, or correct the path")
    if suffix in TIFF_SUFFIXES:
        return _tiff_headers(path)
    if suffix in PNG_SUFFIXES:
        return [_png_header(path)]
    if suffix in XYZ_SUFFIXES:
        grid = xyz_grid(path)
        return [ImageEntry(path, 0, grid.shape, "float32", path.name, grid=grid)]
    if suffix in VIDEO_SUFFIXES:
        count, shape = video_headers(path)
        return [ImageEntry(path, k, shape, "uint8", f"{path.name}[{k}]") for k in range(count)]
    if (film_of := _FILMS.get(suffix)) is not None:
        return _film_entries(path, film_of(path))
    if suffix in PROFILOMETERS.suffixes:
        grid, time_s = height_grid(path)
        return [ImageEntry(path, 0, grid.shape, "float32", path.name, grid=grid, time_s=time_s)]
    raise InputError("not an image format that idic reads", file=path, key="images", expected=_EXPECTED, found=suffix
                     or "no suffix",
                     remedy="save the images as TIFF or PNG (JPEG compression destroys the measured grey values)")


def _film_entries(path: Path, film: Film) -> list[ImageEntry]:
    return [ImageEntry(path, k, film.shape, film.dtype, f"{path.name}[{k}]", note=film.note, time_s=float(time))
            for k, time in enumerate(film.times_s)]


def _entry(path: Path, page: int, shape: tuple[int, int], dtype: str, label: str, tag: object, note: str,
           written_s: float | None, microscope: Micrograph | None) -> ImageEntry:
    """The entry of an image with this shape as stored and this orientation tag."""
    orientation, grid, bar_rows = orientation_of(tag), None, 0
    if microscope is not None and orientation == UPRIGHT:
        bar_rows, note = microscope.bar_rows, "; ".join(filter(None, (note, microscope.note)))
        shape = shape[0] - bar_rows, shape[1]
        grid = XyzGrid(shape, microscope.pixel_mm, "mm") if microscope.pixel_mm is not None else None
    return ImageEntry(path, page, upright_shape(shape, orientation), dtype, label, orientation, grid, note,
                      written_s=written_s, bar_rows=bar_rows)


# TIFF -------------------------------------------------------------------------------------------------
def _tiff_headers(path: Path) -> list[ImageEntry]:
    try:
        with tifffile.TiffFile(path) as tiff:
            count = len(tiff.pages)  # ends at a loop of pages in a damaged file; iteration does not
            numbered = [(k, page) for k, page in ((k, tiff.pages[k]) for k in range(count))
                        if not page.is_reduced and not page.is_mask]
            pages, entries = [page for _, page in numbered], []
            note = "; ".join(stack_notes(tiff, pages, path)) if pages else ""
            planes, leftover = _planes(tiff, pages, path)
            note = "; ".join(filter(None, (note, leftover)))
            for number, page in numbered:
                label = path.name if len(pages) == planes == 1 else f"{path.name}[{number}]"
                shape, kind, overlay = _tiff_kind(page, path)
                page_note = "; ".join(filter(None, (note, OVERLAY_NOTE if overlay else "")))
                microscope = micrograph(path, shape, partial(_grey, page), tiff)
                entries.append(_entry(path, number, shape, kind, label, page.tags.valueof(TAG), page_note,
                                      tiff_time(page), microscope))
            _complete(tiff, pages, path)
            return entries + [replace(entries[0], page=k, label=f"{path.name}[{k}]") for k in range(1, planes)]
    except InputError:
        raise
    except Exception as error:  # tifffile raises many types on damaged files
        raise _damaged(path, error) from error


def _planes(tiff: tifffile.TiffFile, pages: list[tifffile.TiffPage], path: Path) -> tuple[int, str]:
    """Number of images of a file with one page, and a note where it is less than its header says."""
    n_images = stated_images(tiff, path) if pages else 1
    if len(pages) >= n_images:
        return 1, ""
    page, size = pages[0], path.stat().st_size
    if len(pages) > 1 or not page.is_contiguous or size < page.dataoffsets[0] + 2 * page.nbytes:
        return 1, f"{len(pages)} of the {n_images} images that its header states"
    end = page.dataoffsets[0] + n_images * page.nbytes
    if size < end:
        raise _truncated(path, f"{end} bytes", f"{size} bytes")
    return n_images, ""


def _tiff_kind(page: tifffile.TiffPage, path: Path) -> tuple[tuple[int, int], str, int]:
    """Shape, depth, and number of pixels in the colour of an overlay."""
    overlay = 0
    if page.samplesperpixel > 1 and not _equal_channels(page.asarray(), path):
        raise _colour(path, f"{page.samplesperpixel} channels")
    if page.photometric == tifffile.PHOTOMETRIC.PALETTE and not (page.colormap[0] == page.colormap).all():
        grey = grey_of_palette(page.asarray(), _palette(page))
        if grey is None:
            raise _colour(path, "a colour palette")
        overlay = grey[1]
    dtype = page.dtype if _nodata(page) is None else np.dtype(np.float32)
    return (int(page.imagelength), int(page.imagewidth)), _depth(dtype, path), overlay


def _palette(page: tifffile.TiffPage) -> np.ndarray:
    """Red, green and blue of the entries  # (n, 3) uint8"""
    has_bytes = page.colormap.max() < 256  # against the rule, but written
    return (page.colormap if has_bytes else page.colormap >> 8).astype(np.uint8).T


def _complete(tiff: tifffile.TiffFile, pages, path: Path) -> None:
    size = path.stat().st_size
    for page in pages:
        end = max((o + n for o, n in zip(page.dataoffsets, page.databytecounts, strict=False)), default=0)
        if end == 0 or end > size:
            raise _truncated(path, f"{end or 'some'} bytes", f"{size} bytes")


def _truncated(path: Path, expectation: str, finding: str) -> InputError:
    return InputError("the image file is truncated", file=path, key="images", expected=expectation, found=finding,
                      remedy="copy the file again from its source, or leave it out")


def _stored(tiff: tifffile.TiffFile, number: int) -> tuple[tifffile.TiffPage, np.ndarray]:
    """A page, or the page of a stack that has only one and the plane with this number."""
    try:
        page = tiff.pages[number]
    except IndexError:
        page = tiff.pages[0]
        tiff.filehandle.seek(page.dataoffsets[0] + number * page.nbytes)
        count = int(np.prod(page.shape))
        plane = np.frombuffer(tiff.filehandle.read(page.nbytes), tiff.byteorder + page.dtype.char, count)
        return page, plane.astype(page.dtype).reshape(page.shape)
    return page, page.asarray()


def _read_tiff(entry: ImageEntry) -> np.ndarray:
    with tifffile.TiffFile(entry.path) as tiff:
        page, image = _stored(tiff, entry.page)
        return _grey(page, image)


def _grey(page: tifffile.TiffPage, stored_image: np.ndarray | None = None) -> np.ndarray:
    """The grey image of a page  # (ny, nx)"""
    image = page.asarray() if stored_image is None else stored_image
    if page.photometric == tifffile.PHOTOMETRIC.PALETTE:
        grey = grey_of_palette(image, _palette(page))
        if grey is None:
            raise _colour(Path(page.parent.filehandle.path), "a colour palette")
        return grey[0]
    image = _without_nodata(image, page)
    if page.photometric == tifffile.PHOTOMETRIC.MINISWHITE and image.dtype.kind == "u":
        image = np.iinfo(image.dtype).max - image
    if image.ndim == 3:
        image = image[0] if page.planarconfig == tifffile.PLANARCONFIG.SEPARATE else image[..., 0]
    return image


def _nodata(page: tifffile.TiffPage) -> np.generic | None:
    """The value that stands for none (tag of GDAL); None where the page states none that it can hold."""
    try:
        value = float(str(page.tags.valueof(_NODATA)).strip("\0 "))
        return page.dtype.type(value) if page.dtype.kind == "f" or value == int(value) >= 0 else None
    except (ValueError, OverflowError):
        return None


def _without_nodata(image: np.ndarray, page: tifffile.TiffPage) -> np.ndarray:
    """NaN where the file states that there is no value."""
    nodata = _nodata(page)
    if nodata is None:
        return image
    return np.where(image == nodata, np.nan, image).astype(np.float64 if image.dtype == np.float64 else np.float32)


# PNG --------------------------------------------------------------------------------------------------
def _png_header(path: Path) -> ImageEntry:
    try:
        with Image.open(path, formats=_PILLOW_FORMATS) as image:
            mode, size, tag, note = image.mode, image.size, image.getexif().get(TAG), ""
            written_s = exif_time(image.getexif())
            if mode in ("1", "L", "I;16", "I;16B", "I"):
                kind = "uint8" if mode in ("1", "L") else "uint16"
            elif mode == "P" and (grey := grey_of_palette(*_indexed(image))) is not None:
                kind, note = "uint8", OVERLAY_NOTE if grey[1] else ""
            elif mode in ("P", "RGB", "RGBA", "LA", "PA"):
                channels = _deep_channels(path) if _is_deep(path) else np.asarray(image.convert("RGB"))
                if not _equal_channels(channels, path):
                    raise _colour(path, f"mode {mode}")
                kind = str(channels.dtype)
            else:
                raise _colour(path, f"mode {mode}")
        if path.suffix.lower() == ".png" and b"IEND" not in _tail(path):
            raise InputError("the image file is truncated", file=path, key="images",
                             expected="a PNG that ends with IEND", found="no end mark",
                             remedy="copy the file again from its source, or leave it out")
    except InputError:
        raise
    except Exception as error:  # PIL raises many types on damaged files
        raise _damaged(path, error) from error
    microscope = micrograph(path, (size[1], size[0]), lambda: _read_png(path))
    return _entry(path, 0, (size[1], size[0]), kind, path.name, tag, note, written_s, microscope)


def _indexed(image: Image.Image) -> tuple[np.ndarray, np.ndarray]:
    """Indices and palette of an image in mode P  # (ny, nx) uint8, (n, 3) uint8"""
    indices = np.asarray(image)
    palette = np.array(image.getpalette("RGB"), np.uint8).reshape(-1, 3)
    missing = max(int(indices.max(initial=0)) + 1 - len(palette), 0)
    return indices, np.vstack([palette, np.zeros((missing, 3), np.uint8)])


def _is_deep(path: Path) -> bool:
    """Whether this is a PNG of 16 bits in several channels, of which Pillow keeps 8."""
    with path.open("rb") as stream:
        head = stream.read(26)
    return head.startswith(b"\x89PNG") and head[24:25] == b"\x10" and head[25:] in (b"\x02", b"\x04", b"\x06")


def _deep_channels(path: Path) -> np.ndarray:
    """The channels of such a PNG, or the grey one three times without its opacity  # (ny, nx, 3 | 4) uint16"""
    import imagecodecs  # here: cameras store grey images in one channel

    image = imagecodecs.png_decode(path.read_bytes())
    return image if image.shape[-1] > 2 else np.repeat(image[..., :1], 3, axis=-1)


def _tail(path: Path) -> bytes:
    with path.open("rb") as stream:
        stream.seek(max(path.stat().st_size - 64, 0))
        return stream.read()


def _read_png(path: Path) -> np.ndarray:
    with Image.open(path, formats=_PILLOW_FORMATS) as image:
        if image.mode == "P" and (grey := grey_of_palette(*_indexed(image))) is not None:
            return grey[0]
        if image.mode in ("P", "RGB", "RGBA", "LA", "PA"):
            if _is_deep(path):
                return _deep_channels(path)[..., 0]
            return np.asarray(image.convert("RGB"))[..., 0]
        pixels = np.asarray(image)
    return pixels.astype(np.uint8) * 255 if pixels.dtype == bool else pixels


# both -------------------------------------------------------------------------------------------------
def _read_page(entry: ImageEntry, with_gaps: bool = False) -> np.ndarray:
    fetch(entry.path)
    try:
        read = _READERS.get(entry.path.suffix.lower())
        image = upright(_read_png(entry.path) if read is None else read(entry), entry.orientation)
        image = image[:len(image) - entry.bar_rows]
    except InputError:
        raise
    except Exception as error:  # see above
        raise _damaged(entry.path, error) from error
    image = image.astype(entry.dtype, copy=False)
    if image.dtype.kind == "f" and not (np.isfinite(image).any() if with_gaps else np.isfinite(image).all()):
        bad = np.argwhere(~np.isfinite(image))
        raise InputError("the image has pixels without a value", file=entry.path, key="images",
                         expected="some finite values" if with_gaps else "finite values",
                         found=f"{len(bad)} pixels are not finite, the first at column {bad[0, 1]}, row {bad[0, 0]}",
                         remedy="exclude the frame" if with_gaps
                         else "replace them by the mean of their neighbours and exclude them with a mask")
    return image


def _read_xyz(entry: ImageEntry) -> np.ndarray:
    return read_xyz_heights(entry.path)


def _read_video(entry: ImageEntry) -> np.ndarray:
    return read_video_frame(entry.path, entry.page)


def _read_film(entry: ImageEntry) -> np.ndarray:
    read = read_photron if entry.path.suffix.lower() in PHOTRON.suffixes else read_phantom
    return read(entry.path, entry.page)


def _read_profilometer(entry: ImageEntry) -> np.ndarray:
    return read_heights(entry.path)


_FILMS = dict.fromkeys(PHOTRON.suffixes, photron_film) | dict.fromkeys(PHANTOM.suffixes, phantom_film)
_READERS = (dict.fromkeys(TIFF_SUFFIXES, _read_tiff) | dict.fromkeys(VIDEO_SUFFIXES, _read_video)
            | dict.fromkeys(XYZ_SUFFIXES, _read_xyz) | dict.fromkeys(_FILMS, _read_film)
            | dict.fromkeys(PROFILOMETERS.suffixes, _read_profilometer))
FORMATS = (
    Format(IMAGES, "TIFF", TIFF_SUFFIXES, "tifffile", "depth, axes of stacks, missing values, orientation",
           "pixel_size_mm", "made: depths, stacks, tags, damage"),
    Format(IMAGES, "PNG, BMP", PNG_SUFFIXES, "Pillow", "depth, palette", "pixel_size_mm", "made"),
    SEM,
    Format(IMAGES, "videos", VIDEO_SUFFIXES, "OpenCV", "codec", "pixel_size_mm, frame_interval_s",
           "made: lossless, lossy, colour", is_film=True),
    PHOTRON, PHANTOM,
    Format(HEIGHTS, "XYZ text", XYZ_SUFFIXES, "", "pitch, units, missing points", "height_unit",
           "made: spellings of Gwyddion, microscopes"),
    PROFILOMETERS,
)


def _equal_channels(image: np.ndarray, path: Path) -> bool:
    """Whether all channels are equal: a grey image stored in three channels."""
    channels = image if image.shape[-1] in (3, 4) else np.moveaxis(image, 0, -1)
    return channels.shape[-1] in (3, 4) and bool((channels[..., :3] == channels[..., :1]).all())


def _depth(dtype: np.dtype | None, path: Path) -> str:
    names = {"uint8": "uint8", "uint16": "uint16", "float32": "float32", "float64": "float32", "float16": "float32"}
    if dtype is None or str(dtype) not in names:
        raise InputError("an image depth that idic does not read", file=path, key="images",
                         expected="8 or 16 bit unsigned, or 32-bit float",
                         found=str(dtype), remedy="convert the images, e.g. to 16 bit")
    return names[str(dtype)]


def _colour(path: Path, finding: str) -> InputError:
    return InputError("a colour image", file=path, key="images", expected=_EXPECTED, found=finding, remedy=_COLOUR)


def _damaged(path: Path, error: Exception) -> InputError:
    return InputError("the image cannot be read", file=path, key="images", expected=_EXPECTED,
                      found=f"{type(error).__name__}: {error}",
                      remedy="copy the file again (it is truncated, damaged or of another format), or leave it out")
