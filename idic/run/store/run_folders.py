"""Where the experiments of a RUN lie: one in RUN itself, several in ``RUN/experiments/NAME``, each a whole RUN.

``RUN/joint.json`` names several experiments in their order.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from idic.inside import is_inside, way_inside
from idic.run.store.checkpoint import load_checkpoint, save_checkpoint
from idic.run.store.layout import DESCRIPTION, EXPERIMENTS

JOINT_FILE, SCHEMA = "joint.json", "idic.joint/1"
NO_LETTERS = re.compile(r"[^A-Za-z0-9_-]+")  # as in `schemas.description.Names`


@dataclass(frozen=True)
class RunFolders:
    """The folders of a RUN; parts : those of its experiments by their names, in their order."""

    run: Path
    parts: Mapping[str, Path]

    @classmethod
    def planned(cls, run: Path | str, experiments: Sequence[Path | str]) -> RunFolders:
        """Those of a RUN of these experiments (folder or experiment.toml)."""
        return cls._of_names(Path(run), experiment_names(experiments))

    @classmethod
    def _of_names(cls, run: Path, names: Sequence[str]) -> RunFolders:
        return cls(run, {name: run if len(names) == 1 else run / EXPERIMENTS / name for name in names})

    @property
    def below(self) -> dict[str, Path]:
        """The parts that are folders of their own: none where RUN itself is the only one."""
        return {name: folder for name, folder in self.parts.items() if folder != self.run}

    @property
    def begun(self) -> bool:
        """Whether a run has begun here: of one experiment that is prepared, or of several."""
        return os.path.lexists(self.run / (JOINT_FILE if self.below else DESCRIPTION))

    def write(self) -> None:
        """Name several experiments in ``RUN/joint.json``."""
        if self.below:
            save_checkpoint(self.run / JOINT_FILE, SCHEMA, {"names": list(self.parts)})


def folders_of(run: Path | str) -> dict[str, Path]:
    """The folders of the experiments of a RUN, by their names; of a single one RUN itself, without a name."""
    content = load_checkpoint(Path(run) / JOINT_FILE, SCHEMA)
    names = [""] if content is None else content["names"]
    folders = RunFolders._of_names(Path(run), names)
    return {name: way_inside(run, folder.relative_to(run)) if folder in folders.below.values() else folder
            for name, folder in folders.parts.items()}


def is_joint(run: Path | str) -> bool:
    """Whether a RUN folder holds several experiments that were identified together."""
    return is_inside(run, JOINT_FILE)


def experiment_names(paths: Sequence[str | Path]) -> list[str]:
    """Names of the experiments: those of their folders, numbered where two are alike."""
    names: list[str] = []
    for path in paths:
        path = Path(path).resolve()
        folder = path.parent if path.suffix == ".toml" else path
        stem = NO_LETTERS.sub("_", folder.name) or "experiment"
        number, name = 1, stem
        while name in names:
            number += 1
            name = f"{stem}_{number}"
        names.append(name)
    return names
