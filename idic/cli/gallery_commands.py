"""`idic gallery`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from idic.cli.commands import app
from idic.cli.outcomes import outcome


@app.command()
def gallery(
    out: Annotated[Path, typer.Option(help="Folder for index.html and a folder per experiment.")],
    only: Annotated[
        list[str] | None, typer.Option(help="Only this experiment. May be repeated.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with an earlier gallery.")] = False,
) -> None:
    """Make six small experiments and their finished reports, to look at."""
    with outcome(run=out, resume=True):
        from idic.validation.studies.gallery import make_gallery

        page = make_gallery(out, only, resume, lambda text: typer.echo(text, err=True))
        typer.echo(f"{page} written")
