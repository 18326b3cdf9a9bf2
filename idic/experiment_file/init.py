"""`idic init`: a commented experiment.toml for the files in a folder; unknown values are marked FILL IN."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.experiment_file.checks.height_maps import HEIGHT_UNITS
from idic.experiment_file.initial.fields import fields_document, find_stages
from idic.experiment_file.initial.found import Area, Found, IMAGE_SUFFIXES, files_in, look_around
from idic.experiment_file.initial.words import fitting_scale, lines_of
from idic.experiment_file.toml_file import EXPERIMENT_FILE
from idic.fe import Mesh, segments_of
from idic.inside import open_inside
from idic.readers import Log, parse_unit

_ENDS = (("BOTTOM", "TOP"), ("LEFT", "RIGHT"), ("FIXED", "MOVING"), ("FIX", "LOAD"), ("CLAMP", "PULL"))
_ROI_MARGIN, _ELEMENTS_ACROSS = 0.1, 15


def write_initial_experiment(folder: str | Path, area: Area | None = None) -> Path:
    """`initial_experiment` without its lines."""
    return initial_experiment(folder, area)[0]


def initial_experiment(folder: str | Path, area: Area | None = None) -> tuple[Path, list[str]]:
    """Write experiment.toml into `folder`; returns its path and what was found, one fact per line.

    area : finds the speckled area, for the ROI and for a first guess of the scale

    Raises
    ------
    InputError
        The folder does not exist, holds neither images nor measured fields, or holds an experiment.toml already;
        nothing is written.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError("no such folder", file=folder, expected="a folder with images", found="nothing there",
                         remedy="check the path")
    target = folder / EXPERIMENT_FILE
    if os.path.lexists(target):
        raise InputError("the folder has an experiment already", file=target, expected="no experiment.toml",
                         found="an experiment.toml", remedy="rename or delete that file first")
    files = files_in(folder)
    has_images = any(path.suffix.lower() in IMAGE_SUFFIXES for path in files)
    stages = [] if has_images else find_stages(files)
    contents = None if stages else look_around(folder, files, area)
    text = fields_document(folder, stages, files) if contents is None else _document(contents)
    with open_inside(folder, EXPERIMENT_FILE, "x") as stream:
        stream.write(text)
    return target, [] if contents is None else lines_of(contents, text)


# writing ------------------------------------------------------------------------------------------------
def _document(contents: Found) -> str:
    sections = [_experiment(contents), _camera(contents), _materials(contents), _sets_and_boundary(contents),
                _channel(contents), _TAIL if contents.second is None else _TAIL.replace(*_DOF_OF_A_PAIR)]
    return "\n".join(sections)


def _line(text: str, comment: str) -> str:
    return f"{text:<32} # {comment}"


def _experiment(contents: Found) -> str:
    nx, ny = contents.image_shape[1], contents.image_shape[0]
    lines = [f"# An idic experiment, written by idic init for {contents.n_images} images of {nx} x {ny} px.",
             "# Fill in the values marked FILL IN, then run  idic check .", ""]
    lines += [f"# {note}" for note in contents.notes]
    lines += ["[experiment]", f"title = {json.dumps(contents.folder.resolve().name)}",
              _line(f"images = {json.dumps(contents.images)}", "in natural order; the reference comes first"),
              *_height_lines(contents), *_log_lines(contents), *_mesh_lines(contents)]
    mask = f"mask = {json.dumps(contents.mask)}" if contents.mask else '# mask = "mask.png"'
    lines += [_line(mask, "white is correlated"),
              _line("# exclude_frames = [12]", "numbers in the file names, or indices from 0")]
    return "\n".join(lines) + "\n"


def _height_lines(contents: Found) -> list[str]:
    if not contents.are_heights:
        return []
    unit = None if contents.height_unit is None else parse_unit(contents.height_unit)
    key = next((name for name in HEIGHT_UNITS if parse_unit(name) == unit), None)
    return ['quantity = "height"', _line(f'height_unit = "{key or "um"}"', "as the files state" if key
                                         else "FILL IN: m, mm, um or nm; the files state none of them")]


def _log_lines(contents: Found) -> list[str]:
    if contents.log is None:
        return [_line('# loads = "loads.csv"', "one row per image, e.g. frame,time_s,force_N,grip_displacement_mm")]
    lines = [_line(f"loads = {json.dumps(contents.log_file)}", f"columns: {', '.join(contents.log.names)}")]
    if len(contents.log.rows) != contents.n_images and contents.times_s is not None:
        lines.append(_line(f"# {len(contents.log.rows)} rows for {contents.n_images} images, matched by their times:",
                           "FILL IN first_frame_s, the time of the first image in the log"))
    elif len(contents.log.rows) != contents.n_images:
        lines += [f"# FILL IN: {len(contents.log.rows)} rows for {contents.n_images} images; give the times of the "
                  "images:",
                  _line("# frame_interval_s = 1.0", 'with first_frame_s; or image_times = "times.csv" (column time_s)')]
    return lines


def _mesh_lines(contents: Found) -> list[str]:
    mesh = contents.mesh
    if mesh is None and contents.second is not None:
        return [_line('# FILL IN: mesh = "mesh.inp"', "in mm: two cameras need a mesh at its place in space, or"),
                "# mesh = { outline_mm = [[0, 0], [20, 0], [20, 8], [0, 8]], element_mm = 1, through_mm = 2 }",
                _line('mesh_unit = "mm"', "the outline of the seen face, and the thickness"),
                _line('kind = "solid"', 'or "plane_stress", without through_mm'),
                _line('# surface = "FRONT"', "FILL IN: the face set that both cameras see; FRONT of an outline")]
    if mesh is None:
        x0, y0, x1, y1, size = _guessed_roi(contents)
        holes = f", holes_px = {json.dumps(contents.holes)}" if contents.holes else ""
        source = "the speckled area that was found" if contents.outline else "a guess, also holes_px"
        return [f"mesh = {{ roi_px = [{x0}, {y0}, {x1}, {y1}], element_px = {size}{holes} }}   # {source}",
                _line('kind = "plane_stress"', "plane_stress | plane_strain"),
                _line("# thickness_mm = 1.0", "FILL IN if a force is compared")]
    extent = ", ".join(f"{axis} {a:g} … {b:g}"
                       for axis, a, b in zip("xyz", mesh.nodes.min(axis=0), mesh.nodes.max(axis=0), strict=False))
    lines = [_line(f"mesh = {json.dumps(contents.mesh_file)}",
                   f"{mesh.n_nodes} nodes, {mesh.n_elements} elements; {extent}"),
             _line(f"mesh_unit = {json.dumps(_guessed_unit(mesh))}", "m, mm, um, px …: check it against this extent")]
    if mesh.n_dim == 2:
        return [*lines, _line('kind = "plane_stress"', "plane_stress | plane_strain"),
                _line("# thickness_mm = 1.0", "FILL IN if a force is compared")]
    name = next(iter(mesh.edge_sets), None)
    surface = f"surface = {json.dumps(name)}" if name else '# FILL IN: surface = "FRONT"'
    return [*lines, 'kind = "solid"',
            _line(surface, f"the face set that the camera sees, out of: {', '.join(mesh.edge_sets) or 'none'}")]


def _guessed_unit(mesh: Mesh) -> str:
    size = float(np.ptp(mesh.nodes, axis=0).max())
    return "m" if size < 0.5 else "mm"  # specimens are millimetres to decimetres long


def _guessed_roi(contents: Found) -> tuple[int, int, int, int, int]:
    """The rectangle around the speckled area, or the middle of the image, and the size of an element."""
    ny, nx = contents.image_shape
    x0, y0 = int(_ROI_MARGIN * nx), int(_ROI_MARGIN * ny)
    x1, y1 = nx - 1 - x0, ny - 1 - y0
    if contents.outline:
        low, high = segments_of(contents.outline).box()
        (x0, y0), (x1, y1) = np.ceil(low).astype(int).tolist(), np.floor(high).astype(int).tolist()
    return x0, y0, x1, y1, max(min(x1 - x0, y1 - y0) // _ELEMENTS_ACROSS, 1)


def _camera(contents: Found) -> str:
    if contents.second is not None:
        return "\n".join(contents.second.lines(contents.mesh))
    noise = _line("# noise_std_gv = 2.0", "of one image; else from still_frames, else from the residual")
    stated_size = None if contents.pitch_mm is None else _line(f"pixel_size_mm = {contents.pitch_mm[0]:.6g}",
                                                               "as the image files state")
    if contents.are_heights and stated_size is not None:
        return "\n".join(["[camera]", stated_size,
                          _line("# origin_px = [0.0, 0.0]", "FILL IN: (column, row) of the mesh origin"),
                          _line('axes = ["+col", "-row"]', "directions of mesh x and y in the image"),
                          _line("# noise_std_gv = 0.01", "FILL IN: of one height, in its unit; or still_frames"), ""])
    if contents.mesh is None:
        return "\n".join(["[camera]", stated_size or _line(
            "# pixel_size_mm = 0.05", "FILL IN for lengths in mm and forces; else in px"), noise, ""])
    fit = fitting_scale(contents)
    size, origin = ("0.05", "[0.0, 0.0]") if fit is None else (f"{fit[0]:.4g}", f"[{fit[1][0]:.1f}, {fit[1][1]:.1f}]")
    as_found = "" if fit is None else "; this value covers the speckled area"
    return "\n".join([
        _line("[camera]", "(column, row) of a mesh point; pixel centres at integers, rows count downwards"),
        stated_size or _line(f"# pixel_size_mm = {size}", f"FILL IN: the size of a pixel on the specimen{as_found}"),
        _line(f"# origin_px = {origin}", f"FILL IN: (column, row) of the mesh origin in the reference image{as_found}"),
        _line('axes = ["+col", "-row"]', "directions of mesh x and y in the image"), noise, ""])


def _materials(contents: Found) -> str:
    names = list(contents.mesh.element_sets) if contents.mesh is not None else []
    covering = [name for name in names if len(contents.mesh.element_sets[name]) == contents.mesh.n_elements]
    chosen = covering[:1] or names or ["SPECIMEN"]
    parts = []
    for name in chosen:
        table = name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name)
        parts.append("\n".join([_line(f"[material.{table}]", "one table per element set"),
                                _line('law = "elastic"', "idic laws lists them all"),
                                'E = { value = 70e3, unit = "MPa", identify = true }   # FILL IN a first guess',
                                "nu = { value = 0.3, identify = true }", ""]))
    return "\n".join(parts)


def _sets_and_boundary(contents: Found) -> str:
    if contents.mesh is None:
        return "\n".join([_line("[[boundary]]",
                                "the drive of the simulation: the measured motion of the edge of the ROI"),
                          'nodes = "OUTER"', 'u = "measured"', ""])
    fixed_end, moving_end, component, lines = _ends(contents)
    column = _column(contents.log, "mm", r"disp|grip|stroke|extension|position|cross")
    other_axes = [axis for axis in "xyz"[:contents.mesh.n_dim] if axis != component]
    lines += [f"# node sets of the mesh file: {', '.join(contents.mesh.node_sets) or 'none'}",
              _line("[[boundary]]", "the drives of the simulation"), f"nodes = {json.dumps(fixed_end)}"]
    lines += [f"u{axis} = 0.0" for axis in (component, *other_axes)] if column else ['u = "measured"']
    lines += ["", "[[boundary]]", f"nodes = {json.dumps(moving_end)}"]
    if column:
        lines += [f"u{component} = {{ column = {json.dumps(column)} }}", *(f"u{axis} = 0.0" for axis in other_axes)]
    else:
        lines += ['u = "measured"']
    return "\n".join(lines) + "\n"


def _ends(contents: Found) -> tuple[str, str, str, list[str]]:
    """Names of the fixed and the moving end, the direction between them, and [sets] lines if the mesh names no ends."""
    mesh = contents.mesh
    upper = {name.upper(): name for name in (*mesh.node_sets, *mesh.edge_sets)}
    named_ends = [(upper[a], upper[b]) for a, b in _ENDS if a in upper and b in upper and upper[a] in mesh.node_sets
                  and upper[b] in mesh.node_sets]
    if named_ends:
        centre = {name: mesh.nodes[mesh.node_sets[name]].mean(axis=0) for pair in named_ends for name in pair}
        fixed_end, moving_end = max(named_ends, key=lambda pair: np.linalg.norm(centre[pair[1]] - centre[pair[0]]))
        return fixed_end, moving_end, "xyz"[int(np.argmax(np.abs(centre[moving_end] - centre[fixed_end])))], []
    low, high = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
    k = int(np.argmax(high - low))
    margin = 1e-6 * (high - low)[k]
    start, end = _free_name("START", upper), _free_name("END", upper)
    axis = "xyz"[k]
    lines = [_line("[sets]", "the mesh names no opposite ends: by position, in the mesh unit"),
             f'{start} = {{ where = "{axis} < {low[k] + margin:.9g}" }}',
             f'{end} = {{ where = "{axis} > {high[k] - margin:.9g}" }}', ""]
    return start, end, axis, lines


def _free_name(name: str, names) -> str:
    return name if name not in names else f"{name}_"


def _column(log: Log | None, unit: str, pattern: str) -> str | None:
    """The column of the log with this dimension and the best fitting name."""
    if log is None:
        return None
    powers = parse_unit(unit).powers
    fitting = [name for name in log.names if (column_unit := log.unit(name)) is not None
               and parse_unit(column_unit).powers == powers]
    return next((name for name in fitting if re.search(pattern, name, re.IGNORECASE)), fitting[0] if fitting else None)


def _channel(contents: Found) -> str:
    column = _column(contents.log, "N", r"force|load|kraft")
    if contents.mesh is None:
        end, component = _pulled_side(contents)
    else:
        _, end, component, _ = _ends(contents)
    simulated = f"simulated = {{ reaction = {json.dumps(end)}, component = \"{component}\" }}"
    if contents.mesh is None or column is None:
        note = "" if contents.mesh is not None else "   # the end that is pulled; all of OUTER adds up to zero"
        return "\n".join([_line("# [[channel]]", "measured against simulated; needs the scale and the thickness"),
                          f"# column = {json.dumps(column or 'force_N')}", f"# {simulated}{note}", ""])
    needs = "" if contents.mesh.n_dim == 3 else "; needs thickness_mm"
    return "\n".join([_line("[[channel]]", f"measured against simulated{needs}"),
                      f"column = {json.dumps(column)}", simulated,
                      _line("# ", "factor = 2.0 in it where half the thickness is modelled"),
                      _line("# noise_std = 5.0", "in the unit of the column"), ""])


def _pulled_side(contents: Found) -> tuple[str, str]:
    """A short side of the ROI in whose direction an axis points: x to the right, y down."""
    x0, y0, x1, y1, _ = _guessed_roi(contents)
    return ("RIGHT", "x") if x1 - x0 >= y1 - y0 else ("BOTTOM", "y")


_DOF_OF_A_PAIR = ('name = "camera.rotation_deg"   # camera.*, ', 'name = "placement.t_z"         # placement.*, ')
_TAIL = """# [[dof]]                        # further degrees of freedom
# name = "camera.rotation_deg"   # camera.*, channel.COLUMN.{scale, offset, drift}, time.offset,
                                 # geometry.{thickness, hole_x, hole_y, hole_radius, outline}
# value = 0.0

# [[stage]]                      # a schedule; default: everything at once
# free = ["SPECIMEN.E"]

# [setup]                        # description of the laboratory for the report: camera, lens, aperture, stand_off,
# camera = "5 Mpx, 8 bit"        # exposure, lighting, pattern, specimen, machine

# [options]
# max_iterations = 40
# interpolation = "quintic"      # or cubic
"""
