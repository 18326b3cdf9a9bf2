"""What a diagnosis reports of its mismatch and its candidates: place in words, active elements, form of an
inclusion."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import stats

from idic.diagnose.diagnosis import Diagnosis
from idic.diagnose.locate.active_elements import Activity
from idic.diagnose.locate.mismatch_words import MOTION, mismatch_words
from idic.diagnose.locate.place import clusters, element_centres, in_words
from idic.diagnose.residual.excess_left import effect
from idic.diagnose.screen.local_residual import new_inclusions
from idic.diagnose.screen.select import MAX_FAMILYWISE_P, Ranked
from idic.diagnose.selection.rival import Rival, winners
from idic.fe import Mesh
from idic.identification import p_text

MAX_PLACE_SHARE = 0.5  # of the elements: a larger source is the whole body
MIN_CLUSTER_SHARE = 0.3  # of the largest cluster's elements: a cluster that is reported on its own
MAX_PLACES = 3  # that are reported


def mismatch_content(diagnosis: Diagnosis) -> dict:
    """The entry ``mismatch`` of diagnosis.json: side, onset, place; null where nothing could be located.

    The side is that of the first cause, if there is one. ``elements`` are those in which a selected law of
    yielding, flow or damage acts in the enriched model; ``pushing_elements`` are the source elements of the residual.
    ``p_value`` counts two families of tests (Bonferroni): the location and the screening.
    """
    selected = diagnosis.selected_effect
    if diagnosis.mismatch is None:
        misfit = diagnosis.identified.misfit
        keys = ("side", "onset_frame", "onset_ci", "visible_frame", "centroid_mm", "frames")
        content: dict[str, Any] = dict.fromkeys(keys) | {
            "elements": [], "effect_px_rms": effect(misfit, diagnosis.state.power),
            "p_value": float(stats.chi2.sf(misfit.gain.sum(), misfit.rank.sum()))}
    else:
        content = diagnosis.mismatch.content(selected)
    content["located_side"] = content["side"]
    content["side"] = selected.side if selected else content["side"]
    p_values = [content["p_value"], *(r.p_familywise for r in diagnosis.rounds[0].screening.ranked)]
    content["p_value"] = min(1.0, 2.0 * min(p_values))
    figure = "figures/diagnosis_where.png" if content["elements"] else None
    content["pushing_elements"] = content["elements"]
    if diagnosis.active is not None:
        content["elements"] = _labels(diagnosis, diagnosis.active.since >= 0)
    found_by = shown_by(diagnosis)
    words = mismatch_words(diagnosis.mismatch, selected, found_by and f"{_titles(diagnosis)} by {found_by}",
                           unexplained(diagnosis), diagnosis.identification.experiment.model.length_unit)
    centre = inclusion_elsewhere(diagnosis)
    of_inclusion = () if centre is None else (
        f"The fitted inclusion lies at {centre}: the strongest sources are around it, where the identified "
        "parameters have taken a part of it.",)
    return content | {"place": place_in_words(diagnosis), "figure": figure, "active": _active(diagnosis),
                      "located": None if diagnosis.mismatch is None else diagnosis.mismatch.is_significant,
                      "shown_by": found_by, "words": [*words, *of_inclusion]}


def shown_by(diagnosis: Diagnosis) -> str | None:
    """What shows the selected candidates where free motions show no mismatch; None where they do, and without one.

    A pattern is one unknown or a few: it sees less than free motions need.
    """
    won = winners(diagnosis.rounds)
    if not won or diagnosis.mismatch is None or diagnosis.mismatch.is_significant:
        return None
    weakest = max(rival.ranked.p_familywise for rival in won)
    if weakest < MAX_FAMILYWISE_P:
        return f"{'its own pattern' if len(won) == 1 else 'their own patterns'} (family-wise p {p_text(weakest)})"
    drop = sum(rival.heldout for rival in won)
    return f"{'its refit' if len(won) == 1 else 'their refits'} (held-out drop of chi-square {drop:.3g})"


def _titles(diagnosis: Diagnosis) -> str:
    """Selected candidates in standard words, with their verb: "grip slip shows"."""
    titles = [winner.ranked.candidate.title for winner in winners(diagnosis.rounds)]
    return f"{' and '.join(titles)} {'shows' if len(titles) == 1 else 'show'}"


def unexplained(diagnosis: Diagnosis) -> tuple[str, ...]:
    """What forbids a verdict of causes alone: `MOTION`, columns of channels; () unless it is outside_library.

    Without a candidate, a mismatch on the side of the force is one of readings.
    """
    verdict, mismatch = diagnosis.verdict, diagnosis.mismatch
    parts = list(verdict.in_channels)
    of_force = mismatch is not None and mismatch.side == "force" and not verdict.selected
    if of_force and not parts:
        parts = [channel.column for channel in diagnosis.remainder.channels if channel.is_significant] or [
            channel.column for channel in diagnosis.remainder.channels]
    return (*([MOTION] if verdict.in_motions and not of_force else []), *parts)


def _active(diagnosis: Diagnosis) -> dict | None:
    """Elements in which the selected law acts, and since when; labels of the mesh file."""
    active = diagnosis.active
    if active is None:
        return None
    return {"verb": active.verb, "first_frame": active.first_frame, "elements": int((active.since >= 0).sum()),
            "of": diagnosis.identification.experiment.model.mesh.n_elements,
            "first_elements": _labels(diagnosis, active.first),
            "first_mm": first_active_place(diagnosis.identification.experiment.model.mesh, active)}


def _labels(diagnosis: Diagnosis, elements: np.ndarray) -> list[int]:
    return list(diagnosis.identification.experiment.model.mesh.labels_of(elements))


def place_in_words(diagnosis: Diagnosis) -> str | None:
    """Place of the mismatch where it is a part of the body; None for the whole body and for no place."""
    mismatch = diagnosis.mismatch
    if mismatch is None or mismatch.place is None or not mismatch.has_place(diagnosis.selected_effect):
        return None
    if _everywhere(diagnosis):
        return None
    if centre_text := inclusion_elsewhere(diagnosis):
        return f"around {centre_text}"
    mesh, unit = diagnosis.identification.experiment.model.mesh, diagnosis.identification.experiment.model.length_unit
    if len(mismatch.elements) > MAX_PLACE_SHARE * mesh.n_elements:
        return (None if diagnosis.active is None else
                f"first at {in_words(first_active_place(mesh, diagnosis.active), size=mesh.size)} {unit}")
    parts = clusters(mesh, mismatch.place.elements)
    centres = [element_centres(mesh)[part].mean(axis=0) for part in parts
               if len(part) > MIN_CLUSTER_SHARE * len(parts[0])]
    points = [in_words(centre, size=mesh.size) for centre in centres[:MAX_PLACES]]
    return f"around {' and '.join(points)} {unit}" + (" and elsewhere" if len(centres) > MAX_PLACES else "")


def inclusion_elsewhere(diagnosis: Diagnosis) -> str | None:
    """Centre of the inclusion that is the first cause, where it touches no source element; None elsewhere.

    A stiff inclusion whose mean the identified modulus has taken leaves a body that is too soft around it: the sources
    then are the ends of the bar, and only refits tell the two apart.
    """
    first, mismatch = diagnosis.first_cause, diagnosis.mismatch
    if (first is None or first.winner is None or first.winner.ranked.variant.form != "inclusion" or mismatch is None
            or mismatch.place is None):
        return None
    identified, fitted = diagnosis.identification.experiment, diagnosis.state.final or diagnosis.state.model
    model, n_axes = identified.model, 3 if identified.recording.quantity == "volume" else 2  # images show no depth
    sources = element_centres(model.mesh)[mismatch.place.elements][:, :n_axes]
    for centre, radius in new_inclusions(identified, fitted.source.load(), fitted.fit.values):
        if np.linalg.norm(sources - centre[:n_axes], axis=1).min() > radius:
            return f"{in_words(centre[:n_axes], size=model.mesh.size)} {model.length_unit}"
    return None


def _everywhere(diagnosis: Diagnosis) -> bool:
    first, effect = diagnosis.first_cause, diagnosis.selected_effect
    winner = None if first is None else first.winner
    return effect is not None and effect.from_start and winner is not None and acts_everywhere(winner.ranked)


def acts_everywhere(ranked: Ranked) -> bool:
    """Whether a candidate that acts from the start has no place on the body: a law, a stiffness gradient, layers.

    An inclusion has a place, and so has a grip.
    """
    return not ranked.candidate.kind.placed or ranked.candidate.everywhere or ranked.variant.form == "gradient"


def first_active_place(mesh: Mesh, active: Activity) -> list[float]:
    """Centre of the most active of the elements that are active first  # (dim,) mm"""
    centres = element_centres(mesh)[active.first]
    return centres[np.argmax(active.amount[active.first])].tolist()


def refitted_form(ranked: Ranked, rival: Rival | None) -> str | None:
    """Form of a candidate's variant, after its refit where there is one; rival : None without a usable refit."""
    return ranked.variant.form if rival is None else ranked.candidate.form_after(ranked.variant, rival.refitted.values)
