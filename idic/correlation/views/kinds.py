"""What the pixels of a camera tell of the motion: the kinds of views."""

from enum import StrEnum


class ViewKind(StrEnum):
    """Columns and rows alone; a height besides, of a solid or of a cross-section; motion in space; voxels."""

    GREY = "grey"
    HEIGHT = "height"
    SECTION = "section"
    SPACE = "space"
    VOLUME = "volume"
