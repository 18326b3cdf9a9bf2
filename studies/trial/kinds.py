"""The kinds of effects of trials in drawn worlds, and which of them development never sees.

A hash of its name makes a kind *known* or *unseen*. Known kinds may be run at any time. Unseen ones are run by a frozen
campaign alone (`idic_studies.trial.seal`): the tool has a commit, and its files do not differ from it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

from idic_studies.trial.scenes.effects import EFFECTS, Effect
from idic_studies.trial.scenes.outside import OUTSIDE
from idic_studies.trial.scenes.setup import FURTHER_OUTSIDE, SETUP

SPLIT = "idic trial in worlds"  # beginning of what is hashed: another text is another split
MAX_UNSEEN_SHARE = 0.4
HIDDEN = ("poisson_ratio", "force_scale", "camera_motion")  # nulls of their own, or an unknown of every frame
LIBRARY: Mapping[str, Effect] = {name: effect for name, effect in (EFFECTS | SETUP).items() if name not in HIDDEN}
BEYOND: Mapping[str, Effect] = OUTSIDE | FURTHER_OUTSIDE


def is_unseen(kind: str) -> bool:
    """Whether a kind is kept from development."""
    first = hashlib.sha256(f"{SPLIT}: {kind}".encode()).digest()[:4]
    return int.from_bytes(first, "big") / 2**32 < MAX_UNSEEN_SHARE


def kind_named(kind: str) -> Effect:
    """The effect of a kind, of the library or beyond it."""
    return LIBRARY[kind] if kind in LIBRARY else BEYOND[kind] if kind in BEYOND else EFFECTS[kind]
