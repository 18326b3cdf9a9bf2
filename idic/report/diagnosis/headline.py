"""The headline of a diagnosis: cause, place, time, size, effect on the parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from idic.diagnose import MOTION, NO_CAUSE
from idic.report.diagnosis.words import (
    MIN_GOOD_PROBABILITY, NOISE_AT_REST, SAYS_NOTHING, below_margin, new_values, selected_titles, side_in_words,
    size_of_grey, unconfirmed, when_and_where, with_size,
)
from idic.report.result.words import short_names, size_text, with_std

MIN_MOVE_STD = 2.0  # standard deviations after: a parameter that moved less is not worth a word
MOSTLY = 0.5  # explained share from which a free curve explains most of the residual
MIN_LEFT_PX = 5e-4  # motion that is worth a word
MAX_SMALL = 3  # candidates that are not selected, told by name
CAME_OUT = "came out"
MAX_SHAPES = 2  # of a free end, that are told
MIN_TOLD_ODDS = 1.2  # of the largest share over an even one: less is no news
MIN_TEXT_Z = 5.0  # standard deviations: a smaller residual excess is not reported


def diagnosis_headline(content: Mapping, titles: Mapping[str, str]) -> str:
    """One sentence in standard words.

    titles : candidate -> its name in standard words
    """
    word, share = content["verdict"], content["fit"]["explainable_share_recovered"]
    if word == "none":
        moved = moves(content, "parameters_of_real_body")
        body = f"; as the model simplifies the body, {_in_one(moved)}" if moved else ""
        small, open_ = ([_titled(name, titles) for name in names]
                        for names in (below_margin(content), unconfirmed(content)))
        small_clause = f"; {_few(small, 'seen')}, but below the practical margin" if small else ""
        doubt = f"; {_few(open_, 'suspected')} by the score, and not confirmed by a refit" if open_ else ""
        statement = "No missing physics matters" if small else "No missing physics is significant"
        return f"{statement}: the residual of images and channels is {_nothing(content)}{body}{small_clause}{doubt}."
    if word == "blind":
        return f"{SAYS_NOTHING}."
    if content.get("free_end"):
        return free_end_words(content["free_end"])
    if word == "outside_library":
        return unexplained_words(content)
    causes = _joined(_causes(content, titles))
    formal = [title for title, entry in _with_rounds(content, titles) if _is_formulation(content, entry)]
    occasion = when_and_where(content, sizes=True, visible=False)
    statement = _begun(content, f"{causes}{f', {occasion},' if occasion else ''} ")
    moved, pronoun = moves(content), "it" if len(content["named"]) - len(formal) == 1 else "them"
    effect = f"; without {pronoun} {_in_one(moved)}" if moved else ""
    verb = "belongs" if len(formal) == 1 else "belong"
    formal_clause = f"; {_joined(formal)} {verb} to the description" if formal else ""
    amount = "nearly all" if share is not None and per_cent(share) == "all" and left_over(content) else per_cent(share)
    return f"{statement}explain{_s(content)} {amount} of the residual{_faint(content)}{effect}{formal_clause}."


def unexplained_words(content: Mapping) -> str:
    """Since when and where, on which side, how much is unexplained; a formal fit is no cause, and not told here."""
    occasion = when_and_where(content)
    source = f"{f'{occasion}, ' if occasion else ''}probably from {side_in_words(content)}"
    fits = (": what fits needs a size that no such cause has" if content.get("beyond_plausible")
            and not content.get("unexplained") else "")
    return (f"{source[:1].upper()}{source[1:]}: no candidate explains {_how_much(content)}{fits}; do not trust the "
            f"parameters.{free_form_words(content)}")


def _how_much(content: Mapping) -> str:
    """The unexplained motion and readings with their sizes, where known; after a formal fit the remainder."""
    unexplained = content.get("unexplained", ())
    remainder, mismatch = content.get("left") or {}, content["mismatch"]
    motion_px = remainder.get("motion_px") if content["named"] else mismatch.get("effect_px_rms")
    shares = {channel["column"]: channel["reading_share"] for channel in remainder.get("channels", ())}
    parts = []
    for quantity in unexplained:
        if quantity == MOTION:
            parts.append(f"{motion_px:.2g} px of motion (rms)" if motion_px else MOTION)
        else:
            parts.append(f"{size_text(100.0 * shares[quantity])} % of {quantity}" if quantity in shares else
                         f"a reading of {quantity}")
    return _joined(parts) if parts else "the residual"


def free_end_words(end: Mapping) -> str:
    """That an end moves in another shape than any candidate describes, which shape, and how much that explains."""
    shapes = [f"{entry['words']} in u{entry['component']} by {with_std(entry['value'], entry['std'])} {entry['unit']}"
              for entry in end["shapes"][:MAX_SHAPES]]
    shape = f" (shape: {_joined(shapes)})" if shapes else ""
    return (f"The end {end['nodes']} moves in a way that no candidate describes{shape}; its free motion explains "
            f"{per_cent(end['share'])} of the residual on held-out data: measure that end from the images, and do not "
            "trust the parameters before.")


def free_form_words(content: Mapping) -> str:
    """Whether a free curve describes what no name does, "" where none was offered."""
    entry = content.get("free_form")
    if not entry:
        return ""
    curve, share = f"{entry['title']} of {entry['material']}", per_cent(entry["share"] or 0.0)
    if entry["describes"]:
        return (f" No named physics fits; a {curve} describes {share} of the residual on held-out data: use the curve "
                "within its band.")
    if (entry["share"] or 0.0) > MOSTLY:
        return f" No named physics fits; a {curve} describes {share} of the residual on held-out data, but not all."
    return f" No named physics fits, nor does a {curve} ({share} of the residual on held-out data)."


def _begun(content: Mapping, statement: str) -> str:
    """The beginning of the sentence; "Probably" where the probability is no good news."""
    probable = content.get("probability")
    if content["verdict"] != "outside_library" and probable is not None and probable <= MIN_GOOD_PROBABILITY:
        return f"Probably ({per_cent(probable)}) {statement}"
    return statement[:1].upper() + statement[1:]


def _faint(content: Mapping) -> str:
    """What shows a cause where free motions show no mismatch, "" where they do."""
    shown_by = content["mismatch"].get("shown_by")
    return f", which shows by {shown_by}, not by free motions" if shown_by else ""


def left_over(content: Mapping, titles: Mapping[str, str] | None = None) -> str | None:
    """The remaining residual of the last model, in a sentence; None where it is noise.

    titles : candidate -> its name in standard words
    """
    remainder = content.get("left") or {}
    parts, small = [], False
    if (remainder.get("motion_z") or 0.0) > MIN_TEXT_Z and (remainder.get("motion_px") or 0.0) > MIN_LEFT_PX:
        floor = content.get("camera_floor_px")
        at_rest = bool(floor) and remainder["motion_px"] < 1.5 * floor  # the explained share does not count that either
        place = f", largest {remainder['place']}" if remainder.get("place") else ""
        share = ((", " if place else " ") + "that images at rest show too" if at_rest
                 else _of_before(remainder.get("motion_share")))
        parts.append(f"{remainder['motion_px']:.2g} px of motion{place}{share}")
        small = not at_rest and remainder["motion_px"] < ((content.get("margin") or {}).get("px") or 0.0)
    parts += [f"{size_text(100.0 * channel['reading_share'])} % of {channel['column']}{_of_before(channel['share'])}"
              for channel in remainder.get("channels", ()) if channel["significant"]]
    if not parts:
        return None
    cause = _formal(content, titles or {})
    if content["verdict"] in ("single", "set", "multiple"):
        cause = _further(content, titles or {}, small)
    return f"Remaining residual: {_joined(parts)}{cause}."


def _formal(content: Mapping, titles: Mapping[str, str]) -> str:
    """The formal fit of an unexplained residual, "" where there is none."""
    if content["verdict"] != "outside_library" or not content["named"]:
        return ""
    share = content["fit"]["explainable_share_recovered"]
    return (f"; a formal fit, not the cause: {_joined([_titled(name, titles) for name in content['named']])}"
            f"{f' ({per_cent(share)})' if share is not None else ''}")


def _further(content: Mapping, titles: Mapping[str, str], small: bool) -> str:
    """What further causes the residual of a selected cause may have; small : its motion is below the margin."""
    size = f"; the motion is below the practical margin of {content['margin']['px']:.2g} px" if small else ""
    nearest = [_titled(name, titles) for name in content["left"].get("nearest", ())]
    if nearest:
        return f"{size}; nearest further candidates, not selected: {_joined(nearest)}"
    return f"{size}; no further candidate is significant"


def _of_before(share: float | None) -> str:
    return f" ({per_cent(share)} of the excess before)" if share is not None and share < 1.0 else ""


def _titled(name: str, titles: Mapping[str, str]) -> str:
    return titles.get(name, name.replace("_", " "))


def _few(names: Sequence[str], verb: str) -> str:
    """Names with a verb in the passive; of many their number and the first."""
    return (f"{_joined(names)} {_is(names)} {verb}" if len(names) <= MAX_SMALL else
            f"{len(names)} candidates are {verb}, {names[0]} most")


def _is(names: Sequence[str]) -> str:
    return "is" if len(names) == 1 else "are"


def _nothing(content: Mapping) -> str:
    if below_margin(content) or left_over(content):
        return "below what matters in practice"
    return NOISE_AT_REST if content.get("camera_floor_px") else "noise"


def _in_one(moved: Sequence[str]) -> str:
    """Shifts of parameters in one clause: its verb stands once."""
    return _joined([moved[0], *(clause.replace(f" {CAME_OUT} ", " ", 1) for clause in moved[1:])])


def _causes(content: Mapping, titles: Mapping[str, str]) -> list[str]:
    """Selected candidates with their sizes; indistinguishable ones joined by "or"."""
    causes = []
    for place, (title, entry) in enumerate(_with_rounds(content, titles)):
        if _is_formulation(content, entry):
            continue
        size = new_values(content, entry["new"], place) or size_of_grey(content, entry["winner"])
        equals = [_titled(name, titles) for name in dict.fromkeys(entry["equals"])]
        causes.append(_either([with_size(title, size), *equals]) + _odds(content, entry["winner"]))
    return causes


def _odds(content: Mapping, winner: str) -> str:
    """The odds of a set, where plausible sizes tell its members apart; the recording alone does not."""
    group = next((members for members in content.get("odds", ()) if members[0]["name"] == winner), ())
    if not group or max(member["share_with"] for member in group) < MIN_TOLD_ODDS * group[0]["share_without"]:
        return ""
    shares = " to ".join(f"{size_text(100.0 * member['share_with'])} %" for member in group)
    return f" ({shares} by plausible size, even by the recording alone)"


def _with_rounds(content: Mapping, titles: Mapping[str, str]) -> list[tuple[str, Mapping]]:
    """Titles of the selected candidates with their rounds."""
    won = [entry for entry in content.get("rounds", ()) if entry["winner"]]
    return [(title, won[place] if place < len(won) else {"equals": (), "new": None, "winner": None})
            for place, title in enumerate(selected_titles(content, titles))]


def _is_formulation(content: Mapping, entry: Mapping) -> bool:
    """Whether a selected candidate is no cause but in every specimen, as finite strains are, and stands next to causes.

    Next to a cause they belong to the description, alone they are the finding.
    """
    companions = [companion for companion in content.get("rounds", ())
                  if companion["winner"] and companion is not entry]
    return entry["winner"] == NO_CAUSE and not entry["equals"] and bool(companions)


def moves(content: Mapping, of_model: str = "parameters_after") -> list[str]:
    """How the missing cause, or what the model neglects, had biased the parameters."""
    identified, compared = content["model"]["parameters_before"], content["model"].get(of_model, {})
    labels, shifts = short_names(compared), []
    for name, biased in identified.items():
        corrected = compared.get(name)
        if corrected is None or None in (biased["value"], biased["std"], corrected["value"]) or not corrected["value"]:
            continue
        if abs(corrected["value"] - biased["value"]) > MIN_MOVE_STD * (corrected["std"] or biased["std"]):
            old_text = with_std(biased["value"], None, biased["unit"])
            new_text = with_std(corrected["value"], corrected["std"], corrected["unit"])
            # GPa of a value may be MPa of another one
            unit = new_text[new_text.rfind(" "):] if corrected["unit"] else ""
            shifts.append(f"{labels[name]} {CAME_OUT} {_too_much(biased['value'] / corrected['value'])} "
                          f"({old_text.removesuffix(unit) if unit else old_text} for {new_text})")
    return shifts


def _too_much(ratio: float) -> str:
    """By how much a value was off: "8.3 % too low", "9 times as high"."""
    share = 100.0 * (ratio - 1.0)
    return (f"{ratio:.2g} times as high" if ratio >= 2.0
            else f"{size_text(abs(share))} % too {'high' if share > 0 else 'low'}")


def per_cent(share: float | None) -> str:
    if share is None:
        return "all"
    return f"{100.0 * share:.2g} %" if share < 0.995 else "all"


def _s(content: Mapping) -> str:
    formal = [entry for entry in content.get("rounds", ()) if entry["winner"] and _is_formulation(content, entry)]
    return "s" if len(content["named"]) - len(formal) == 1 else ""


def _either(parts: Sequence[str]) -> str:
    return " or ".join(parts) if len(parts) < 3 else ", ".join(parts[:-1]) + f" or {parts[-1]}"


def _joined(parts: Sequence[str]) -> str:
    return " and ".join(parts) if len(parts) < 3 else ", ".join(parts[:-1]) + f", and {parts[-1]}"
