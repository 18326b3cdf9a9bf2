"""The program `idic`: its entry point, and the options that several commands share."""

from __future__ import annotations

import io
import os
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer.core import TyperGroup

from idic.cli.command import Program
from idic.cli.outcomes import DONE, INTERRUPTED, NOT_CONVERGED
from idic.errors import InputError
from idic.fe import PERMISSION
from idic.run import use_one_thread

if TYPE_CHECKING:
    from idic.run import Orchestrator

ORDER = ("demo", "draw", "calibrate", "init", "check", "design", "identify", "systematic", "diagnose", "compare",
         "report", "fields", "clean", "batch", "simulate", "example", "gallery", "laws", "physics", "study",
         "trial")  # of a user's work, for --help
LAW_FILES = "IDIC_LAWS"  # read by idic.laws.core.user_laws, which must not be imported before it is set
PIPE_COLUMNS = 140  # width of a table that goes to a file or a pipe


class ByWorkflow(TyperGroup):
    """The commands in the order of a user's work."""

    def list_commands(self, ctx: typer.Context) -> list[str]:
        return sorted(self.commands, key=lambda name: ORDER.index(name) if name in ORDER else len(ORDER))


app = Program(
    name="idic",
    cls=ByWorkflow,
    no_args_is_help=True,
    add_completion=True,  # idic --install-completion
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    epilog="Start with:  idic demo",
)


def main() -> None:
    """Entry point of the command ``idic``."""
    use_one_thread()
    for stream in (sys.stdout, sys.stderr):
        never_fail_on_a_letter(stream)
    app()


def never_fail_on_a_letter(stream) -> None:
    """Print "?" for a letter that a terminal or pipe of another encoding (latin-1, cp1252) does not have."""
    if isinstance(stream, io.TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
        stream.reconfigure(errors="replace")


# options ------------------------------------------------------------------------------------------
class Sensitivity(StrEnum):
    direct = "direct"
    perturbed = "perturbed"
    auto = "auto"


def _allow(programs: list[str] | None) -> list[str] | None:
    """Let this process and its workers, which inherit the environment, start these programs."""
    if programs:
        permitted_programs = [name for name in os.environ.get(PERMISSION, "").split(os.pathsep) if name]
        os.environ[PERMISSION] = os.pathsep.join(dict.fromkeys([*permitted_programs, *programs]))
    return programs


def _name_laws(files: list[str] | None) -> list[str] | None:
    """Let this process and its workers import the laws of these files."""
    if files:
        earlier_files = [name for name in os.environ.get(LAW_FILES, "").split(os.pathsep) if name]
        new_files = [str(Path(file).resolve()) for file in files]
        os.environ[LAW_FILES] = os.pathsep.join(dict.fromkeys([*earlier_files, *new_files]))
    return files


Experiment = Annotated[Path, typer.Argument(metavar="EXPERIMENT", help="Experiment folder, or its experiment.toml.",
                                            show_default=False)]
Run = Annotated[Path, typer.Argument(metavar="RUN", help="Folder written by idic identify.")]
Workers = Annotated[int | None, typer.Option(
    min=0, metavar="N", help="Number of worker processes; 0: this process only [default: one per core; "
                             "none for a small identification].")]
MemoryLimit = Annotated[str | None, typer.Option(
    metavar="SIZE", help="Memory of each worker process, e.g. 2GB [default: an equal part of the machine's].")]
Scheduler = Annotated[str | None, typer.Option(metavar="ADDRESS", help="Address of an existing Dask scheduler.")]
FileStore = Annotated[str | None, typer.Option(
    "--store", metavar="URL", envvar="IDIC_STORE",
    help="Workers of the scheduler do not see this disk: files go through s3://bucket/prefix (any URL of fsspec), or "
         "\"driver\".")]
RefusedStore = Annotated[str | None, typer.Option("--store", envvar="IDIC_STORE", hidden=True)]
UsePrefect = Annotated[bool | None, typer.Option(
    "--prefect/--no-prefect",
    help="A Prefect flow, and a server whose pages show it [default: where a terminal shows the address of the pages, "
         "or PREFECT_API_URL names a server].", show_default=False)]
SensitivityOption = Annotated[Sensitivity, typer.Option(
    help="direct: derivatives of the equilibrium; perturbed: one simulation per parameter.")]
Bits = Annotated[int, typer.Option(help="Depth of the images: 8, 12 or 16 bit.")]
Seed = Annotated[int, typer.Option(min=0, help="Seed of the random speckle and noise.")]
Overrides = Annotated[list[str] | None, typer.Option(
    "--set", metavar="KEY=VALUE", help="Replaces a value of experiment.toml. May be repeated.")]
AllowExternal = Annotated[list[str] | None, typer.Option(
    "--allow-external", metavar="PROGRAM", callback=_allow,
    help="Permits [solver] of the experiment to start this program. May be repeated.")]
LawFiles = Annotated[list[str] | None, typer.Option(
    "--laws", metavar="FILE", callback=_name_laws,
    help="Python file with your own constitutive laws (docs/add-a-law.md). May be repeated.")]


def _show_version(is_asked: bool) -> None:
    if is_asked:
        import idic

        typer.echo(f"idic {idic.__version__}")
        raise typer.Exit(DONE)


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit.")
    ] = False,
    laws: LawFiles = None,
) -> None:
    """Time-resolved integrated digital image correlation: images and force in, constitutive parameters out."""


def read_overrides(pairs: list[str] | None) -> dict[str, str]:
    """``["a.b=1", ...]`` as a mapping; the value is read later, as TOML where it can be."""
    overrides = {}
    for pair in pairs or ():
        key, equals, value = pair.partition("=")
        if not equals or not key.strip():
            raise InputError("not a setting", key="--set", expected="KEY=VALUE, e.g. options.max_iterations=20",
                             found=pair, remedy="write key, equals sign and value without spaces")
        overrides[key.strip()] = value.strip()
    return overrides


def orchestrator_of(prefect: bool) -> Orchestrator:
    """The orchestrator of a command: a Prefect flow; with ``--no-prefect`` this process alone."""
    if prefect:
        from idic_flows.orchestrator import PrefectFlow

        return PrefectFlow()
    from idic.run import DIRECT

    return DIRECT


def is_watched(prefect: bool | None) -> bool:
    """Whether a command runs as a Prefect flow: as the option says; without it where somebody can look at its pages."""
    if prefect is not None:
        return prefect
    from idic.run import configured_url

    if sys.stderr.isatty() or configured_url() is not None:
        return True
    typer.echo("no Prefect pages: no terminal shows their address; --prefect starts them", err=True)
    return False


def exit_code(status: str) -> int:
    """The exit code that belongs to the status of a result."""
    return {"converged": DONE, "interrupted": INTERRUPTED}.get(status, NOT_CONVERGED)


def wide_console():
    """A console that keeps the lines of a table whole in a pipe or a file."""
    from rich.console import Console

    console = Console(markup=False, emoji=False)
    return console if console.is_terminal else Console(width=PIPE_COLUMNS, markup=False, emoji=False)


def terminal(stderr: bool = False):
    """A console for lines of any length; brackets in a path, a name or a message are no markup."""
    from rich.console import Console

    return Console(stderr=stderr, soft_wrap=True, markup=False, emoji=False)
