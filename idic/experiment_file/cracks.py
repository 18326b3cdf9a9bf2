"""Converts [[crack]] into cuts of the mesh, records and parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idic.errors import InputError
from idic.experiment_file.schema.cracks import CrackTable
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.experiment_file.tables.boundaries import Context
from idic.experiment_file.tables.corrections import times_or_frames
from idic.fe import Cut, Mesh, cut_along
from idic.model import Crack
from idic.parameters import Parameter
from idic.readers import factor_between


@dataclass(frozen=True)
class CutMesh:
    """A mesh with its cuts, one per [[crack]]."""

    mesh: Mesh
    cuts: tuple[Cut, ...] = ()


def cut_mesh(config: ExperimentFile, mesh: Mesh, length_unit: str, file) -> CutMesh:
    """The mesh cut along the path of every crack.

    Raises
    ------
    InputError
        A solid or a cross-section, degrees of freedom of the geometry beside it, a name that is taken, lengths in px,
        or a path that does not fit the body.
    """
    if not config.crack:
        return CutMesh(mesh)
    _check_kind(config, mesh, length_unit, file)
    cuts: list[Cut] = []
    for number, table in enumerate(config.crack):
        if any(earlier.name == table.name for earlier in config.crack[:number]):
            raise InputError("two cracks of one name", file=file, key=f"crack[{number}].name",
                             expected="a name of its own", found=table.name, remedy="choose another name")
        nodes_of_cuts = np.array([node for cut in cuts for node in (*cut.left_nodes, *cut.right_nodes)], dtype=int)
        try:
            mesh, cut = cut_along(mesh, np.array(table.path_mm, dtype=float), nodes_of_cuts)
        except InputError as error:
            raise InputError(error.what, file=file, key=error.key or f"crack[{number}].path_mm",
                             expected=error.expected, found=error.found, remedy=error.remedy) from None
        cuts.append(cut)
    return CutMesh(mesh, tuple(cuts))


def _check_kind(config: ExperimentFile, mesh: Mesh, length_unit: str, file) -> None:
    table = config.experiment
    faults = {
        f"a model of {mesh.n_dim} dimensions seen from {table.surface or 'everywhere'}":
            mesh.n_dim != 2 or table.surface is not None or table.symmetry is not None,
        "a program of [solver]": config.solver is not None,
        'elements with mid-side nodes and element_order = "as_given"': config.options.element_order == "as_given"
            and any(block.connectivity.shape[1] > block.kind.n_corners for block in mesh.blocks),
        "lengths in px": length_unit != "mm",
        "degrees of freedom that move the mesh": any(entry.name.startswith("geometry.") and entry.name !=
                                                     "geometry.thickness" for entry in config.dof)}
    fault = next((words for words, holds in faults.items() if holds), None)
    if fault is not None:
        raise InputError("a crack in a model that cannot have one", file=file, key="crack",
                         expected="a sheet in mm (kind plane_stress or plane_strain), simulated by idic, without hole "
                         "or outline under [[dof]]", found=fault, remedy="leave [[crack]] out, or change the model")


def cracks(config: ExperimentFile, cuts: Sequence[Cut], context: Context) -> tuple[tuple[Crack, ...],
                                                                                   list[Parameter]]:
    """The cracks on their cuts, and the parameters of their lengths.

    Raises
    ------
    InputError
        A length beyond the path, a knot that is no frame after the reference, or a wrong unit.
    """
    records, parameters = [], []
    for number, (table, cut) in enumerate(zip(config.crack, cuts, strict=True)):
        key = f"crack[{number}]"
        outside = [frame for frame in table.knots if not context.reference <= frame < context.n_frames]
        if outside:
            raise InputError("a knot that is no frame", file=context.file, key=f"{key}.knots",
                             expected=f"{context.reference} … {context.n_frames - 1}", found=f"{outside[0]}",
                             remedy="correct the frame")
        times = times_or_frames(context)
        hats = np.array([np.interp(times, times[table.knots], row) for row in np.eye(len(table.knots))])
        records.append(Crack(table.name, cut, tuple(table.knots), hats if table.knots else np.ones((1, len(times)))))
        starts = table.lengths_mm or [None] * max(len(table.knots), 1)
        parameters += [_length(name, table, start, cut, key, context.file)
                       for name, start in zip(records[-1].names, starts, strict=True)]
    return tuple(records), parameters


def _length(name: str, table: CrackTable, start: float | None, cut: Cut, key: str, file) -> Parameter:
    entry = table.length_mm
    factor = factor_between(entry.unit, "mm", file=file, key=f"{key}.length_mm.unit") if entry.unit else 1.0
    value = entry.value * factor if start is None else start
    path_length = float(cut.place[-1])
    low, high = (0.0, path_length) if entry.bounds is None else (max(0.0, entry.bounds[0] * factor),
                                                           min(path_length, entry.bounds[1] * factor))
    if not low <= value <= high:
        raise InputError("a crack that is longer than its path, or has no length", file=file, key=f"{key}.length_mm",
                         expected=f"{low / factor:.4g} … {high / factor:.4g}", found=f"{value / factor:g}",
                         remedy="correct the length, or carry the path on")
    prior = entry.prior
    return Parameter(name, value, entry.unit or "mm", entry.identify, (low, high),
                     None if prior is None else prior.mean * factor, None if prior is None else prior.std * factor,
                     scale=0.2 * path_length, factor=factor)
