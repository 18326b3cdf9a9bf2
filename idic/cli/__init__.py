"""The commands. Nothing heavy is imported before a command runs: `idic --help` answers at once."""

from idic.cli import (  # noqa: F401 - they register their commands
    batch,
    compare,
    diagnosis_commands,
    gallery_commands,
    systematic_commands,
    trial_commands,
)
from idic.cli.commands import main

__all__ = ["main"]
