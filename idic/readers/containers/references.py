"""HDF5 and XDMF: data that lie in another file are refused before a library reads them.

HDF5 can take a group or an array from any file of the computer (external links, external storage, virtual datasets),
XDMF names the file of its numbers: https://docs.hdfgroup.org/hdf5/develop/_f_m_t3.html, https://www.xdmf.org.
"""

from __future__ import annotations

import stat
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from xml.etree import ElementTree

from idic.errors import InputError
from idic.inside import checked_parts, is_inside

SIGNATURE = b"\x89HDF\r\n\x1a\n"
_PLACES = (0, *(512 << k for k in range(12)))  # of the signature; a block has a power of two of bytes
_XDMF_SUFFIXES, _IN_THE_FILE = (".xdmf", ".xmf"), "XML"
_REMEDY = "do not use this file if it comes from somebody else; otherwise save all data in one file"


def is_hdf5(path: Path) -> bool:
    """Whether a regular file begins like one of HDF5, behind a block of another program (MATLAB) too."""
    if not stat.S_ISREG(path.stat().st_mode):
        return False
    with path.open("rb") as stream:
        for place in _PLACES:
            stream.seek(place)
            if stream.read(len(SIGNATURE)) == SIGNATURE:
                return True
    return False


def refuse_references(path: Path, key: str) -> None:
    """`InputError` where a file of HDF5 or XDMF takes data from outside of its folder; other files pass.

    XDMF may keep its numbers in a file beside it, which is looked at in turn.
    """
    if path.suffix.lower() in _XDMF_SUFFIXES:
        for name in _named_in_xdmf(path):
            if len(checked_parts(name)) > 1 or not is_inside(path.parent, name):
                raise _refused(path, key, f"{name}, no regular file beside it")
            refuse_references(path.parent / name, key)
    elif is_hdf5(path):
        outside = next(_outside_of(path, key), None)
        if outside is not None:
            raise _refused(path, key, outside)


def _refused(path: Path, key: str, finding: str) -> InputError:
    return InputError("the file takes data from another file", file=path, key=key, expected="all data in the file",
                      found=finding, remedy=_REMEDY)


def _named_in_xdmf(path: Path) -> list[str]:
    """Names of the files with the numbers; an unreadable file has none, and is refused by its reader."""
    with suppress(ElementTree.ParseError, UnicodeDecodeError, OSError):
        items = [element for element in ElementTree.parse(path).iter() if element.tag.rpartition("}")[2] == "DataItem"]
        return [(element.text or "").strip().partition(":")[0] for element in items
                if (element.get("Format") or _IN_THE_FILE) != _IN_THE_FILE]
    return []


def _outside_of(path: Path, key: str) -> Iterator[str]:
    """What an HDF5 file takes from elsewhere; `InputError` where it cannot be looked at."""
    import h5py  # loaded where such a file is read

    places: list[str] = []

    def of_link(name: str, link: object) -> None:
        if isinstance(link, h5py.ExternalLink):
            places.append(f"{name} in {link.filename}")

    def of_array(name: str, node: object) -> None:
        if isinstance(node, h5py.Dataset) and (node.external or node.is_virtual):
            places.append(f"{name} in {node.external[0][0] if node.external else 'other datasets'}")

    try:
        with h5py.File(path, "r") as file:
            file.visititems_links(of_link)
            if not places:
                file.visititems(of_array)
    except Exception as problem:
        raise InputError("the file cannot be read", file=path, key=key, expected="a whole file of HDF5",
                         found=f"parts that cannot be looked at ({problem})",
                         remedy="write the file again") from problem
    yield from places
