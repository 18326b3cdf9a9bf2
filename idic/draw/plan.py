"""What the page sends: the drawing and the choices of a user, as a strict record; and a first plan for an unknown
folder."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from idic.errors import InputError
from idic.experiment_file import Circle, Points
from idic.fe import Segments

MAX_POINTS = 2000  # of a drawing
ELEMENTS_ACROSS = 10  # of the shorter side of the outline
MIN_ELEMENT_PX = 12.0
END_SHARE = 0.03  # of the length: segments that lie so near to an end of the outline belong to it
Name = Annotated[str, Field(min_length=1, max_length=40, pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]
Number = Annotated[float, Field(allow_inf_nan=False)]


class Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Sketch(Strict):
    """Outline, holes and elements, in px of the reference image."""

    outline: Annotated[Circle | Points, Field(max_length=MAX_POINTS)]
    holes: Annotated[list[Circle | Points], Field(max_length=MAX_POINTS)] = []
    element_px: Annotated[float, Field(gt=0)]
    elements: Literal["quads", "triangles"] = "quads"
    mesher: Literal["idic", "gmsh"] = "idic"
    edge_names: dict[Name, list[int]] = {}


class Motion(Strict):
    """What moves or loads an edge or a hole: measured by the images, held, driven by a column of the log along
    `component`, or under the pressure of a column."""

    kind: Literal["measured", "fixed", "column", "pressure"]
    column: str = ""
    component: Literal["x", "y"] = "y"


class Force(Strict):
    column: str
    edge: Name
    component: Literal["x", "y"]
    noise_std: Annotated[float, Field(gt=0)] | None = None


class Start(Strict):
    value: float
    identify: bool = False


class Plan(Strict):
    """Everything that the page asks."""

    title: Annotated[str, Field(max_length=200)] = ""
    images: str
    loads: str | None = None
    frame_interval_s: Annotated[float, Field(gt=0)] | None = None
    sketch: Sketch
    kind: Literal["plane_stress", "plane_strain", "solid"] = "plane_stress"
    thickness_mm: Annotated[float, Field(gt=0)] | None = None
    pixel_size_mm: Annotated[float, Field(gt=0)] | None = None
    origin_px: tuple[float, float]
    axes: tuple[Literal["+col", "-col", "+row", "-row"], Literal["+col", "-col", "+row", "-row"]] = ("+col", "-row")
    rotation_deg: float = 0.0
    motions: dict[Name, Motion]
    force: Force | None = None
    law: str
    parameters: dict[str, Start]


def read_plan(content: object, kind: type[BaseModel] = Plan) -> BaseModel:
    """The record of what a browser sent.

    Raises
    ------
    InputError
        A field that is missing, unknown or of the wrong kind.
    """
    try:
        return kind.model_validate(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise InputError("a field of the page cannot be used", key=".".join(str(part) for part in first["loc"]),
                         expected=first["msg"], found=str(first.get("input"))[:80],
                         remedy="correct this field") from None


def first_sketch(outline: list, holes: list, shape: tuple[int, int]) -> dict:
    """A drawing for the speckled area, or a rectangle in the image where none was found; ends along the longer side
    named."""
    if not outline:
        ny, nx = shape
        x0, y0, x1, y1 = round(0.1 * nx), round(0.1 * ny), round(0.9 * nx) - 1, round(0.9 * ny) - 1
        outline = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
    names = {} if Segments.is_circle(outline) else end_names(np.array([entry[-2:] for entry in outline], dtype=float))
    size = float(np.ptp(Segments.of(outline).box(), axis=0).min()) / ELEMENTS_ACROSS
    return {"outline": outline, "holes": holes, "element_px": float(max(round(size), MIN_ELEMENT_PX)),
            "elements": "quads", "mesher": "idic", "edge_names": names}


def end_names(points: np.ndarray) -> dict[str, list[int]]:
    """The segments at both ends of the longer side of an outline: TOP and BOTTOM, or LEFT and RIGHT.

    Parameters
    ----------
    points : (n, 2) px
    """
    axis = int(np.argmax(np.ptp(points, axis=0)))
    low, high = points[:, axis].min(), points[:, axis].max()
    reach = END_SHARE * (high - low)
    following = np.roll(points, -1, axis=0)
    names = {}
    for name, at in zip((("LEFT", "RIGHT"), ("TOP", "BOTTOM"))[axis], (low, high), strict=True):
        on_end = (np.abs(points[:, axis] - at) < reach) & (np.abs(following[:, axis] - at) < reach)
        if on_end.any():
            names[name] = (np.flatnonzero(on_end) + 1).tolist()
    return names
