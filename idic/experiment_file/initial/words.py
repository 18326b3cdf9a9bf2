"""Messages of `idic init`: the files found, the parameters with their starting values, the keys to fill in."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from idic.experiment_file.initial.found import Found
from idic.fe import Segments
from idic.readers import parse_unit

MAX_ASPECT_DIFFERENCE = 0.05  # of mesh and speckled area: with more, one of them shows another part of the specimen
FILL_IN = "FILL IN"
_COUNTED = re.compile(r"(frame|image|index|no\.?|nr\.?|number|step|cycle|time|date|zeit|datum)s?", re.IGNORECASE)


def lines_of(contents: Found, text: str) -> list[str]:
    """One fact per line, as `idic check` prints them; text : of the written experiment.toml."""
    ny, nx = contents.image_shape
    pattern = contents.images if isinstance(contents.images, str) else ", ".join(contents.images)
    lines = [f"images       {pattern}: {contents.n_images} of {nx} x {ny} px; the reference is the first, "
             f"{contents.reference}",
             *_pattern(contents), *_second_camera(contents), *_mesh(contents), _log(contents),
             *_columns_without_unit(contents),
             "to identify  E from 70 000 MPa and nu from 0.3 of the law elastic, typical of aluminium: replace them by "
             "the law of your material (idic laws) and starting values",
             *(f"note         {note}" for note in contents.notes)]
    open_ = [key_of(line) for line in text.splitlines() if FILL_IN in line]
    return [*lines, f"fill in      {', '.join(dict.fromkeys(key for key in open_ if key))}"]


def fitting_scale(contents: Found) -> tuple[float, tuple[float, float]] | None:
    """mm per pixel and origin (column, row) with which the mesh covers the speckled area; x to the right, y up.

    None where there is no mesh or no area, or where their proportions differ.
    """
    if contents.mesh is None or not contents.outline:
        return None
    low, high = contents.mesh.nodes[:, :2].min(axis=0), contents.mesh.nodes[:, :2].max(axis=0)
    start, end = Segments.of(contents.outline).box()
    if np.any(high <= low) or np.any(end <= start):
        return None
    scale = (high - low) / (end - start)
    if abs(scale[0] / scale[1] - 1.0) > MAX_ASPECT_DIFFERENCE:
        return None
    size = float(scale.mean())
    return size, (float(start[0] - low[0] / size), float(end[1] + low[1] / size))


def _pattern(contents: Found) -> Iterator[str]:
    if contents.speckle_px is not None:
        yield f"pattern      the speckle is {contents.speckle_px:.1f} px wide"


def _second_camera(contents: Found) -> Iterator[str]:
    if contents.second is not None:
        yield (f"cameras      two, {' and '.join(contents.second.names)}, by {contents.second.calibration}; images of "
               f"the second: {contents.second.images}")


def _mesh(contents: Found) -> Iterator[str]:
    if contents.mesh is None and contents.second is not None:
        yield "mesh         no mesh file: give one in mm, or the outline of the seen face in mm and the thickness"
        return
    if contents.mesh is None:
        if contents.outline:
            holes = f" and its {len(contents.holes)} holes" if len(contents.holes) > 1 else " and its hole"
            yield ("mesh         no mesh file: a mesh on the speckled area that was found"
                   f"{holes if contents.holes else ''}")
        else:
            yield "mesh         no mesh file, and no speckled area found: a mesh in the middle of the image, as a guess"
        yield "             idic draw lets you draw it on the image"
        return
    yield f"mesh         {contents.mesh_file}: {contents.mesh.n_nodes} nodes, {contents.mesh.n_elements} elements"
    fit = None if contents.second is not None else fitting_scale(contents)
    if fit is not None:
        yield (f"scale        the mesh would cover the speckled area with pixel_size_mm = {fit[0]:.4g} and origin_px = "
               f"[{fit[1][0]:.0f}, {fit[1][1]:.0f}]: compare it with your scale")
    elif contents.outline and contents.second is None:
        yield ("scale        the proportions of the mesh differ from those of the speckled area: it is larger or "
               "smaller than the part in the image, or axes are exchanged")


def _log(contents: Found) -> str:
    if contents.log is None:
        return "log          none: without a force only ratios of stiffness and strength can be identified"
    rows = len(contents.log.rows)
    row_note = ("" if rows == contents.n_images else f"; {rows} rows for {contents.n_images} images: "
                + ("give the times of the images" if contents.times_s is None
                   else "matched by the times of the image files, which first_frame_s shifts"))
    return f"log          {contents.log_file}: columns {', '.join(contents.log.names)}{row_note}"


def _columns_without_unit(contents: Found) -> Iterator[str]:
    """The columns that may be force or motion, where no column has their unit."""
    log = contents.log
    if log is None:
        return
    units = {name: parse_unit(unit) if (unit := log.unit(name)) is not None else None for name in log.names}
    lacking = [quantity for quantity, unit in (("force", "N"), ("displacement", "mm"))
               if parse_unit(unit).powers not in [parsed_unit.powers for parsed_unit in units.values()
                                                  if parsed_unit is not None]]
    without = [name for name, parsed_unit in units.items()
               if parsed_unit is None and name and not _COUNTED.fullmatch(name)]
    if lacking and without:
        yield (f"note         no column has the unit of a {' or of a '.join(lacking)}; without a unit that idic knows: "
               f"{', '.join(without)}. Write it in the name (force_N, grip_mm) or next to the column (unit = \"N\")")


def key_of(line: str) -> str:
    """The key of a line that is marked, "" in a comment without one."""
    name = line.lstrip("# ").removeprefix(f"{FILL_IN}: ").partition("=")[0].strip()
    return name if name.replace("_", "").isalnum() else ""
