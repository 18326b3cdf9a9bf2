"""The table of strengths: at which amplitude an effect is faint, concealed, clear, and what the fit sees of it then.

``python -m idic.validation.trial.strengths`` measures it anew (minutes) and writes it beside this file. It is measured on one
strip; in a trial geometry, material and paint differ, so that the strength is met within a third or so.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Mapping, Sequence
from functools import lru_cache
from importlib import resources
from pathlib import Path

import numpy as np

from idic.errors import NotConverged
from idic.validation.trial.scenes.effects import EFFECTS, Effect
from idic.validation.trial.scenes.outside import OUTSIDE
from idic.validation.trial.scenes.recording import Paint
from idic.validation.trial.scenes.scene import NULLS, Geometry, plain_scene
from idic.validation.trial.strength import CLEAR, STRENGTHS, Bench, Seen, as_table, calibrated

TABLE = "strengths.json"
FIRST = 0.1  # amplitude that the search begins at
NO_ANSWER = Seen(1e6, 0.0, 0.0, 1e6)  # the simulation breaks down: too much


@lru_cache(maxsize=1)
def strengths() -> Mapping[str, Mapping[str, Mapping[str, float]]]:
    """{effect: {strength: {"amplitude", "seen", "hidden", "bias", "rise"}}}, as stored."""
    return json.loads(resources.files("idic.validation.trial").joinpath(TABLE).read_text(encoding="utf-8"))


def measured(bench: Bench, effect: Effect, wanted: Sequence[str] = STRENGTHS) -> dict[str, dict[str, float]]:
    """The entries of one effect."""
    def measure(a: float) -> Seen:
        try:
            return bench.measure(effect.change(bench.plain, a, np.random.default_rng(5)))
        except NotConverged:
            return NO_ANSWER

    found, start = {}, FIRST
    for strength in wanted:
        start, seen = calibrated(measure, strength, effect.most, start)
        found[strength] = as_table(start, seen)
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure effects, all or those named, and write the table."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--only", nargs="*", default=[])
    only = parser.parse_args(arguments).only
    path = Path(__file__).with_name(TABLE)
    table = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    effects = [e for e in (*EFFECTS.values(), *OUTSIDE.values()) if not only or e.name in only]
    for null in dict.fromkeys(effect.null for effect in effects):
        with tempfile.TemporaryDirectory() as folder:
            bench = Bench.of(plain_scene(null, Geometry(), NULLS[null].truth), Path(folder), Paint(1, 2))
        for effect in (e for e in effects if e.null == null):
            table[effect.name] = measured(bench, effect, STRENGTHS if effect.family else (CLEAR,))
            path.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
