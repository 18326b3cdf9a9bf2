"""The terms of the channels as candidates: what a term declares (`idic.model.terms`) is all that there is to say."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from functools import partial
from typing import Any

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import further_dofs
from idic.model import CHANNEL_TERMS, ChannelTerm


def variants(term: ChannelTerm, situation: Situation) -> tuple[Variant, ...]:
    """The probes of every channel, and of the loads that are applied."""
    proposals = []
    for number, channel in enumerate(situation.experiment.model.channels):
        for probe in term.probes(situation.experiment, channel):
            name = channel.dof(probe.name)
            edits = further_dofs(situation, name)
            if edits is not None:
                edits |= {"channel": _with_keys(situation, number, probe.keys)} if probe.keys else {}
                proposals.append(Variant(probe.label, edits, (name,), {name: probe.null}, {name: probe.value},
                                         sign=probe.sign, direct=True))
    for load in situation.experiment.model.loads:
        ends, name = term.load_probe(load), f"{load.stem}.{term.names[0]}"
        if ends is not None and (edits := further_dofs(situation, name)) is not None:
            proposals.append(Variant(f"{term.names[0]} of the {load.kind} on {load.edges}", edits, (name,),
                                     {name: ends[0]}, {name: ends[1]}))
    return tuple(proposals)


def _with_keys(situation: Situation, number: int, keys: Mapping[str, Any]) -> list[dict]:
    """The channels of the file, one of which has further keys."""
    tables = copy.deepcopy(list(situation.document["channel"]))
    tables[number] |= keys
    return tables


for _term in CHANNEL_TERMS:
    register(Candidate(_term.name, "force", _term.title, _term.null, _term.rivals, _term.separating_tests,
                       partial(variants, _term), paraphrase=_term.paraphrase, size=_term.size))
