"""Which files belong to which camera."""

from __future__ import annotations

import re
from pathlib import Path

from idic.errors import InputError
from idic.readers import FileStack, PICTURE_SUFFIXES, natural_key, open_stack

SUFFIXES = set(PICTURE_SUFFIXES)
_ENDINGS = (("_0", "_1"), ("_left", "_right"), ("_l", "_r"))


def camera_stacks(arguments: list[Path]) -> tuple[FileStack, ...]:
    """The images of one camera or two.

    Parameters
    ----------
    arguments : list of paths
        One folder per camera; or files of one camera; or one folder or files of a pair whose names end in ``_0`` and
        ``_1`` (``_left`` and ``_right``).

    Raises
    ------
    InputError
        No images, more than two cameras, cameras with different numbers of images, or an unreadable image.
    """
    folders = [path for path in arguments if path.is_dir()]
    for path in arguments:
        if not path.exists():
            raise InputError("no such file or folder", file=path, expected="images of the target, or folders of them",
                             found="nothing there", remedy="correct the path; the shell expands patterns (left/*.tif)")
    if len(folders) > 2 or (folders and len(folders) != len(arguments)):
        raise InputError("not one camera or two", key="IMAGES",
                         found=f"{len(folders)} folders of {len(arguments)} arguments",
                         expected="one folder per camera, or image files", remedy="idic calibrate LEFT RIGHT")
    lists = [_in_folder(folder) for folder in folders] or [sorted(arguments, key=lambda p: natural_key(str(p)))]
    lists = _split(lists[0]) if len(lists) == 1 else lists
    if len({len(paths) for paths in lists}) > 1:
        raise InputError("the cameras have different numbers of images", key="IMAGES",
                         expected="as many right as left, of the same instants",
                         found=f"{len(lists[0])} and {len(lists[1])}",
                         remedy="remove the images that have no partner")
    return tuple(open_stack(paths, key="IMAGES") for paths in lists)


def _in_folder(folder):
    images = sorted((p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES), key=lambda p: natural_key(p.name))
    if not images:
        raise InputError("no images in this folder", file=folder, expected=", ".join(sorted(SUFFIXES)), found="none",
                         remedy="give the folder with the images of the target")
    return images


def _split(paths):
    """Two lists where all names end in those of a pair."""
    for ends in _ENDINGS:
        groups = [[p for p in paths if re.search(f"{end}$", p.stem.lower())] for end in ends]
        if groups[1] and len(groups[0]) + len(groups[1]) == len(paths):
            stems = [[re.sub(f"{end}$", "", p.stem.lower()) for p in group]
                     for group, end in zip(groups, ends, strict=True)]
            singles = sorted(set(stems[0]) ^ set(stems[1]), key=natural_key)
            if singles:
                raise InputError("images without a partner", key="IMAGES", found=", ".join(singles[:5]),
                                 remedy="remove them",
                                 expected=f"for every name one with {ends[0]} and one with {ends[1]}")
            return groups
    return [paths]
