"""The table of strengths: amplitude of every effect, faint, concealed and clear, and its figures there.

``python -m idic_studies.trial.strengths`` measures the table (minutes) and writes it beside this file. It holds for
one strip; geometry, material and texture of a trial differ, so a strength is met within about a third.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Mapping, Sequence
from functools import lru_cache
from importlib import resources
from pathlib import Path

from idic.errors import NotConverged
from idic_studies.trial.scenes.effects import EFFECTS, Effect
from idic_studies.trial.scenes.outside import OUTSIDE
from idic_studies.trial.scenes.recording import Paint
from idic_studies.trial.scenes.scene import NULLS, Geometry, plain_scene
from idic_studies.trial.strength import CLEAR, STRENGTHS, Bench, Seen, as_table, calibrated

TABLE = "strengths.json"
FIRST_AMPLITUDE = 0.1
NOT_CONVERGED = Seen(1e6, 0.0, 0.0, 1e6)  # of a simulation that breaks down: above every strength


@lru_cache(maxsize=1)
def strengths() -> Mapping[str, Mapping[str, Mapping[str, float]]]:
    """{effect: {strength: {"amplitude", "seen", "hidden", "bias", "rise"}}}, as stored."""
    return json.loads(resources.files("idic_studies.trial").joinpath(TABLE).read_text(encoding="utf-8"))


def measured(bench: Bench, effect: Effect, selected: Sequence[str] = STRENGTHS) -> dict[str, dict[str, float]]:
    """The entries of one effect."""
    def measure(a: float) -> Seen:
        try:
            return bench.measure_effect(effect, a)
        except NotConverged:
            return NOT_CONVERGED

    entries, start = {}, FIRST_AMPLITUDE
    for strength in selected:
        start, figures = calibrated(measure, strength, effect.most, start)
        entries[strength] = as_table(start, figures)
    return entries


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure all effects, or those of --only, and write the table."""
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
