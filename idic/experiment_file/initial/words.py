"""Messages of `idic init`: the files found, the parameters with their starting values, the keys to fill in."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from idic.experiment_file.initial.found import Found
from idic.fe import segments_of
from idic.readers import parse_unit

MAX_ASPECT_DIFFERENCE = 0.05  # of mesh and speckled area: with more, one of them shows another part of the specimen
FILL_IN = "FILL IN"
_COUNTED = re.compile(r"(frame|image|index|no\.?|nr\.?|number|step|cycle|time|date|zeit|datum)s?", re.IGNORECASE)


def lines_of(found: Found, text: str) -> list[str]:
    """One fact per line, as `idic check` prints them; text : of the written experiment.toml."""
    ny, nx = found.image_shape
    pattern = found.images if isinstance(found.images, str) else ", ".join(found.images)
    lines = [f"images       {pattern}: {found.n_images} of {nx} x {ny} px; the reference is the first, "
             f"{found.reference}",
             *_mesh(found), _log(found), *_columns_without_unit(found),
             "to identify  E from 70 000 MPa and nu from 0.3 of the law elastic, typical of aluminium: replace them by "
             "the law of your material (idic laws) and starting values",
             *(f"note         {note}" for note in found.notes)]
    open_ = [_key(line) for line in text.splitlines() if FILL_IN in line]
    return [*lines, f"fill in      {', '.join(dict.fromkeys(key for key in open_ if key))}"]


def fitting_scale(found: Found) -> tuple[float, tuple[float, float]] | None:
    """mm per pixel and origin (column, row) with which the mesh covers the speckled area; x to the right, y up.

    None where there is no mesh or no area, or where their proportions differ.
    """
    if found.mesh is None or not found.outline:
        return None
    low, high = found.mesh.nodes[:, :2].min(axis=0), found.mesh.nodes[:, :2].max(axis=0)
    first, last = segments_of(found.outline).box()
    if np.any(high <= low) or np.any(last <= first):
        return None
    scale = (high - low) / (last - first)
    if abs(scale[0] / scale[1] - 1.0) > MAX_ASPECT_DIFFERENCE:
        return None
    size = float(scale.mean())
    return size, (float(first[0] - low[0] / size), float(last[1] + low[1] / size))


def _mesh(found: Found) -> Iterator[str]:
    if found.mesh is None:
        if found.outline:
            yield "mesh         no mesh file: a mesh on the speckled area that was found, with its holes"
        else:
            yield "mesh         no mesh file, and no speckled area found: a mesh in the middle of the image, as a guess"
        yield "             idic draw lets you draw it on the image"
        return
    yield f"mesh         {found.mesh_file}: {found.mesh.n_nodes} nodes, {found.mesh.n_elements} elements"
    fit = fitting_scale(found)
    if fit is not None:
        yield (f"scale        the mesh would cover the speckled area with pixel_size_mm = {fit[0]:.4g} and origin_px = "
               f"[{fit[1][0]:.0f}, {fit[1][1]:.0f}]: compare it with your scale")
    elif found.outline:
        yield ("scale        the proportions of the mesh differ from those of the speckled area: it is larger or "
               "smaller than the part in the image, or axes are exchanged")


def _log(found: Found) -> str:
    if found.log is None:
        return "log          none: without a force only ratios of stiffness and strength can be identified"
    rows = len(found.log.rows)
    rest = "" if rows == found.n_images else f"; {rows} rows for {found.n_images} images: give the times of the images"
    return f"log          {found.log_file}: columns {', '.join(found.log.names)}{rest}"


def _columns_without_unit(found: Found) -> Iterator[str]:
    """The columns that may be force or motion, where no column has their unit."""
    log = found.log
    if log is None:
        return
    units = {name: parse_unit(unit) if (unit := log.unit(name)) is not None else None for name in log.names}
    lacking = [what for what, unit in (("force", "N"), ("displacement", "mm"))
               if parse_unit(unit).powers not in [one.powers for one in units.values() if one is not None]]
    without = [name for name, one in units.items() if one is None and name and not _COUNTED.fullmatch(name)]
    if lacking and without:
        yield (f"note         no column has the unit of a {' or of a '.join(lacking)}; without a unit that idic knows: "
               f"{', '.join(without)}. Write it in the name (force_N, grip_mm) or next to the column (unit = \"N\")")


def _key(line: str) -> str:
    """The key of a line that is marked, "" in a comment without one."""
    name = line.lstrip("# ").partition("=")[0].strip()
    return name if name.replace("_", "").isalnum() else ""
