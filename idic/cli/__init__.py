"""The commands. Nothing heavy is imported before a command runs: `idic --help` answers at once."""

from idic.cli import (  # noqa: F401 - they register their commands
    batch_commands,
    calibration_commands,
    diagnosis_commands,
    draw_commands,
    experiment_commands,
    identify_commands,
    result_commands,
    studies_commands,
)
from idic.cli.app import main

__all__ = ["main"]
