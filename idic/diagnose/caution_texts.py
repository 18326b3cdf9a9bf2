"""Cautions of a diagnosis: where the selected candidate may be wrong, or its error bars too small.

Differences between wrong models are significant on every real camera. The cautions say what the significance does not
cover: a search that had not converged, a formal fit, refits that were cut short, a rival that comes near, few elements.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy import stats

from idic.diagnose.diagnosis import Diagnosis
from idic.diagnose.discretisation.combinations import FINITE_STRAINS
from idic.diagnose.locate.place import in_words
from idic.diagnose.next_test import reason_against_continuation
from idic.diagnose.physics.candidate import MESH_TOO_COARSE
from idic.diagnose.physics.edits import open_share
from idic.diagnose.refits.refit import MAX_EVALUATIONS, MAX_FAILED_SIMULATIONS
from idic.diagnose.residual.excess_left import MAX_EXCESS_LEFT, MAX_LOCAL_EXCESS_LEFT, MIN_EXCESS_Z, ExcessLeft
from idic.diagnose.residual.heldout import Misfit
from idic.diagnose.residual.margin import PRACTICAL_MARGIN_PX
from idic.diagnose.selection.rival import NO_CAUSE, Round, lead_of, winners, with_winners
from idic.identification import Identification, z_text
from idic.laws import get_law
from idic.model import Model
from idic.parameters import Parameter
from idic.simulation_error import reason_against_bricks

MIN_CARRYING_ELEMENTS = 60  # elements that carry the active law: fewer do not resolve its course in space
MIN_RIVAL_SHARE = 0.3  # of the winner's drop of chi-square: a rival that may still overtake it
MIN_LEFT_OF_DIFFERENCE = 0.1  # excess left over the difference of two rivals: it may decide the sign of the difference
MAX_EXCESS_GROWTH = 0.05  # of the excess before
MAX_EXCESS_GROWTH_STD = 5.0  # standard deviations of the excess; the larger of the two counts
MIN_MOVE_BY_MESH_STD = 2.0  # of a parameter: what a mesh moves by less is no news
STATUS_WORDS = {"stalled": "no step lowered the residual", "max_iterations": "it reached its limit of evaluations",
                "at_bound": "a parameter is at its bound", "forward_failed": "the simulation failed",
                "interrupted": "it was interrupted"}


def cautions(diagnosis: Diagnosis) -> list[str]:
    """Everything that the error bars do not say, in sentences."""
    return [text for caution in CAUTIONS for text in caution(diagnosis)]


def too_coarse(rounds: Sequence[Round]) -> list[str]:
    """A candidate that asks for a finer mesh and shows beside the selected ones, or before an imitation of it was
    selected: around a hole a plate that yields has a period, too, until plasticity is in the model."""
    reasons = {candidate.title: reason for entry in rounds for candidate, reason in entry.screening.untestable
               if reason.startswith(MESH_TOO_COARSE)
               and (entry is rounds[-1] or (entry.winner and entry.winner.ranked.candidate.name in candidate.rivals))}
    return [f"{title.capitalize()}: {reason}. Until then a gradient or an inclusion may stand for them."
            for title, reason in reasons.items()]


def _convergence(diagnosis: Diagnosis) -> list[str]:
    """Where the identification had not converged, and where the enriched model explains motions worse."""
    base, enriched = diagnosis.verdict.before, diagnosis.verdict.after
    return search_cautions(diagnosis.identification.state.status, base.excess, enriched.excess, base.excess_std)


def _margin(diagnosis: Diagnosis) -> list[str]:
    """Where the camera shows more at rest than the practical margin."""
    margin = diagnosis.state.setting.margin
    return [margin.words] if margin.px > PRACTICAL_MARGIN_PX else []


def _register(diagnosis: Diagnosis) -> list[str]:
    """Where the images are out of register with the identified model."""
    return [] if diagnosis.register is None else [diagnosis.register.words]


def _quick(diagnosis: Diagnosis) -> list[str]:
    """What a quick diagnosis leaves out, where it selects a candidate."""
    if not (diagnosis.state.setting.quick and diagnosis.verdict.selected):
        return []
    return ["This was a quick diagnosis: one candidate was refitted, to one copy of the recording with twice the noise "
            "variance. Its rivals were not refitted; run  idic diagnose  without --quick for the comparison."]


def outline_caution(share: float | None, word: str) -> list[str]:
    """Where the mesh is the outline of measured points, and something was found.

    share : by how much its narrowest width may be off, of that width
    """
    if share is None or word in ("none", "blind"):
        return []
    return [f"The mesh is the outline of the points, whose narrowest width may be off by {100.0 * share:.1f} %. A "
            "wrong outline looks like a wrong thickness, force scale or stiffness, and like another stiffness at "
            "notches and holes: it may explain the whole finding. Draw the outline (outline_mm in mesh) and diagnose "
            "again."]


def thickness_caution(diagnosis: Diagnosis) -> list[str]:
    """Where the recording fits bricks of the specimen's thickness and not plane stress."""
    error, experiment = diagnosis.source.motion_error, diagnosis.identification.experiment
    if error is None or error.thickness is None:
        return []
    moved = float(np.sqrt((error.thickness.u**2).sum(axis=2).mean(axis=1)).max()) / experiment.pixel_size
    shares = [f", {100.0 * np.abs(change).max() / channel.largest:.2g} % of {channel.column}"
              for channel, change in zip(experiment.model.channels, error.thickness.channels.T, strict=True)]
    identified, first = diagnosis.identification.parameters, diagnosis.rounds[0]
    first_error = first.source.motion_error
    bricks = first.null if diagnosis.corrected is None else diagnosis.corrected.fit
    values = "; ".join(f"{name} {identified[name].shown:.4g}, about "
                       f"{bricks.values[name] / identified[name].factor:.4g} {_unit(identified[name])}with bricks"
                       for name in identified.free
                       if abs(bricks.values[name] - identified[name].value) > (bricks.stds.get(name) or 0.0))
    is_first = first_error is not None and first_error.thickness is not None  # counted before any cause
    value_text = f" ({values})" if is_first and values else ""
    addition = "" if diagnosis.state.final is None else ", nor does the enriched experiment"
    return [f"The specimen is not in plane stress: the motion of bricks of its thickness "
            f"({experiment.model.thickness:.3g} "
            f"mm) differs from the model by up to {moved:.2g} px (rms of a frame){''.join(shares)}, and the recording "
            f"shows it. The diagnosis counts the difference; the identified parameters do not{value_text}{addition}. "
            "Identify again with a mesh of bricks (kind = \"solid\")."]


def _unit(parameter: Parameter) -> str:
    return f"{parameter.unit} " if parameter.unit not in ("", "-") else ""


def untested_thickness(identification: Identification) -> list[str]:
    """Where bricks of the specimen's thickness were not compared with plane stress."""
    reason = reason_against_bricks(identification.experiment)
    if reason is None:
        return []
    return [f"Plane stress was not tested: {reason}. Bricks of the specimen's thickness "
            f"({identification.experiment.model.thickness:.3g} mm) may move otherwise, most at grips, notches and in "
            "bending; no error bar counts it. Diagnose with "
            "quadrilaterals or triangles of second order alone, and not too many, or identify with a mesh of bricks "
            "(kind = \"solid\")."]


def finite_caution(diagnosis: Diagnosis) -> list[str]:
    """Where finite strains were counted beside a cause, and are none by name; a law that has no other form is not
    counted."""
    enriched = diagnosis.enriched
    if enriched is None or NO_CAUSE in diagnosis.verdict.selected:
        return []
    small = {material.element_set for material in diagnosis.identification.experiment.model.materials
             if material.kinematics == "small"}
    if not any(material.element_set in small and material.kinematics == "finite"
               and "small" in get_law(material.law).kinematics
               for material in enriched.residual.context.experiment.model.materials):
        return []
    return ["The recording shows finite strains and rotations, which the identified model neglects. The diagnosis and "
            "the enriched experiment count them; the identified parameters do not. Identify again with finite strains "
            "(kinematics = \"finite\")."]


def mesh_caution(diagnosis: Diagnosis) -> list[str]:
    """Where the error of the mesh has moved an identified parameter by `MIN_MOVE_BY_MESH_STD`, and no cause was named
    that would be fitted with it."""
    error, better = diagnosis.source.motion_error, diagnosis.corrected
    if better is None or error is None or error.thickness is not None:
        return []
    parameters = diagnosis.identification.parameters
    moves = {name: abs(better.fit.values[name] - parameters[name].value) for name in parameters.free}
    if all(move <= MIN_MOVE_BY_MESH_STD * (better.fit.stds.get(name) or np.inf) for name, move in moves.items()):
        return []
    values = "; ".join(f"{name} {parameters[name].shown:.5g}, about "
                       f"{better.fit.values[name] / parameters[name].factor:.5g} on a finer mesh"
                       for name in parameters.free)
    return [f"The mesh is coarse for the body ({values}). The diagnosis counts its error; the identified parameters do "
            "not. Identify again on a finer mesh."]


def neglected_cautions(diagnosis: Diagnosis) -> list[str]:
    """Where the model neglects bricks of the thickness or finite strains, and the parameters depend on it."""
    neglected, experiment = diagnosis.neglected, diagnosis.identification.experiment
    if neglected is None:
        return []
    parameters = diagnosis.last_parameters
    texts = []
    for effect, moves in neglected.full.items():
        values = {name: move for name, move in moves.items() if name in parameters}
        changes = [f"{name} by {move / parameters[name].factor:+.2g} {parameters[name].unit}".rstrip()
                   for name, move in values.items() if "[" not in name]  # no knots of a course
        if len(changes) < len(values):
            changes.append("the course of " + ", ".join(dict.fromkeys(name.split("[")[0].removesuffix("_knot")
                                                                      for name in values if "[" in name)))
        assumption, remedy = _assumption(effect, experiment.model)
        texts.append(f"{assumption} would move {', '.join(changes)}. By the recording it is so with a probability "
                     f"{_probability(neglected.probability[effect])}; no error bar counts it "
                     f"(model.parameters_of_real_body does). Identify again with {remedy}.")
    return texts


def _assumption(effect: str, model: Model) -> tuple[str, str]:
    """What a model assumes where it neglects an effect, and the words of what has it."""
    if effect == FINITE_STRAINS:
        return ("Small strains are an assumption: the same law with finite strains and rotations",
                'finite strains (kinematics = "finite")')
    ends = " with ends that keep theirs" if model.gripped_ends else ""
    return (f"Plane stress is an assumption: bricks of the specimen's thickness ({model.thickness:.3g} mm){ends}",
            'a mesh of bricks (kind = "solid")')


def _probability(p: float) -> str:
    return "below 1 %" if p < 0.01 else "above 99 %" if p > 0.99 else f"of {100.0 * p:.0f} %"


def other_axis_caution(diagnosis: Diagnosis) -> list[str]:
    """Where the recording fits another axis as well, with other values."""
    fit, parameters = diagnosis.state.other_axis, diagnosis.last_parameters
    if fit is None or diagnosis.enriched is None:
        return []
    values = [f"{name} {fit.values[name] / parameters[name].factor:.4g} {parameters[name].unit}".rstrip()
              for name in fit.stds]
    return ["Another axis of the law explains the recording as well, with other values: " + ", ".join(values) + ". No "
            "error bar counts that. Turn a second specimen by 45 degrees, or lock what is known."]


def formal_fit(excesses: Sequence[ExcessLeft]) -> list[str]:
    """The clearest excess that the selected candidate leaves, where it is too large for the cause.

    excesses : local residual tests and time-course test
    """
    excess = max((entry for entry in excesses if entry.matters), key=lambda entry: entry.after.excess_z, default=None)
    if excess is None:
        return []
    if excess.after.excess > excess.before.excess > 0.0:
        return ["The selected candidate does not fit: motion with its time course, or at its place, is explained worse "
                f"with it than without it ({excess.motion_px:.2g} px rms are left)."]
    inclusion = excess.max_share != MAX_EXCESS_LEFT
    claim = "It is no inclusion of another stiffness" if inclusion else "The selected candidate does not fit"
    place = ("at the place of the fitted inclusion"
             if excess.max_share == MAX_LOCAL_EXCESS_LEFT else "with its time course")
    look = (" Look at the specimen there: a cut, a crack or a part of another shape moves like that."
            if inclusion else "")
    base = excess.before
    part = (f", {100.0 * (excess.after.excess / base.excess):.1f} % of the excess before"
            if base.excess > base.excess_std else "")
    return [f"{claim}: {excess.motion_px:.2g} px rms of motion {place} are left "
            f"({z_text(excess.after.excess_z)} standard deviations{part}).{look}"]


def place_cautions(rounds: Sequence[Round], unit: str) -> list[str]:
    """Places that the recording does not tell from those of the selected candidates, with the odds of the two.

    The chi-square D between two models keeps its sign with the probability Phi(D^1/2 / 2) in repeated noise
    (`noise_of_evidence`).
    """
    texts = []
    for _, winner in with_winners(rounds):
        if winner.rival_place is None:
            continue
        spot = {name.rpartition(".")[2]: value for name, value in winner.rival_place.refitted.values.items()
                 if name in winner.rival_place.own_unknowns}
        kind = "softer" if spot["stiffness"] < 1.0 else "stiffer"
        share = round(100.0 * stats.norm.cdf(np.sqrt(max(lead_of(winner, winner.rival_place), 0.0)) / 2.0))
        texts.append(f"The recording does not tell the place of the inclusion from another: {kind} "
                     f"({spot['stiffness']:.2g}) within {spot['radius']:.2g} {unit} of "
                     f"{in_words([spot[axis] for axis in 'xyz' if axis in spot])} {unit}. Odds {share}:{100 - share} "
                     "for the first.")
    return texts


def search_cautions(status: str, base_excess: float, enriched_excess: float, std: float) -> list[str]:
    """Where the identification had not converged, and where the enriched model explains motions worse.

    status : of the identification; base_excess, enriched_excess : held-out excess of the motions; std : its standard
    deviation
    """
    texts = []
    if status != "converged":
        texts.append(f"The identification had not converged ({STATUS_WORDS.get(status, status)}). A part of its "
                     f"residual "
                     "may come from the search and not from physics; the selected candidate is then only the nearest "
                     "description of that part. Let the identification converge and diagnose again.")
    if enriched_excess - base_excess > max(MAX_EXCESS_GROWTH * abs(base_excess), MAX_EXCESS_GROWTH_STD * std):
        texts.append("The enriched model explains the motions worse than the identified one (held-out excess "
                     f"{base_excess:.3g} before, {enriched_excess:.3g} after): the candidate has fitted grey values or "
                     "readings.")
    return texts


def refits_given_up(rounds: Sequence[Round]) -> list[str]:
    """Rivals whose simulations found no equilibrium, and whose score promised to come near the selected candidate."""
    return [f"{rival.ranked.called} was not compared with {winner.ranked.called}: its refit was given up, as "
            f"{MAX_FAILED_SIMULATIONS} of its simulations found no equilibrium. By its score it explains "
            f"{100.0 * min(rival.predicted / winner.achieved, 1.0):.0f} % of the same drop in chi-square. The "
            "recording neither confirms nor excludes it."
            for entry, winner in with_winners(rounds) for rival in entry.rivals
            if rival.refitted.given_up and rival.predicted > MIN_RIVAL_SHARE * winner.achieved]


def refits_cut_short(rounds: Sequence[Round]) -> list[str]:
    """Where the order of a winner and its nearest rivals was decided before their refits had converged."""
    texts = []
    for entry, winner in with_winners(rounds):
        close_rivals = [rival for rival in entry.rivals
                        if rival.refitted.usable and rival.achieved > MIN_RIVAL_SHARE * winner.achieved]
        names = [rival.ranked.called for rival in close_rivals if rival.refitted.status == "max_iterations"]
        if len(close_rivals) > 1 and names:
            texts.append(f"{winner.ranked.called} was selected after at most {MAX_EVALUATIONS} evaluations of "
                         f"every refit. Not converged by then: {', '.join(names)}. Their order may change.")
    return texts


def rivals_not_ruled_out(rounds: Sequence[Round], misfit: Misfit) -> list[str]:
    """Known rivals of a selected candidate that come near it, where a significant excess is left in the end.

    misfit : of the last model, held out
    """
    if not misfit.excess_z > MIN_EXCESS_Z:
        return []
    excess, texts = float(misfit.gain.sum() - misfit.rank.sum()), []
    for entry, winner in with_winners(rounds):
        selected = winner.ranked
        for rival in entry.rivals:
            ranked = rival.ranked
            reason = (selected.candidate.rivals.get(ranked.candidate.name)
                      or ranked.candidate.rivals.get(selected.candidate.name))
            is_close = rival.refitted.usable and rival.achieved > MIN_RIVAL_SHARE * winner.achieved
            if (reason and is_close and rival is not winner and rival.name not in entry.equals
                    and excess > MIN_LEFT_OF_DIFFERENCE * (winner.achieved - rival.achieved)):
                share = rival.achieved / winner.achieved
                texts.append(f"{ranked.called} is not ruled out: its refit reaches {100.0 * share:.1f} % of the drop "
                             f"in chi-square of "
                             f"{selected.called}, and the excess left at the end is a good part of the difference "
                             f"({reason}).")
    return texts


def softening_caution(rounds: Sequence[Round]) -> list[str]:
    """What a selected law of damage owes to the mesh."""
    selected = [winner.ranked.candidate for winner in winners(rounds)]
    if all(candidate.family != "damage" for candidate in selected):
        return []
    return ["Damage localises in one row of elements: beyond the highest load force, motion and damage parameters "
            "depend on this mesh. A length in the law (material.SET.length, crack band) makes the dissipated work "
            "independent of it."]


def _not_simulated(diagnosis: Diagnosis) -> list[str]:
    """Why the next experiment is the library's general one, where candidates are indistinguishable."""
    is_open = bool(diagnosis.verdict.indistinguishable)
    reason = reason_against_continuation(diagnosis.identification.experiment.model) if is_open else None
    if reason is None:
        return []
    return ["The next experiment is the library's general advice for these candidates; none was simulated with the "
            f"fitted models: {reason}."]


def _few_elements(diagnosis: Diagnosis) -> list[str]:
    """Where the active law is carried by too few elements to resolve its course in space."""
    active = diagnosis.active
    if active is None:
        return []
    carrying = float(active.amount.sum() ** 2 / max((active.amount**2).sum(), 1e-300))
    if carrying > MIN_CARRYING_ELEMENTS:
        return []
    parameters = [name for entry, winner in with_winners(diagnosis.rounds) if winner.ranked.candidate.side == "bulk"
                  for name in winner.refitted.stds if name not in entry.null.stds]
    if not parameters:
        return []
    one_set = len({name.partition(".")[0] for name in parameters}) == 1
    names = ", ".join((name.partition(".")[2] if one_set else name).replace("_", " ") for name in parameters)
    return [f"The selected law acts in {int((active.since >= 0).sum())} of {len(active.since)} elements and mostly in "
            f"about {max(carrying, 1.0):.0f} of them. The error bars of its parameters ({names}) count noise only, not "
            f"the "
            "coarseness of the mesh there. Run  idic systematic  on the enriched model, or refine the mesh."]


CAUTIONS: tuple[Callable[[Diagnosis], list[str]], ...] = (  # in the order in which they are told
    _register,
    _quick,
    lambda diagnosis: too_coarse(diagnosis.rounds),
    lambda diagnosis: outline_caution(open_share(diagnosis.identification.experiment.model), diagnosis.verdict.word),
    thickness_caution,
    finite_caution,
    mesh_caution,
    neglected_cautions,
    lambda diagnosis: [] if diagnosis.state.setting.quick else untested_thickness(diagnosis.identification),
    other_axis_caution,
    _convergence,
    _margin,
    lambda diagnosis: formal_fit(diagnosis.remainder.local),
    lambda diagnosis: place_cautions(diagnosis.rounds, diagnosis.identification.experiment.model.length_unit),
    _few_elements,
    lambda diagnosis: softening_caution(diagnosis.rounds),
    _not_simulated,
    lambda diagnosis: refits_given_up(diagnosis.rounds),
    lambda diagnosis: refits_cut_short(diagnosis.rounds),
    lambda diagnosis: rivals_not_ruled_out(diagnosis.rounds, diagnosis.verdict.after),
)
