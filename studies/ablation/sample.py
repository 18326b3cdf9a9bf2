"""The frozen sample of an ablation: small drawn worlds of kinds that development may see.

::

    OUT/NAME/truth.json        the truth of a world
    OUT/motions/NAME.npz       motion and force of the solver
    OUT/NAME/public            the folder of the tool, without the truth

The worlds are those of the campaigns `worlds-known` of the seeds from `FIRST_SEED` on, in their order, whose images and
frames are few; every kind of an effect once per strength that is asked for.
"""

from __future__ import annotations

import json
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np

from idic.run import write_json
from idic_studies.trial.plan import KNOWN_WORLDS, Campaign, Trial, Truth, draw, paint_of, scene_of
from idic_studies.trial.scenes.recording import write_public
from idic_studies.trial.scenes.worlds import drawn_world
from idic_studies.trial.seal import Folder
from idic_studies.trial.trial import motion_of

FIRST_SEED = 59
MAX_COLUMNS_PX, MAX_FRAMES = 170, 22
QUOTA = {"clean": 4, "faint": 2, "concealed": 4, "clear": 2, "pairs": 2, "outside": 3}  # worlds of each class


def world_class(trial: Trial | Truth) -> str:
    """A key of `QUOTA`: the strength of a single effect, or the group."""
    return trial.effects[0][1] if trial.group == "singles" else trial.group


def is_small(trial: Trial, seed: int) -> bool:
    """Whether the world that is drawn first for a trial is small (`plan.draw` draws it in the same way)."""
    rng = np.random.default_rng([seed, zlib.crc32(trial.key.encode())])
    world = drawn_world(rng, [name for name, _ in trial.effects], trial.null)
    return world["columns"] < MAX_COLUMNS_PX and world["frames"] <= MAX_FRAMES


def chosen_trials() -> Iterator[tuple[int, Trial]]:
    """Seed and trial of every world of the sample."""
    number, kinds, nulls = Counter[str](), set(), Counter[str]()
    for seed in count(FIRST_SEED):
        for trial in Campaign(KNOWN_WORLDS, seed).trials:
            name, kind = world_class(trial), tuple(kind for kind, _ in trial.effects)
            if number[name] >= QUOTA[name] or (kind and kind in kinds) or not is_small(trial, seed):
                continue
            if not kind and nulls[trial.null] >= 2:
                continue
            number[name] += 1
            nulls[trial.null] += not kind
            kinds.add(kind)
            yield seed, trial
        if all(number[name] >= quota for name, quota in QUOTA.items()):
            return


def drawn_truth(trial: Trial, seed: int) -> Truth:
    """The truth of a trial, by CalculiX only where the body is solid: CalculiX takes minutes for plane yielding."""
    truth = draw(trial, seed)
    return truth if scene_of(truth).solid else replace(truth, solver="built-in")


def name_of(seed: int, trial: Trial) -> str:
    """The name of a world: a folder."""
    return f"{seed}-{trial.key.replace('/', '-')}"


def draw_sample(out: Path) -> Iterator[str]:
    """Draw the worlds that are not drawn yet; yields the name of each."""
    for seed, trial in chosen_trials():
        name = name_of(seed, trial)
        if not (out / name / "truth.json").exists():
            truth = drawn_truth(trial, seed)
            write_public(public(out, name), scene_of(truth), motion_of(Folder(out), name, truth), paint_of(truth))
            write_json(out / name / "truth.json", truth.content)
        yield name


def names(out: Path) -> list[str]:
    """The worlds that are drawn, in the order of the sample."""
    return [name for name in (name_of(seed, trial) for seed, trial in chosen_trials())
            if (out / name / "truth.json").exists()]


def public(out: Path, name: str) -> Path:
    """The folder of the tool."""
    return out / name / "public"


def truth_of(out: Path, name: str) -> Truth:
    """The truth of a world."""
    return Truth.read(json.loads((out / name / "truth.json").read_text(encoding="utf-8")))
