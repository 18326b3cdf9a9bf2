"""A crack along the path that the residual asks for, with a length that grows between frames.

The path is found before the screening (`idic.diagnose.cut_mesh`): every model of the diagnosis has its elements, and
the identified one a crack of no length. So one Newton step is the whole answer of an elastic body to a crack of some
length, and lengths and growths are on a grid.
"""

from __future__ import annotations

import numpy as np

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register

SUSPECT = "suspect"  # name of the crack of no length in the identified model
LENGTH_SHARES = (0.2, 0.35, 0.5, 0.7)  # of the path: probes
FIRST_SHARES = (1.0, 0.5, 0.0)  # of the last length: that at the first knot


def variants(situation: Situation) -> tuple[Variant, ...]:
    proposals = []
    for crack in situation.experiment.model.cracks:
        if crack.name != SUSPECT:
            continue
        tables = [dict(table) for table in situation.document["crack"]]
        table = next(table for table in tables if table["name"] == SUSPECT)
        if set(crack.names) & set(situation.experiment.model.parameters.free):
            continue
        table["length_mm"] = {"value": 0.0, "identify": True}
        names, path = crack.names, float(crack.cut.place[-1])
        way = np.array(crack.knots, dtype=float)
        way = (way - way[0]) / max(float(np.ptp(way)), 1.0)
        for share in LENGTH_SHARES:
            for first in FIRST_SHARES[:1 if len(names) == 1 else None]:
                lengths = share * path * (first + (1.0 - first) * way)
                growth = "" if first == 1.0 else f" that grows from {lengths[0]:.3g}"
                proposals.append(Variant(f"a crack of {lengths[-1]:.3g} mm{growth}", {"crack": tables}, names,
                                         dict.fromkeys(names, 0.0), dict(zip(names, lengths.tolist(), strict=True)),
                                         sign=1, exact=True))
    return tuple(proposals)


register(Candidate(
    "crack", "heterogeneity", "crack", "no line across which the motion jumps",
    rivals={"heterogeneity": "a void or a soft spot opens as a crack does, and does not grow",
            "damage": "a band of damaged material opens, too: its strain is spread over its width",
            "plasticity": "a band of plastic flow stays after unloading"},
    separating_tests=("look at the specimen there with more magnification", "unload to zero once: a crack closes",
                      "load in another direction"),
    variants=variants, cuts_mesh=True,
    paraphrase="a cut with free faces that may grow"))
