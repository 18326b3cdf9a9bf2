"""What to do next where a record cannot tell models apart: their continuations simulated, or the library's advice."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from idic.diagnose.next_test import MIN_SEPARATING_CHI2, Model, Separation, recommended, separations
from idic.diagnose.refit import Refit, identification_at
from idic.diagnose.residual.residual_evidence import residual_evidence
from idic.errors import InputError, NotConverged
from idic.run.diagnosis.source import Source

MAX_SIMULATED = 3  # members of a set that are simulated


def next_experiment(members: Sequence[tuple[Source, Refit]]) -> str | None:
    """The cheapest continuation that tells the members of a set apart, in words; None where none could be simulated.

    Parameters
    ----------
    members : experiments with their candidates, and their refits
    """
    try:
        models = [_model(source, refitted) for source, refitted in members[:MAX_SIMULATED] if refitted.usable]
        pairs = [{t.words: t.D for t in separations(one, other)} for one, other in combinations(models, 2)]
    except (NotConverged, InputError):
        return None
    if not pairs:
        return None
    common = [Separation(words, min(pair[words] for pair in pairs)) for words in pairs[0]
              if all(words in pair for pair in pairs)]
    best = recommended(common)
    if best is None or best.D < 1.0:
        return None
    names = " and ".join(model.name.replace("_", " ") for model in models)
    if best.D < MIN_SEPARATING_CHI2:
        return (f"{best.words}: of what was simulated it tells {names} apart best, but not surely "
                f"(chi-square {best.D:.2g})")
    return f"{best.words}: it tells {names} apart (expected chi-square {best.D:.3g})"


def _model(source: Source, refitted: Refit) -> Model:
    found = identification_at(source.load(), refitted.values, refitted.local, refitted.steps)
    return Model(refitted.name, found, residual_evidence(found))
