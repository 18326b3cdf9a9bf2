"""What an experiment may start, said by the person who starts idic: ``--allow-external PROGRAM``, ``--laws FILE``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from idic.fe.external.process import PERMISSION

LAW_FILES = "IDIC_LAWS"  # read by idic.materials.core.user_laws, which must not be imported before it is set


def _allow(programs: list[str] | None) -> list[str] | None:
    """Let this process and the workers that it starts run these programs (they inherit the environment)."""
    if programs:
        given = [name for name in os.environ.get(PERMISSION, "").split(os.pathsep) if name]
        os.environ[PERMISSION] = os.pathsep.join(dict.fromkeys([*given, *programs]))
    return programs


AllowExternal = Annotated[list[str] | None, typer.Option(
    "--allow-external", metavar="PROGRAM", callback=_allow,
    help="Program that [solver] of the experiment may start. May be repeated.")]


def _name_laws(files: list[str] | None) -> list[str] | None:
    """Let this process and the workers that it starts know the laws of these files."""
    if files:
        given = [name for name in os.environ.get(LAW_FILES, "").split(os.pathsep) if name]
        named = [str(Path(file).resolve()) for file in files]
        os.environ[LAW_FILES] = os.pathsep.join(dict.fromkeys([*given, *named]))
    return files


LawFiles = Annotated[list[str] | None, typer.Option(
    "--laws", metavar="FILE", callback=_name_laws,
    help="Python file with constitutive laws of your own (docs/add-a-law.md). May be repeated.")]
