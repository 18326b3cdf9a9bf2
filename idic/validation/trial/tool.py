"""Which tool is on trial: its commit, whether its files were changed since, and the thresholds that it decides by."""

from __future__ import annotations

import subprocess
from importlib import import_module
from pathlib import Path

import idic

THRESHOLDS = {
    "idic.diagnose.screen.select": ("MAX_FAMILYWISE_P", "MIN_EFFECT_PX", "MIN_ROOM_SHARE", "MIN_CHANNEL_EFFECT_STD", "MIN_PROBE_Z", "MIN_SEPARATION_CHI2", "MAX_SHORTLIST",
                             "MIN_GAIN_SHARE", "MAX_HIDDEN_VISIBILITY"),
    "idic.diagnose.verdict": ("MIN_RECOVERED_SHARE", "MAX_EXCESS_LEFT", "MAX_LOCAL_EXCESS_LEFT", "MAX_INCLUSION_EXCESS_LEFT", "INCLUSION_MARGIN_PX", "MIN_EXCESS_Z",
                              "MIN_HELDOUT_DROP", "MIN_ACHIEVED_SHARE", "MIN_DROP_DIFFERENCE"),
    "idic.diagnose.residual.excess": ("MARGIN_PX",),
    "idic.diagnose.locate.mismatch": ("MAX_MISMATCH_P",),
    "idic.diagnose.residual.heldout": ("FREE_MOTION_SPACING",),
    "idic.run.diagnosis.chain": ("MAX_ROUNDS",),
    "idic.run.diagnosis.rivals": ("MIN_KEPT_SHARE", "MIN_PROMISE_SHARE"),
}


def tool() -> dict[str, object]:
    """commit ("" outside a repository), changed: whether files of the tool differ from it (None: not known), version,
    thresholds."""
    root = _git("rev-parse", "--show-toplevel")
    own = root is not None and Path(root) == Path(idic.__file__).resolve().parents[1]  # not somebody else's repository
    differs = _git("status", "--porcelain", "--", "idic", "flows") if own else None
    return {"version": idic.__version__, "commit": (_git("rev-parse", "HEAD") if own else None) or "",
            "changed": None if differs is None else bool(differs), "thresholds": thresholds()}


def thresholds() -> dict[str, float]:
    """The constants that decide, by module; one that a later version has no more is left out."""
    return {f"{module}.{name}": getattr(import_module(module), name)
            for module, names in THRESHOLDS.items() for name in names if hasattr(import_module(module), name)}


def _git(*arguments: str) -> str | None:
    try:
        done = subprocess.run(["git", *arguments], cwd=Path(idic.__file__).parents[1], capture_output=True, text=True,
                              timeout=20, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None
