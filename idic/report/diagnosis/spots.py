"""What a diagnosis says of spots: dust, and paint that was lost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import zip_longest

from idic.diagnose import DUST, LeftOut, MARGIN_PX, PAINT, Spot, in_words
from idic.report.diagnosis.headline import moves

MAX_TOLD = 3  # spots that are told one by one; of more, how many there are and which is the largest
WORDS = {DUST: "dust on lens or sensor", PAINT: "paint loss"}


def with_spots(content: Mapping, left: LeftOut, before: Mapping[str, Mapping], without: Mapping[str, Mapping],
               unit: str) -> dict:
    """The content of diagnosis.json with the spots as first causes.

    content : of the diagnosis without their pixels; before, without : parameters of the RUN, and of the model without
    these pixels; unit : of lengths

    The probability stays that of what the diagnosis found without their pixels, and so does ``blind``: a spot says
    nothing of missing physics.
    """
    model = content["model"] | {"parameters_before": dict(before),
                                "parameters_after": content["model"]["parameters_after"] or dict(without)}
    said = _said(left, before, without, unit)
    word = content["verdict"]
    if word not in ("outside_library", "blind"):
        open_kind = "set" if left.spots[0].others else "single"
        word = open_kind if word == "none" and len(left.names) == 1 else "multiple"
    beside = f" Without {'its' if len(left.spots) == 1 else 'their'} pixels: {_lower(content['headline'])}"
    return dict(content) | {
        "verdict": word, "named": [*left.names, *content["named"]], "model": model,
        "indistinguishable": [[spot.kind, *spot.others] for spot in left.spots if spot.others]
        + content["indistinguishable"],
        "spots": [_entry(spot, place) for spot, place in zip(left.spots, left.place_mm, strict=True)],
        "headline": f"{said}{beside}", "sentence": f"{said} {content['sentence']}"}


def _lower(sentence: str) -> str:
    return sentence[:1].lower() + sentence[1:]


def _entry(spot: Spot, place: tuple[float, ...]) -> dict:
    return {"name": spot.kind, "not_excluded": list(spot.others), "column_px": spot.column, "row_px": spot.row,
            "place_mm": list(place), "diameter_px": 2.0 * spot.radius_px, "first_frame": spot.first,
            "grey_values": spot.grey, "agreement": spot.agreement}


def _said(left: LeftOut, before: Mapping[str, Mapping], without: Mapping[str, Mapping], unit: str) -> str:
    """The spots in one sentence, and what they did to the parameters."""
    n, places = len(left.spots), list(zip(left.spots, left.place_mm, strict=True))
    if n <= MAX_TOLD:
        what = "; ".join(f"{_kinds([spot])} {_where(spot, place, unit)} {_since([spot])}" for spot, place in places)
    else:
        what = (f"{_kinds(left.spots)} in {n} places, the largest "
                f"{_where(*max(places, key=lambda entry: entry[0].radius_px), unit)}, {_since(left.spots)}")
    moved = moves({"model": {"parameters_before": before, "parameters_after": without}})
    moved += [f"{name.rpartition('.')[2]} had an error bar of {old['std']:.2g} {old['unit']} in the place of "
              f"{without[name]['std']:.2g}".replace("  ", " ") for name, old in before.items()
              if old["std"] and name in without and without[name]["std"] and old["std"] > 2.0 * without[name]["std"]]
    done = f"; with {'it' if n == 1 else 'them'} {', '.join(moved)}" if moved else ""
    text = f"{what}: left out of all images with {MARGIN_PX:g} px around{done}."
    return text[:1].upper() + text[1:]


def _kinds(spots: Sequence[Spot]) -> str:
    """What they may be, the likeliest first."""
    return " or ".join(WORDS[kind] for kind in dict.fromkeys(
        kind for own in zip_longest(*((spot.kind, *spot.others) for spot in spots)) for kind in own if kind))


def _where(spot: Spot, place: tuple[float, ...], unit: str) -> str:
    grey = "" if spot.grey != spot.grey else f", {spot.grey:+.0f} grey values"
    return (f"around {in_words(place)} {unit} (column {spot.column:.0f}, row {spot.row:.0f}; "
            f"{2.0 * spot.radius_px:.2g} px wide{grey})")


def _since(spots: Sequence[Spot]) -> str:
    first, last = min(spot.first for spot in spots), max(spot.first for spot in spots)
    if first == last:
        return f"from frame {first} on" if first else "from the start"
    begins = f"from frame {first} on" if first else "from the start"
    return f"the first {begins}, the last one from frame {last} on"
