"""What the pages of a TIFF file are: times; or planes, channels and detectors, which are no frames.

ImageJ, OME and other writers state the axes of a stack. Along one axis the images are frames; with two it is not known
which of them is time.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import tifffile

from idic.errors import InputError

_AXIS_WORDS = {"T": "times", "Z": "planes", "C": "channels", "R": "tiles", "P": "positions"}
_REMEDY = ("save the images of one plane and channel as a stack along the time (ImageJ: Image > Duplicate, then "
           "File > Save As > Tiff), or as single files")
_SEM_TAGS = (34118, 34680, 34682)  # Zeiss, FEI
_PAGE_NAME = 285
_MAX_NAMES = 4  # in a note
_COMPOSITE = ("composite", "color")  # display modes of ImageJ in which channels are colours of one image


def stack_notes(tiff: tifffile.TiffFile, pages: Sequence[tifffile.TiffPage], path: Path) -> list[str]:
    """Notes on an axis that is taken for the time.

    Raises
    ------
    InputError
        The images have two axes, are those of several detectors or of different kinds, or a member of an OME series
        is missing.
    """
    _refuse_different_kinds(pages, path)
    if len(pages) > 1 and any(tag in pages[0].tags for tag in _SEM_TAGS):
        raise _several(path, f"{len(pages)} images of a scanning electron microscope, taken at one time with several "
                       "detectors", "save the images of one detector as single files")
    if tiff.is_ome:
        stacks = [_ome_sizes(tiff, path)]
    elif tiff.is_imagej or tiff.is_shaped or tiff.is_lsm or tiff.is_mmstack:
        stacks = [_sizes(series) for series in tiff.series]
    else:
        return _notes_of_names(pages)
    notes = {}
    for sizes in stacks:
        axes = {axis: size for axis, size in sizes if size > 1}
        words = " x ".join(f"{size} {_AXIS_WORDS.get(axis, 'images')} ({axis[0]})" for axis, size in axes.items())
        if len(axes) > 1:
            raise _several(path, words, _REMEDY)
        if "C" in axes and (tiff.imagej_metadata or {}).get("mode") in _COMPOSITE:
            raise _several(path, f"{words}, the colours of one image", _REMEDY)
        if axes.keys() & _AXIS_WORDS.keys() - {"T"}:
            notes[f"{words} by the header, taken as frames that follow each other in time"] = None
    return list(notes)


def stated_images(tiff: tifffile.TiffFile, path: Path) -> int:
    """Number of images of the stack by its header; 1 where it states none."""
    if tiff.is_imagej:
        count = (tiff.imagej_metadata or {}).get("images", 1)
        return count if isinstance(count, int) else 1
    if tiff.is_shaped and tiff.shaped_metadata[0].get("truncated"):
        return math.prod(size for _, size in _sizes(tiff.series[0]))
    if tiff.is_ome:
        return math.prod(size for _, size in _ome_sizes(tiff, path, with_members=False))
    return 1


def _several(path: Path, finding: str, remedy: str) -> InputError:
    return InputError("the images of the file are no frames of one camera", file=path, key="images",
                      expected="images along one axis, the time", found=finding, remedy=remedy)


def _refuse_different_kinds(pages: Sequence[tifffile.TiffPage], path: Path) -> None:
    kinds = [(getattr(page.photometric, "name", str(page.photometric)).lower(), page.samplesperpixel)
             for page in pages]
    if len(set(kinds)) > 1:
        k = next(k for k, kind in enumerate(kinds) if kind != kinds[0])
        raise _several(path, f"page 0 is {kinds[0][0]} with {kinds[0][1]} channels, page {k} {kinds[k][0]} with "
                       f"{kinds[k][1]}", "save the images of the test as a stack of their own")


def _notes_of_names(pages: Sequence[tifffile.TiffPage]) -> list[str]:
    """A note where the pages have names that differ in more than their numbers."""
    names = dict.fromkeys(str(page.tags.valueof(_PAGE_NAME) or "") for page in pages)
    if len({re.sub(r"[0-9]+", "", name) for name in names}) < 2:
        return []
    titles = ", ".join(name or "without a name" for name in list(names)[:_MAX_NAMES])
    return [f"its pages are named {titles}{' …' if len(names) > _MAX_NAMES else ''}, and taken as frames that follow "
            "each other in time"]


def _sizes(series: tifffile.TiffPageSeries) -> list[tuple[str, int]]:
    """Axes above rows, columns and samples, with their sizes; axes without a meaning have their place as well."""
    return [(axis if axis in _AXIS_WORDS else f"{axis}{k}", size)
            for k, (axis, size) in enumerate(zip(series.axes, series.shape, strict=True)) if axis not in "YXS"]


# OME --------------------------------------------------------------------------------------------------
def _ome_sizes(tiff: tifffile.TiffFile, path: Path, with_members: bool = True) -> list[tuple[str, int]]:
    """Positions, times, planes and channels of the images that have planes in a file; InputError where one of the other
    files with their planes is missing.

    with_members : False: none where the images have planes in other files
    """
    root = _ome_root(tiff.ome_metadata or "", path)
    images = [] if root is None else [element for element in root.iter() if _tag(element) == "Pixels"]
    members = [_ome_members(pixels) for pixels in images]
    identity = None if root is None else root.get("UUID")
    pixel_images = [k for k, files in enumerate(members)
                    if path.name in files or (identity and identity in files.values())] or range(len(images))
    missing = list(dict.fromkeys(name for k in pixel_images for name, member in members[k].items()
                                 if not (path.parent / Path(name).name).is_file()
                                 and (not member or member != identity)))
    if missing:
        raise InputError("a file of the OME series is missing", file=path, key="images",
                         expected="all files of the series in one folder, named as in their header",
                         found=f"no {missing[0]}" + (f" and {len(missing) - 1} more" if len(missing) > 1 else ""),
                         remedy="copy it there; or save the images that you have as plain TIFF files")
    if not images or (not with_members and any(len(members[k]) > 1 for k in pixel_images)):
        return []
    pixels = images[pixel_images[0]]
    samples = max([int(element.get("SamplesPerPixel") or 1) for element in pixels if _tag(element) == "Channel"],
                  default=1)
    sizes = {axis: int(pixels.get(f"Size{axis}") or 1) for axis in "TZC"}
    return [("P", len(pixel_images)), *(sizes | {"C": sizes["C"] // samples}).items()]


def _ome_members(pixels: ElementTree.Element) -> dict[str, str]:
    """Files with planes of an image, and their identities."""
    return {element.get("FileName", ""): (element.text or "").strip() for element in pixels.iter()
            if _tag(element) == "UUID" and element.get("FileName")}


def _ome_root(text: str, path: Path) -> ElementTree.Element | None:
    """The OME header, from the file beside it where it is there; None where it cannot be read."""
    try:
        root = ElementTree.fromstring(text)
        companion = next((element.get("MetadataFile") for element in root.iter() if _tag(element) == "BinaryOnly"),
                         None)
        if companion is None:
            return root
        companion_path = path.parent / Path(companion).name
        if not companion_path.is_file():
            raise InputError("a file of the OME series is missing", file=path, key="images",
                             expected=f"its header in {companion}", found="no such file",
                             remedy="copy it there; or save the images as plain TIFF files")
        return ElementTree.fromstring(companion_path.read_text(encoding="utf-8"))
    except (ElementTree.ParseError, UnicodeDecodeError):
        return None


def _tag(element: ElementTree.Element) -> str:
    return str(element.tag).rpartition("}")[2]
