"""Parts of experiment.toml that `idic init` writes alike for images and volumes: log, materials, ends of the mesh."""

from __future__ import annotations

import json
import re

import numpy as np

from idic.experiment_file.initial.found import Found
from idic.fe import Mesh
from idic.readers import Log, parse_unit

_ENDS = (("BOTTOM", "TOP"), ("LEFT", "RIGHT"), ("FIXED", "MOVING"), ("FIX", "LOAD"), ("CLAMP", "PULL"))


def line(text: str, comment: str) -> str:
    return f"{text:<32} # {comment}"


def log_lines(contents: Found) -> list[str]:
    if contents.log is None:
        return [line('# loads = "loads.csv"', "one row per image, e.g. frame,time_s,force_N,grip_displacement_mm")]
    lines = [line(f"loads = {json.dumps(contents.log_file)}", f"columns: {', '.join(contents.log.names)}")]
    if len(contents.log.rows) != contents.n_images and contents.times_s is not None:
        lines.append(line(f"# {len(contents.log.rows)} rows for {contents.n_images} images, matched by their times:",
                           "FILL IN first_frame_s, the time of the first image in the log"))
    elif len(contents.log.rows) != contents.n_images:
        lines += [f"# FILL IN: {len(contents.log.rows)} rows for {contents.n_images} images; give the times of the "
                  "images:",
                  line("# frame_interval_s = 1.0", 'with first_frame_s; or image_times = "times.csv" (column time_s)')]
    return lines


def guessed_unit(mesh: Mesh) -> str:
    size = float(np.ptp(mesh.nodes, axis=0).max())
    return "m" if size < 0.5 else "mm"  # specimens are millimetres to decimetres long


def materials(contents: Found) -> str:
    names = list(contents.mesh.element_sets) if contents.mesh is not None else []
    covering = [name for name in names if len(contents.mesh.element_sets[name]) == contents.mesh.n_elements]
    chosen = covering[:1] or names or ["SPECIMEN"]
    parts = []
    for name in chosen:
        table = name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name)
        parts.append("\n".join([line(f"[material.{table}]", "one table per element set"),
                                line('law = "elastic"', "idic laws lists them all"),
                                'E = { value = 70e3, unit = "MPa", identify = true }   # FILL IN a first guess',
                                "nu = { value = 0.3, identify = true }", ""]))
    return "\n".join(parts)


def ends_of(contents: Found) -> tuple[str, str, str, list[str]]:
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
    lines = [line("[sets]", "the mesh names no opposite ends: by position, in the mesh unit"),
             f'{start} = {{ where = "{axis} < {low[k] + margin:.9g}" }}',
             f'{end} = {{ where = "{axis} > {high[k] - margin:.9g}" }}', ""]
    return start, end, axis, lines


def _free_name(name: str, names) -> str:
    return name if name not in names else f"{name}_"


def column_of(log: Log | None, unit: str, pattern: str) -> str | None:
    """The column of the log with this dimension and the best fitting name."""
    if log is None:
        return None
    powers = parse_unit(unit).powers
    fitting = [name for name in log.names if (column_unit := log.unit(name)) is not None
               and parse_unit(column_unit).powers == powers]
    return next((name for name in fitting if re.search(pattern, name, re.IGNORECASE)), fitting[0] if fitting else None)
