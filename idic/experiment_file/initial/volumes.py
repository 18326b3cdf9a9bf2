"""`idic init` for a folder of scans: experiment.toml with the mesh laid on the specimen where its sides fit."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from idic.experiment_file.initial.found import Found
from idic.experiment_file.initial.scans import PlaceInScan, pattern_of, place_in_scan, specimen_box
from idic.experiment_file.initial.sections import column_of, ends_of, line, log_lines, materials
from idic.experiment_file.initial.words import FILL_IN, key_of
from idic.experiment_file.volumes.scans import ScanFiles
from idic.readers import factor_between

_AXES = ("+col", "+row", "+slice")
_UNITS = ("mm", "um", "m")
MAX_RESTING_FORCE = 0.05  # of the largest change of the force: drift and noise of a load cell between two scans
_MASK_FILE = '# mask = "mask.tif"'


def volumes_document(scans: ScanFiles, contents: Found) -> tuple[str, list[str]]:
    """The text of experiment.toml and what was found, one fact per line.

    contents : mesh, log and notes of the folder; its images are the slices of the scans
    """
    place, unit = _place(scans, contents)
    text = "\n".join([_experiment(scans, contents, unit), _scanner(scans, contents, place), materials(contents),
                      *_boundary(contents), _TAIL])
    open_keys = dict.fromkeys(key for row in text.splitlines() if FILL_IN in row and (key := key_of(row)))
    return text, [*_facts(scans, contents, place), f"fill in      {', '.join(open_keys)}"]


def scans_found(folder: Path, scans: ScanFiles) -> Found:
    """The scans as the images of the folder, beside which a mesh and a log are looked for."""
    return Found(folder, pattern_of(folder, scans), scans.n_frames, scans.shape[1:], scans.labels[0],
                 times_s=scans.times)


def _place(scans: ScanFiles, contents: Found) -> tuple[PlaceInScan | None, str]:
    """How the mesh lies on the specimen, and the unit of its file: the one in which it is as large as the volume."""
    if contents.mesh is None:
        return None, "mm"
    sides = None if scans.voxel_mm is None else np.array(scans.voxel_mm)
    low, high = contents.mesh.nodes.min(axis=0), contents.mesh.nodes.max(axis=0)
    unit = "mm"
    if sides is not None:
        volume_mm = float((sides * scans.shape[::-1]).max())
        unit = min(_UNITS, key=lambda name: abs(np.log(float((high - low).max()) * factor_between(name, "mm")
                                                       / volume_mm)))
    factor, box = factor_between(unit, "mm"), specimen_box(scans)
    return None if box is None else place_in_scan(low * factor, high * factor, box, sides), unit


def _experiment(scans: ScanFiles, contents: Found, unit: str) -> str:
    nz, ny, nx = scans.shape
    lines = [f"# An idic experiment, written by idic init for {scans.n_frames} scans of {nx} x {ny} x {nz} voxels.",
             "# Fill in the values marked FILL IN, then run  idic check .", "",
             *(f"# {note}" for note in contents.notes), "[experiment]",
             f"title = {json.dumps(contents.folder.resolve().name)}",
             line(f"volumes = {json.dumps(contents.images)}", "in natural order; the reference comes first"),
             *(text.replace("image", "scan") if "image_times" not in text else text for text in log_lines(contents))]
    mesh = contents.mesh
    if mesh is None:
        lines.append(line('# mesh = "mesh.inp"', "FILL IN: the specimen in hex8, hex20, tet4 or tet10"))
    else:
        extent = ", ".join(f"{axis} {a:g} … {b:g}" for axis, a, b in zip("xyz", mesh.nodes.min(axis=0),
                                                                        mesh.nodes.max(axis=0), strict=False))
        lines += [line(f"mesh = {json.dumps(contents.mesh_file)}",
                       f"{mesh.n_nodes} nodes, {mesh.n_elements} elements; {extent}"),
                  line(f"mesh_unit = {json.dumps(unit)}", "check it against this extent")]
    still = _still_scans(contents)
    lines += ['kind = "solid"',
              line("still_frames = [0, 1]", f"two scans of one state, {still}: their difference is the noise") if still
              else line("# still_frames = [0, 1]", "FILL IN: two scans of one state, or noise_std_gv under [scanner]"),
              line(f"mask = {json.dumps(contents.mask)}" if contents.mask else _MASK_FILE, "above zero is compared"),
              line("# exclude_frames = [5]", "numbers in the file names, or indices from 0")]
    return "\n".join(lines) + "\n"


def _still_scans(contents: Found) -> str:
    """Why the first two scans are of one state; "" where nothing says so."""
    column = column_of(contents.log, "N", r"force|load|kraft")
    if column is None or len(contents.log.rows) != contents.n_images or contents.n_images < 3:
        return ""
    force = np.asarray(contents.log.column(column), float)
    return f"by {column}" if abs(force[1] - force[0]) < MAX_RESTING_FORCE * np.ptp(force) else ""


def _scanner(scans: ScanFiles, contents: Found, place: PlaceInScan | None) -> str:
    sides = scans.voxel_mm
    if sides is not None:
        voxel = "# voxel_mm: " + " x ".join(f"{side:.6g}" for side in sides) + " mm, as the files state"
    elif place is not None:
        voxel = line(f"# voxel_mm = {place.side_mm[0]:.4g}", "FILL IN: this value lays the mesh on the specimen")
    else:
        voxel = line("# voxel_mm = 0.01", "FILL IN: the side of a voxel in mm")
    if place is not None:
        origin, comment = place.origin_px, "of the mesh origin: the sides of the mesh are those of the specimen"
        axes = [_AXES[k] for k in place.order]
    else:
        origin, comment, axes = _in_the_middle(scans, contents), "FILL IN: column, row, slice of the mesh origin", _AXES
    return "\n".join([
        line("[scanner]", "(column, row, slice) of a mesh point; voxel centres at integers"), voxel,
        line(f"origin_px = [{', '.join(f'{value:.1f}' for value in origin)}]", comment),
        line(f"axes = {json.dumps(list(axes))}", "of the volume along mesh x, y, z"
             + ("" if place is not None else ": FILL IN where they differ")),
        line("# air_below_gv = 60", "pores: where the smoothed reference is darker, nothing is compared"),
        line('# motion = "free"', "a rigid motion of every scan, for ends that are held or driven by a column"), ""])


def _in_the_middle(scans: ScanFiles, contents: Found) -> np.ndarray:
    """The origin (column, row, slice) with which the middle of the mesh is that of the volume."""
    middle_px = 0.5 * (np.array(scans.shape[::-1]) - 1.0)
    if contents.mesh is None or scans.voxel_mm is None:
        return middle_px
    nodes = contents.mesh.nodes
    return middle_px - 0.5 * (nodes.min(axis=0) + nodes.max(axis=0)) / scans.voxel_mm


def _boundary(contents: Found) -> Iterator[str]:
    if contents.mesh is None:
        yield "\n".join(['# [[boundary]]', '# nodes = "BOTTOM"            # FILL IN: the first layer of nodes',
                         '# u = "measured"', ""])
        return
    fixed_end, moving_end, component, lines = ends_of(contents)
    stroke = column_of(contents.log, "mm", r"disp|grip|stroke|extension|position|cross")
    lines += [f"# node sets of the mesh file: {', '.join(contents.mesh.node_sets) or 'none'}"]
    for end in (fixed_end, moving_end):
        lines += ["[[boundary]]", f"nodes = {json.dumps(end)}",
                  line('u = "measured"', "the motion of this end, found in the scans with the parameters"), ""]
    if stroke:
        lines.insert(len(lines) - 1, f"# or as logged: u{component} = {{ column = {json.dumps(stroke)} }}")
    yield "\n".join(lines)
    force = column_of(contents.log, "N", r"force|load|kraft")
    simulated = f'simulated = {{ reaction = {json.dumps(moving_end)}, component = "{component}" }}'
    comment = "" if force else "# "
    yield "\n".join([line(f"{comment}[[channel]]", "measured against simulated"),
                     f"{comment}column = {json.dumps(force or 'force_N')}", comment + simulated,
                     line("# noise_std = 5.0", "in the unit of the column"), ""])


def _facts(scans: ScanFiles, contents: Found, place: PlaceInScan | None) -> Iterator[str]:
    nz, ny, nx = scans.shape
    voxel = "no size of a voxel in the files" if scans.voxel_mm is None else " x ".join(
        f"{side:.6g}" for side in scans.voxel_mm) + " mm each"
    pattern = contents.images if isinstance(contents.images, str) else ", ".join(contents.images)
    yield (f"volumes      {pattern}: {scans.n_frames} of {nx} x {ny} x {nz} voxels (columns, rows, slices), {voxel}; "
           f"the reference is the first, {scans.labels[0]}")
    if contents.mesh is None:
        yield "mesh         no mesh file: mesh what the scans show of the specimen, in mm"
    else:
        yield f"mesh         {contents.mesh_file}: {contents.mesh.n_nodes} nodes, {contents.mesh.n_elements} elements"
        yield ("place        " + (
            "the sides of the mesh are those of the specimen in the scan: origin_px and axes lay it there; it may be "
            "mirrored or turned by 180 degrees" if place is not None else
            "no air around the specimen, or a mesh of other sides: origin_px lays it in the middle of the volume"))
    yield ("log          none: without a force only ratios of stiffness and strength can be identified"
           if contents.log is None else f"log          {contents.log_file}: columns {', '.join(contents.log.names)}; "
           f"{len(contents.log.rows)} rows for {contents.n_images} scans")
    yield ("to identify  E from 70 000 MPa and nu from 0.3 of the law elastic, typical of aluminium: replace them by "
           "the law of your material (idic laws) and starting values")
    yield from (f"note         {note}" for note in contents.notes)


_TAIL = """# [options]
# edge_margin_px = 3             # voxels along the surface of the mesh and of the mask that are not compared
# interpolation = "quintic"      # or cubic, which is three times as fast
"""
