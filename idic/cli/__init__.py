"""The commands. Nothing heavy is imported before a command runs: `idic --help` answers at once."""

from idic.cli import batch  # noqa: F401 - registers its command
from idic.cli.commands import main

__all__ = ["main"]
