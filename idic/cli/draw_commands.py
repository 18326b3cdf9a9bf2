"""`idic draw`: a local page to draw the mesh, write experiment.toml and identify."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from idic.cli.app import app
from idic.cli.outcomes import abandon, outcome


@app.command()
def draw(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder with images and, if there is one, a log.")],
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of this machine; 0: a free one.")] = 0,
    browser: Annotated[bool, typer.Option(help="--no-browser: only print the address.")] = True,
) -> None:
    """Draw the mesh on the reference image in a browser, write experiment.toml and identify."""
    with outcome():
        import webbrowser

        from idic.draw import HOST, list_folder, new_token, open_socket, serve

        cameras = list_folder(folder).cameras
        if cameras:
            typer.echo(f"note     {' and '.join(cameras)} hold equally many images: the page draws on one camera. "
                       "For several cameras of one test: idic init, then a [[camera]] table for each "
                       "(docs/cameras.md)")
        place, token = open_socket(port), new_token()
        address = f"http://{HOST}:{place.getsockname()[1]}/{token}/"
        typer.echo(f"page     {address}\nOnly this machine can open it. Ctrl-C ends the page; a run that it started "
                   "continues.")
        if browser:
            webbrowser.open(address)
        serve(folder.resolve(), place, token, abandon)
