"""From [solver] to `idic.fe.external.solver.ExternalSetup`; its files are read, nothing is started."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.experiment_file.schema import ExperimentFile
from idic.experiment_file.schema_materials import MaterialTable
from idic.experiment_file.schema_options import SolverTable
from idic.fe.external.deck import parse_deck
from idic.fe.external.inp_writer import ABAQUS_TYPES
from idic.fe.external.process import LOG_FILE, check_environment, find_program
from idic.fe.external.solver import EXTERNAL, REASON_FILE, ExternalSetup
from idic.model.experiment import Material
from idic.parameters import Parameter
from idic.readers.paths import existing_file
from idic.readers.units import factor_between, parse_unit

SUFFIX = ".template"
EXTERNAL_PERTURBATION = 1e-3  # files hold 5 to 7 digits, iterations stop early: differences of 1e-4 would drown in that
MAX_DECK_BYTES = 100_000_000  # bytes
PLANE_STRAIN = {cell: name.replace("CPS", "CPE") for cell, name in ABAQUS_TYPES.items()}


def external_solver(config: ExperimentFile, folder: Path, file: Path) -> ExternalSetup | None:
    """The external solver of an experiment, where it has one.

    Raises
    ------
    InputError
        As `solver_setup`; or a material that only an external solver knows, but there is none.
    """
    if config.solver is not None:
        return solver_setup(config.solver, folder, file, config.experiment.kind)
    for name, material in config.material.items():
        if material.law == EXTERNAL:
            raise InputError("an external law, but no external solver", file=file, key=f"material.{name}.law",
                             expected="a table [solver], or a law that idic has", found=f'"{EXTERNAL}"',
                             remedy="idic laws lists the built-in ones; docs/external-solver.md shows [solver]")
    return None


def solver_setup(table: SolverTable, folder: Path, file: Path, kind: str) -> ExternalSetup:
    """The external solver of an experiment.

    Raises
    ------
    InputError
        A file that is not there or lies outside the folder, names that collide, a place in the deck or the command that
        is none, a variable that must not be set.
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
                         found=f"{template.stat().st_size / 1e6:.0f} MB", remedy="put the mesh in a file of its own")
    command = tuple(parse_deck(word, file) for word in table.command)
    for word in command:
        word.check({"job", "deck"})
    if command[0].names:
        raise InputError("the program depends on the job", file=file, key="solver.command[0]",
                         expected="the name of a program", found=table.command[0], remedy="write it out")
    check_environment(table.environment, file)
    types = (PLANE_STRAIN if kind == "plane_strain" else ABAQUS_TYPES) | table.element_types
    deck = parse_deck(_text(template), template)
    return ExternalSetup(file, deck, deck_file, command, table.reader, files, table.timeout_s, table.retries,
                         dict(table.environment), table.time, table.mesh, types)


def foreign_material(name: str, table: MaterialTable, file) -> tuple[Material, list[Parameter], list[str]]:
    """The record of a material that only the external solver knows; its parameters have any names.

    Values are in mm, s, MPa, N. A positive start value stays positive (logarithm), unless bounds below zero say that it
    need not.
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
    """Template and further files: they decide the result."""
    return [] if table is None else [folder / name for name in (table.template, *table.files)]


def solver_notes(setup: ExternalSetup | None) -> tuple[str, ...]:
    """What `check` and the report say of it."""
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
        raise InputError("the template is no text", file=template, key="solver.template", expected="UTF-8 text",
                         found=str(problem), remedy="save it as UTF-8") from None
