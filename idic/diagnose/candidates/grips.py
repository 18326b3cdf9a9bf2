"""The corrections of a motion as candidates: what a term declares (`idic.model.terms`) is all that there is to say.

Terms of one cause are forms of one candidate.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import channel_unit, driven, with_correction
from idic.model import CORRECTION_TERMS, CorrectionTerm


def variants(terms: Sequence[CorrectionTerm], situation: Situation) -> tuple[Variant, ...]:
    """The probes of every motion that lacks these corrections."""
    motions = {(entry.nodes, entry.component): entry for entry in situation.experiment.model.prescribed}
    proposals = []
    for number, nodes, component, drive in driven(situation):
        kinds = [entry["kind"] for entry in drive.get("corrections", ())]
        for term in terms:
            name = f"boundary.{nodes}.{component}.{term.kind}"
            probes = () if term.kind in kinds else term.probes(situation.experiment, motions[nodes, component])
            for probe in probes:
                unit = channel_unit(situation, probe.keys["column"]) if term.reads_force else {}
                edits = with_correction(situation, number, component, {"kind": term.kind, **probe.keys, **unit})
                proposals.append(Variant(probe.label, edits, (name,), {name: 0.0}, {name: probe.value}, sign=probe.sign,
                                         exact=True))
    return tuple(proposals)


def rescaled(term: CorrectionTerm, variant: Variant, factor: float) -> Variant:
    """A variant with the scale that it holds times a factor."""
    (name,), tables = variant.new, copy.deepcopy(list(variant.edits["boundary"]))
    label, scale = variant.label, term.scale
    for table in tables:
        for component in "xyz":
            if name == f"boundary.{table.get('nodes')}.{component}.{term.kind}":
                entry = next(entry for entry in table[f"u{component}"]["corrections"] if entry["kind"] == term.kind)
                entry[scale.key] *= factor
                label = scale.label(table["nodes"], entry[scale.key], variant.label.rpartition(" ")[2])
    return replace(variant, label=label, edits=variant.edits | {"boundary": tables})


for _cause in dict.fromkeys(term.cause.name for term in CORRECTION_TERMS.values() if term.cause):
    _terms = [term for term in CORRECTION_TERMS.values() if term.cause and term.cause.name == _cause]
    _words, _scaled = _terms[0].cause, next((term for term in _terms if term.scale), None)
    register(Candidate(_words.name, "boundary", _words.title, _words.null, _words.rivals, _words.separating_tests,
                       partial(variants, _terms), has_onset=_words.has_onset, paraphrase=_words.paraphrase,
                       rescaled=_scaled and partial(rescaled, _scaled), size=_words.size))
