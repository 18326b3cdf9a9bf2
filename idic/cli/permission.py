"""``--allow-external PROGRAM``: which programs an experiment may start, said by the person who starts idic."""

from __future__ import annotations

import os
from typing import Annotated, Optional

import typer

from idic.fe.external_process import PERMISSION


def _allow(programs: Optional[list[str]]) -> Optional[list[str]]:
    """Let this process and the workers that it starts run these programs (they inherit the environment)."""
    if programs:
        given = [name for name in os.environ.get(PERMISSION, "").split(os.pathsep) if name]
        os.environ[PERMISSION] = os.pathsep.join(dict.fromkeys([*given, *programs]))
    return programs


AllowExternal = Annotated[Optional[list[str]], typer.Option(
    "--allow-external", metavar="PROGRAM", callback=_allow,
    help="Program that [solver] of the experiment may start. May be repeated.")]
