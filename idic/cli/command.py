"""A command of idic: its paths are those of the user's folder, its working folder is an empty one."""

from __future__ import annotations

import os
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperCommand

from idic.run import in_empty_folder

_user_folder: ContextVar[Path | None] = ContextVar("user_folder", default=None)  # where the running command was started


class Command(TyperCommand):
    """A command whose paths are absolute and whose working folder is empty: no file of a stranger configures it."""

    def invoke(self, ctx: typer.Context) -> Any:
        """Run the command."""
        with in_empty_folder() as began:
            ctx.params = {name: _absolute(value, began) for name, value in ctx.params.items()}
            token = _user_folder.set(began)
            try:
                return super().invoke(ctx)
            finally:
                _user_folder.reset(token)


class Program(typer.Typer):
    """A Typer program of such commands."""

    def command(self, name: str | None = None, **options: Any):
        return super().command(name, cls=Command, **options)


def user_path(path: Path | str) -> str:
    """A path for the terminal: relative where it lies in the user's folder."""
    path, user = Path(path), _user_folder.get()
    return str(path.relative_to(user)) if user is not None and path.is_relative_to(user) else str(path)


def _absolute(value: Any, folder: Path) -> Any:
    if isinstance(value, Path):
        return Path(os.path.normpath(folder / value))
    if isinstance(value, list | tuple):
        return type(value)(_absolute(entry, folder) for entry in value)
    return value
