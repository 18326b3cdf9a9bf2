"""Converts [solver] into `idic.fe.external.solver.ExternalSetup`; no program is started."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.experiment_file.schema.materials import MaterialTable
from idic.experiment_file.schema.options import SolverTable
from idic.fe import (
    ABAQUS_TYPES, EXTERNAL, ExternalSetup, LOG_FILE, REASON_FILE, check_environment, find_program, parse_deck,
)
from idic.model import Material
from idic.parameters import Parameter
from idic.readers import existing_file, factor_between, parse_unit

SUFFIX = ".template"
EXTERNAL_PERTURBATION = 1e-3  # files hold 5 to 7 digits and iterations stop early: a difference of 1e-4 is too small
MAX_DECK_BYTES = 100_000_000  # bytes
PLANE_STRAIN = {cell: name.replace("CPS", "CPE") for cell, name in ABAQUS_TYPES.items()}


def external_solver(config: ExperimentFile, folder: Path, file: Path) -> ExternalSetup | None:
    """The external solver of an experiment, or None.

    Raises
    ------
    InputError
        As `solver_setup`.
    """
    return None if config.solver is None else solver_setup(config.solver, folder, file, config.experiment.kind)


def check_external_laws(config: ExperimentFile, file: Path) -> None:
    """InputError where a material has an external law without an external solver."""
    if config.solver is not None:
        return
    for name, material in config.material.items():
        if material.law == EXTERNAL:
            raise InputError("an external law without an external solver", file=file, key=f"material.{name}.law",
                             expected="a table [solver], or a law that idic has", found=f'"{EXTERNAL}"',
                             remedy="choose a built-in law (idic laws lists them), or add [solver]: "
                             "docs/external-solver.md")


def solver_setup(table: SolverTable, folder: Path, file: Path, kind: str) -> ExternalSetup:
    """The external solver of an experiment.

    Raises
    ------
    InputError
        A file is missing or outside the folder, file names collide, a placeholder of deck or command is invalid, or an
        environment variable must not be set.
    """
    template = existing_file(folder, table.template, file=file, key="solver.template")
    files = tuple(existing_file(folder, name, file=file, key=f"solver.files[{number}]")
                  for number, name in enumerate(table.files))
    deck_file = template.name.removesuffix(SUFFIX)
    names = [deck_file, *(path.name for path in files), LOG_FILE, REASON_FILE, *([table.mesh] if table.mesh else [])]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError("two files of one name in the folder of a run", file=file, key="solver",
                         expected="template, files, mesh and log.txt under different names", found=", ".join(twice),
                         remedy="rename one of them")
    if template.stat().st_size > MAX_DECK_BYTES:
        raise InputError("the template is very large", file=template, expected=f"at most {MAX_DECK_BYTES / 1e6:g} MB",
                         found=f"{template.stat().st_size / 1e6:.0f} MB", remedy="move the mesh to a separate file")
    command = tuple(parse_deck(word, file) for word in table.command)
    for word in command:
        word.check({"job", "deck"})
    if command[0].names:
        raise InputError("the program name contains a placeholder", file=file, key="solver.command[0]",
                         expected="the name of a program", found=table.command[0],
                         remedy="write the name without a placeholder")
    check_environment(table.environment, file)
    types = (PLANE_STRAIN if kind == "plane_strain" else ABAQUS_TYPES) | table.element_types
    deck = parse_deck(_text(template), template)
    return ExternalSetup(file, deck, deck_file, command, table.reader, files, table.timeout_s, table.retries,
                         dict(table.environment), table.time, table.mesh, types)


def foreign_material(name: str, table: MaterialTable, file) -> tuple[Material, list[Parameter], list[str]]:
    """The record of a material of the external solver; its parameters have any names.

    Values are in mm, s, MPa, N. A parameter with a positive start value stays positive (logarithm) unless its bounds
    include negative values.
    """
    made = []
    for own, entry in table.parameters.items():
        factor = 1.0
        if entry.unit:
            factor_between(entry.unit, entry.unit, file=file, key=f"material.{name}.{own}.unit")  # it is a unit
            factor = parse_unit(entry.unit).factor
        value, prior = entry.value * factor, entry.prior
        low, high = (bound * factor for bound in entry.bounds or (-np.inf, np.inf))
        log = value > 0.0 and (entry.bounds is None or low >= 0.0)
        made.append(Parameter(f"{name}.{own}", value, entry.unit or "", entry.identify,
                              (max(low, 0.0) if log else low, high), None if prior is None else prior.mean * factor,
                              None if prior is None else prior.std * factor, "log" if log else "linear",
                              abs(value) or 1.0, factor))
    return Material(name, EXTERNAL, table.kinematics or "finite"), made, []


def solver_files(table: SolverTable | None, folder: Path) -> list[Path]:
    """Template and further files, for the identity of the experiment."""
    return [] if table is None else [folder / name for name in (table.template, *table.files)]


def solver_notes(setup: ExternalSetup | None) -> tuple[str, ...]:
    """Notes on the external solver for `check` and the report."""
    if setup is None:
        return ()
    try:
        place = find_program(setup.arguments[0], setup.experiment_file)
    except InputError:
        place = "not found on this machine"
    return (f"simulated by an external program: {' '.join(setup.arguments)} ({place}); it is started only with "
            f"--allow-external {setup.arguments[0]}",)


def _text(template: Path) -> str:
    try:
        return template.read_text(encoding="utf-8")
    except UnicodeDecodeError as problem:
        raise InputError("the template is not a text file", file=template, key="solver.template", expected="UTF-8 text",
                         found=str(problem), remedy="save it as UTF-8") from None
