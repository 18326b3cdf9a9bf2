"""What a diagnosis says of spots: dust, and paint that was lost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import zip_longest

from idic.diagnose import DUST, LeftOut, MARGIN_PX, PAINT, Spot, in_words
from idic.report.diagnosis.headline import moves

MAX_TOLD = 3  # spots that are told one by one; of more, how many there are and which is the largest
WORDS = {DUST: "dust on lens or sensor", PAINT: "paint loss"}


def with_spots(content: Mapping, left_out: LeftOut, identified: Mapping[str, Mapping], without: Mapping[str, Mapping],
               unit: str) -> dict:
    """The content of diagnosis.json with the spots as first causes.

    content : of the diagnosis without their pixels; identified, without : parameters of the RUN, and of the model
    without these pixels; unit : of lengths

    The probability stays that of what the diagnosis found without their pixels, and so does ``blind``: a spot says
    nothing of missing physics.
    """
    model = content["model"] | {"parameters_before": dict(identified),
                                "parameters_after": content["model"]["parameters_after"] or dict(without)}
    statement = _said(left_out, identified, without, unit)
    word = content["verdict"]
    if word not in ("outside_library", "blind"):
        open_kind = "set" if left_out.spots[0].alternatives else "single"
        word = open_kind if word == "none" and len(left_out.names) == 1 else "multiple"
    other_causes = f" Without {'its' if len(left_out.spots) == 1 else 'their'} pixels: {_lower(content['headline'])}"
    return dict(content) | {
        "verdict": word, "named": [*left_out.names, *content["named"]], "model": model,
        "indistinguishable": [[spot.kind, *spot.alternatives] for spot in left_out.spots if spot.alternatives]
        + content["indistinguishable"],
        "spots": [_entry(spot, place) for spot, place in zip(left_out.spots, left_out.place_mm, strict=True)],
        "headline": f"{statement}{other_causes}", "sentence": f"{statement} {content['sentence']}"}


def _lower(sentence: str) -> str:
    return sentence[:1].lower() + sentence[1:]


def _entry(spot: Spot, place: tuple[float, ...]) -> dict:
    return {"name": spot.kind, "not_excluded": list(spot.alternatives), "column_px": spot.column, "row_px": spot.row,
            "place_mm": list(place), "diameter_px": 2.0 * spot.radius_px, "first_frame": spot.first,
            "grey_values": spot.grey, "agreement": spot.agreement}


def _said(left_out: LeftOut, identified: Mapping[str, Mapping], without: Mapping[str, Mapping], unit: str) -> str:
    """The spots in one sentence, and what they did to the parameters."""
    n, places = len(left_out.spots), list(zip(left_out.spots, left_out.place_mm, strict=True))
    if n <= MAX_TOLD:
        words = "; ".join(f"{_kinds([spot])} {_where(spot, place, unit)} {_since([spot])}" for spot, place in places)
    else:
        words = (f"{_kinds(left_out.spots)} in {n} places, the largest "
                 f"{_where(*max(places, key=lambda entry: entry[0].radius_px), unit)}, {_since(left_out.spots)}")
    moved = moves({"model": {"parameters_before": identified, "parameters_after": without}})
    moved += [f"{name.rpartition('.')[2]} had an error bar of {entry['std']:.2g} {entry['unit']} in the place of "
              f"{without[name]['std']:.2g}".replace("  ", " ") for name, entry in identified.items()
              if entry["std"] and name in without and without[name]["std"]
              and entry["std"] > 2.0 * without[name]["std"]]
    effect = f"; with {'it' if n == 1 else 'them'} {', '.join(moved)}" if moved else ""
    text = f"{words}: left out of all images with {MARGIN_PX:g} px around{effect}."
    return text[:1].upper() + text[1:]


def _kinds(spots: Sequence[Spot]) -> str:
    """What they may be, the likeliest first."""
    return " or ".join(WORDS[kind] for kind in dict.fromkeys(
        kind for rank in zip_longest(*((spot.kind, *spot.alternatives) for spot in spots)) for kind in rank if kind))


def _where(spot: Spot, place: tuple[float, ...], unit: str) -> str:
    grey = "" if spot.grey != spot.grey else f", {spot.grey:+.0f} grey values"
    return (f"around {in_words(place)} {unit} (column {spot.column:.0f}, row {spot.row:.0f}; "
            f"{2.0 * spot.radius_px:.2g} px wide{grey})")


def _since(spots: Sequence[Spot]) -> str:
    earliest, latest = min(spot.first for spot in spots), max(spot.first for spot in spots)
    if earliest == latest:
        return f"from frame {earliest} on" if earliest else "from the start"
    begins = f"from frame {earliest} on" if earliest else "from the start"
    return f"the first {begins}, the last one from frame {latest} on"
