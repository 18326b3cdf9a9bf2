"""What every term of the measuring chain has to keep: absent at its null, exact derivatives, a candidate of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from identify.twin_bodies import experiment

from idic.diagnose import candidate_library
from idic.model import CHANNEL_TERMS, Column, Load, channel_term, knot_name, shown_value
from idic.parameters import ParameterSet

FORCE, FRAME = 7.0, 3
DIFFERENCE = 1e-6  # relative; terms are at most quadratic, so that central differences leave rounding alone


def plate():
    """A plate whose channel has courses of friction and drift that the data give."""
    body = experiment()
    n = body.model.n_frames
    hat = np.linspace(0.0, 1.0, n)
    stems = [term.course.stem for term in CHANNEL_TERMS if term.course]
    channel = replace(body.model.channels[0], hats={knot_name(stem, n - 1): hat for stem in stems})
    return replace(body, model=replace(body.model, channels=(channel,)))


def with_terms(body, shares, terms):
    """The parameters of terms, away from their nulls by shares of their scales."""
    unknowns = [parameter for term in terms
                for parameter in term.parameters(body.model.channels[0], body.model.times, body.model.prescribed)]
    values = [replace(p, value=p.value + share * p.scale) for p, share in zip(unknowns, shares, strict=False)]
    return ParameterSet(values)


def shown(body, parameters, force=FORCE):
    return shown_value(body, body.model.channels[0], parameters, FRAME, force)


@pytest.mark.parametrize("term", CHANNEL_TERMS, ids=lambda term: term.name)
def test_a_term_is_absent_at_its_null(term):
    body = plate()
    chain = shown(body, with_terms(body, np.zeros(20), (term,)))
    assert (chain.value, chain.slope) == (FORCE, 1.0)


@pytest.mark.parametrize("terms", [*((term,) for term in CHANNEL_TERMS), CHANNEL_TERMS],
                         ids=lambda terms: terms[0].name if len(terms) == 1 else "chain")
def test_terms_have_exact_derivatives_alone_and_in_their_chain(terms):
    body = plate()
    parameters = with_terms(body, np.linspace(0.3, 0.9, 20), terms)
    chain, h = shown(body, parameters), DIFFERENCE * FORCE
    assert set(parameters) <= set(chain.by_name)
    quotient = (shown(body, parameters, FORCE + h).value - shown(body, parameters, FORCE - h).value) / (2 * h)
    assert chain.slope == pytest.approx(quotient, rel=1e-7)
    for name, known in parameters.items():
        above, below = (shown(body, parameters.with_values({name: known.value + sign * DIFFERENCE * known.scale})).value
                        for sign in (1.0, -1.0))
        quotient = (above - below) / (2 * DIFFERENCE * known.scale)
        assert chain.by_name[name] == pytest.approx(quotient, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("term", CHANNEL_TERMS, ids=lambda term: term.name)
def test_a_term_is_a_candidate_with_words_and_probes(term):
    body = plate()
    candidates = {candidate.name: candidate for candidate in candidate_library()}
    candidate = candidates[term.name]
    assert candidate.side == "force" and candidate.title == term.title and candidate.separating_tests
    assert set(term.rivals) <= set(candidates)
    unknowns = {parameter.name for parameter in term.parameters(body.model.channels[0], body.model.times,
                                                                body.model.prescribed)}
    for probe in term.probes(body, body.model.channels[0]):
        assert body.model.channels[0].dof(probe.name) in unknowns and probe.value != probe.null
    assert all(channel_term(name) is term for name in term.names)


@pytest.mark.parametrize("term", [term for term in CHANNEL_TERMS if term.course], ids=lambda term: term.name)
def test_a_course_is_given_for_every_degree_of_freedom_of_its_term(term):
    body = plate()
    knot = knot_name(term.course.stem, body.model.n_frames - 1)
    for name in (*term.names, knot):
        assert term.course.amplitude(body, body.model.channels[0], name).shape == (body.model.n_frames,)
    assert term.course.amplitude(body, body.model.channels[0], knot_name(term.course.stem, 1)) is None


def test_scale_and_offset_are_probed_on_applied_loads_too():
    load = Load("TOP", "pressure", Column("p", np.array([0.0, 2.0])))
    assert {term.name: term.load_probe(load) for term in CHANNEL_TERMS if term.load_probe(load)} == {
        "force_scale": (1.0, 1.02), "force_offset": (0.0, 0.04)}
