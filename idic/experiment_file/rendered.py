"""An experiment folder without image files: the images come from a stack, everything else from the folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from idic.experiment_file.load import ExperimentFolder, Frames
from idic.experiment_file.toml_file import locate, read_toml, validated, with_overrides
from idic.images.stack import Stack
from idic.model.experiment import Experiment


def load_rendered(path: str | Path, stack: Stack, overrides: Mapping[str, object] | None = None) -> Experiment:
    """Read an experiment as `load_experiment` does, with `stack` for its images; its first frame is the reference."""
    file = locate(path)
    raw = with_overrides(read_toml(file), overrides)
    return _RenderedFolder(file, file.parent.resolve(), validated(raw, file), raw, stack).experiment()


@dataclass(frozen=True)
class _RenderedFolder(ExperimentFolder):
    stack: Stack

    def frames(self) -> Frames:
        labels = tuple(f"frame {k}" for k in range(self.stack.n_frames))
        return Frames(self.stack, labels, None, 0, (), (), None, self.mask(self.stack), ())

    def identity(self, frames: Frames) -> str:
        return ""
