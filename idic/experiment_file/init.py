"""`idic init`: a commented experiment.toml for the files in a folder; unknown values are marked FILL IN."""

from __future__ import annotations

import json
import os
import shlex
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.experiment_file.checks.height_maps import HEIGHT_UNITS
from idic.experiment_file.initial.fields import fields_document, find_stages
from idic.experiment_file.initial.found import Area, Found, IMAGE_SUFFIXES, files_in, find_model, look_around
from idic.experiment_file.initial.scans import find_scans, mask_among
from idic.experiment_file.initial.sections import (
    column_of, ends_of, guessed_unit, line, log_lines, materials,
)
from idic.experiment_file.initial.specimens import specimens_in
from idic.experiment_file.initial.volumes import scans_found, volumes_document
from idic.experiment_file.initial.words import fitting_scale, lines_of
from idic.experiment_file.toml_file import EXPERIMENT_FILE
from idic.fe import Segments
from idic.inside import open_inside
from idic.readers import parse_unit

_ROI_MARGIN, _ELEMENTS_ACROSS = 0.1, 15
_MIN_ELEMENT_PX = 8  # edge: in smaller ones a free displacement scatters too much, as `idic check` warns


def initial_experiment(folder: str | Path, area: Area | None = None) -> tuple[Path, list[str]]:
    """Write experiment.toml into `folder`; returns its path and what was found, one fact per line. Where each folder in
    it holds the images and the log of a specimen, into each of them; returns `folder` then.

    area : finds the speckled area, for the ROI and for a first guess of the scale

    Raises
    ------
    InputError
        The folder does not exist, holds neither images, measured fields nor scans, or holds an experiment.toml already;
        nothing is written.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError("no such folder", file=folder, expected="a folder with images", found="nothing there",
                         remedy="check the path")
    specimens = specimens_in(folder)
    for place in specimens or [folder]:
        _refuse_second(place)
    return _of_specimens(folder, specimens, area) if specimens else _of_one(folder, area)


def _of_specimens(folder: Path, specimens: list[Path], area: Area | None) -> tuple[Path, list[str]]:
    lines = []
    for place in specimens:
        lines += [f"specimen     {place.name}", *_of_one(place, area)[1]]
    names = " ".join(shlex.quote(place.name) for place in specimens)
    return folder, [*lines, f"specimens    {len(specimens)}; one material of all of them: idic identify {names} "
                            "--out RUN"]


def _of_one(folder: Path, area: Area | None) -> tuple[Path, list[str]]:
    files = files_in(folder)
    scans = find_scans(folder, files)
    if scans is not None:
        contents = scans_found(folder, scans)
        contents.mask = mask_among(folder, files, scans)
        find_model(files, contents)
        text, lines = volumes_document(scans, contents)
        return _written(folder, text), lines
    has_images = any(path.suffix.lower() in IMAGE_SUFFIXES for path in files)
    stages = [] if has_images else find_stages(files)
    contents = None if stages else look_around(folder, files, area)
    text = fields_document(folder, stages, files) if contents is None else _document(contents)
    return _written(folder, text), [] if contents is None else lines_of(contents, text)


def _refuse_second(folder: Path) -> None:
    target = folder / EXPERIMENT_FILE
    if os.path.lexists(target):
        raise InputError("the folder has an experiment already", file=target, expected="no experiment.toml",
                         found="an experiment.toml", remedy="rename or delete that file first")


def _written(folder: Path, text: str) -> Path:
    with open_inside(folder, EXPERIMENT_FILE, "x") as stream:
        stream.write(text)
    return folder / EXPERIMENT_FILE


# writing ------------------------------------------------------------------------------------------------
def _document(contents: Found) -> str:
    sections = [_experiment(contents), _camera(contents), materials(contents), _sets_and_boundary(contents),
                _channel(contents), _TAIL if contents.second is None else _TAIL.replace(*_DOF_OF_A_PAIR)]
    return "\n".join(sections)


def _experiment(contents: Found) -> str:
    nx, ny = contents.image_shape[1], contents.image_shape[0]
    lines = [f"# An idic experiment, written by idic init for {contents.n_images} images of {nx} x {ny} px.",
             "# Fill in the values marked FILL IN, then run  idic check .", ""]
    lines += [f"# {note}" for note in contents.notes]
    lines += ["[experiment]", f"title = {json.dumps(contents.folder.resolve().name)}",
              line(f"images = {json.dumps(contents.images)}", "in natural order; the reference comes first"),
              *_height_lines(contents), *log_lines(contents), *_mesh_lines(contents)]
    mask = f"mask = {json.dumps(contents.mask)}" if contents.mask else '# mask = "mask.png"'
    lines += [line(mask, "white is correlated"),
              line("# exclude_frames = [12]", "numbers in the file names, or indices from 0")]
    return "\n".join(lines) + "\n"


def _height_lines(contents: Found) -> list[str]:
    if not contents.are_heights:
        return []
    unit = None if contents.height_unit is None else parse_unit(contents.height_unit)
    key = next((name for name in HEIGHT_UNITS if parse_unit(name) == unit), None)
    return ['quantity = "height"', line(f'height_unit = "{key or "um"}"', "as the files state" if key
                                         else "FILL IN: m, mm, um or nm; the files state none of them")]


def _mesh_lines(contents: Found) -> list[str]:
    mesh = contents.mesh
    if mesh is None and contents.second is not None:
        return [line('# FILL IN: mesh = "mesh.inp"', "in mm: two cameras need a mesh at its place in space, or"),
                "# mesh = { outline_mm = [[0, 0], [20, 0], [20, 8], [0, 8]], element_mm = 1, through_mm = 2 }",
                line('mesh_unit = "mm"', "the outline of the seen face, and the thickness"),
                line('kind = "solid"', 'or "plane_stress", without through_mm'),
                line('# surface = "FRONT"', "FILL IN: the face set that both cameras see; FRONT of an outline")]
    if mesh is None:
        x0, y0, x1, y1, size = _guessed_roi(contents)
        holes = f", holes_px = {json.dumps(contents.holes)}" if contents.holes else ""
        source = "the speckled area that was found" if contents.outline else "a guess, also holes_px"
        return [f"mesh = {{ roi_px = [{x0}, {y0}, {x1}, {y1}], element_px = {size}{holes} }}   # {source}",
                line('kind = "plane_stress"', "plane_stress | plane_strain"),
                line("# thickness_mm = 1.0", "FILL IN if a force is compared")]
    extent = ", ".join(f"{axis} {a:g} … {b:g}"
                       for axis, a, b in zip("xyz", mesh.nodes.min(axis=0), mesh.nodes.max(axis=0), strict=False))
    lines = [line(f"mesh = {json.dumps(contents.mesh_file)}",
                   f"{mesh.n_nodes} nodes, {mesh.n_elements} elements; {extent}"),
             line(f"mesh_unit = {json.dumps(guessed_unit(mesh))}", "m, mm, um, px …: check it against this extent")]
    if mesh.n_dim == 2:
        return [*lines, line('kind = "plane_stress"', "plane_stress | plane_strain"),
                line("# thickness_mm = 1.0", "FILL IN if a force is compared")]
    name = next(iter(mesh.edge_sets), None)
    surface = f"surface = {json.dumps(name)}" if name else '# FILL IN: surface = "FRONT"'
    return [*lines, 'kind = "solid"',
            line(surface, f"the face set that the camera sees, out of: {', '.join(mesh.edge_sets) or 'none'}")]


def _guessed_roi(contents: Found) -> tuple[int, int, int, int, int]:
    """The rectangle around the speckled area, or the middle of the image, and the size of an element."""
    ny, nx = contents.image_shape
    x0, y0 = int(_ROI_MARGIN * nx), int(_ROI_MARGIN * ny)
    x1, y1 = nx - 1 - x0, ny - 1 - y0
    if contents.outline:
        low, high = Segments.of(contents.outline).box()
        (x0, y0), (x1, y1) = np.ceil(low).astype(int).tolist(), np.floor(high).astype(int).tolist()
    return x0, y0, x1, y1, max(min(x1 - x0, y1 - y0) // _ELEMENTS_ACROSS, _MIN_ELEMENT_PX)


def _camera(contents: Found) -> str:
    if contents.second is not None:
        return "\n".join(contents.second.lines(contents.mesh))
    noise = line("# noise_std_gv = 2.0", "of one image; else from still_frames, else from the residual")
    stated_size = None if contents.pitch_mm is None else line(f"pixel_size_mm = {contents.pitch_mm[0]:.6g}",
                                                               "as the image files state")
    if contents.are_heights and stated_size is not None:
        return "\n".join(["[camera]", stated_size,
                          line("# origin_px = [0.0, 0.0]", "FILL IN: (column, row) of the mesh origin"),
                          line('axes = ["+col", "-row"]', "directions of mesh x and y in the image"),
                          line("# noise_std_gv = 0.01", "FILL IN: of one height, in its unit; or still_frames"), ""])
    if contents.mesh is None:
        return "\n".join(["[camera]", stated_size or line(
            "# pixel_size_mm = 0.05", "FILL IN for lengths in mm and forces; else in px"), noise, ""])
    fit = fitting_scale(contents)
    size, origin = ("0.05", "[0.0, 0.0]") if fit is None else (f"{fit[0]:.4g}", f"[{fit[1][0]:.1f}, {fit[1][1]:.1f}]")
    as_found = "" if fit is None else "; this value covers the speckled area"
    return "\n".join([
        line("[camera]", "(column, row) of a mesh point; pixel centres at integers, rows count downwards"),
        stated_size or line(f"# pixel_size_mm = {size}", f"FILL IN: the size of a pixel on the specimen{as_found}"),
        line(f"# origin_px = {origin}", f"FILL IN: (column, row) of the mesh origin in the reference image{as_found}"),
        line('axes = ["+col", "-row"]', "directions of mesh x and y in the image"), noise, ""])


def _sets_and_boundary(contents: Found) -> str:
    if contents.mesh is None:
        return "\n".join([line("[[boundary]]",
                                "the drive of the simulation: the measured motion of the edge of the ROI"),
                          'nodes = "OUTER"', 'u = "measured"', ""])
    fixed_end, moving_end, component, lines = ends_of(contents)
    column = column_of(contents.log, "mm", r"disp|grip|stroke|extension|position|cross")
    other_axes = [axis for axis in "xyz"[:contents.mesh.n_dim] if axis != component]
    lines += [f"# node sets of the mesh file: {', '.join(contents.mesh.node_sets) or 'none'}",
              line("[[boundary]]", "the drives of the simulation"), f"nodes = {json.dumps(fixed_end)}"]
    lines += [f"u{axis} = 0.0" for axis in (component, *other_axes)] if column else ['u = "measured"']
    lines += ["", "[[boundary]]", f"nodes = {json.dumps(moving_end)}"]
    if column:
        lines += [f"u{component} = {{ column = {json.dumps(column)} }}", *(f"u{axis} = 0.0" for axis in other_axes)]
    else:
        lines += ['u = "measured"']
    return "\n".join(lines) + "\n"


def _channel(contents: Found) -> str:
    column = column_of(contents.log, "N", r"force|load|kraft")
    if contents.mesh is None:
        end, component = _pulled_side(contents)
    else:
        _, end, component, _ = ends_of(contents)
    simulated = f"simulated = {{ reaction = {json.dumps(end)}, component = \"{component}\" }}"
    if contents.mesh is None or column is None:
        note = "" if contents.mesh is not None else "   # the end that is pulled; all of OUTER adds up to zero"
        return "\n".join([line("# [[channel]]", "measured against simulated; needs the scale and the thickness"),
                          f"# column = {json.dumps(column or 'force_N')}", f"# {simulated}{note}", ""])
    needs = "" if contents.mesh.n_dim == 3 else "; needs thickness_mm"
    return "\n".join([line("[[channel]]", f"measured against simulated{needs}"),
                      f"column = {json.dumps(column)}", simulated,
                      line("# ", "factor = 2.0 in it where half the thickness is modelled"),
                      line("# noise_std = 5.0", "in the unit of the column"), ""])


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
