"""A diagnosis in one sentence, from the content of diagnosis.json."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from idic.diagnose import MAX_HIDDEN_VISIBILITY, MOTION, SUPPOSED_EXPANSION_PER_K
from idic.model import TEMPERATURE
from idic.report.result.words import number_text, short_names, with_std

NOISE_AT_REST = "noise and motion that the camera shows at rest"  # what a sound model leaves
SAYS_NOTHING = "This test says nothing about missing physics"
MIN_GOOD_PROBABILITY = 0.9  # that the selected set holds the truth: good news
MIN_EVEN_PROBABILITY = 0.5  # below, the truth is more probably elsewhere: bad news
MIN_VALUE_STD = 2.0  # standard deviations: a value that is nearer to zero is not determined
SAID_BY_TITLE = ("layers", "inclusion", "gradient", "geometry", "camera")  # first parts of names
MIN_COURSE_UNKNOWNS = 3  # unknowns of one kind, one per frame, from which on they are summed up
OF_ANY_VALUE = (".layers.direction", ".layers.offset")  # parameters whose zero means no absence
CENTRE = (".inclusion.x", ".inclusion.y", ".inclusion.z")  # parameters that are a place
FORMS = {"void": "next to no stiffness: a void, a cut or a crack"}
UNITS_OF_GREY = {"defocus": "px²"}  # of candidates whose size is that of a column of grey values
MIN_MOVE_STD = 2.0  # standard deviations after: a parameter that moved less is not worth a word
SIDE_WORDS = {"bulk": "the specimen", "boundary": "the boundary", "camera": "the camera", "force": "the force"}


def sentence(content: Mapping, titles: Mapping[str, str]) -> str:
    """Onset and place, selected candidates, explained share, change of the parameters, next experiment.

    Parameters
    ----------
    titles : candidate -> its name in standard words
    """
    word = content["verdict"]
    if word == "none":
        remainder = "is noise"
        if (content.get("margin") or {}).get("camera_floor_px"):
            remainder = f"is {NOISE_AT_REST}"
        matters = "matters" if below_margin(content) else "is significant"
        return (f"No candidate {matters}: the residual of images and channels {remainder} "
                f"({len(content['candidates'])} candidates tested{_bounds(content)}).")
    if word == "blind":
        return _blind(content) + _next(content)
    if word == "outside_library":
        return _outside(content, titles)
    shown_by = content["mismatch"].get("shown_by")
    faint = [f"free motions show no mismatch beyond noise, only {shown_by} does"] if shown_by else []
    parts = [_selected(content, titles), *faint, *_moves(content), *_open(content, titles)]
    return _capital(f"{_when_where(content)}{'; '.join(parts)}.") + _next(content)


def is_sure(content: Mapping) -> bool:
    """Whether the verdict is good news: one set of causes, or none, probable enough, and nothing left over."""
    probable = content.get("probability")  # null where it was not estimated
    return (content["verdict"] in ("none", "single", "multiple") and not content.get("left_over")
            and (probable is None or probable > MIN_GOOD_PROBABILITY))


def strongest(content: Mapping, number: int) -> list[Mapping]:
    """The first candidates, the selected ones, and those that are indistinguishable from them."""
    names = set(content["named"]).union(*content["indistinguishable"])
    return [c for k, c in enumerate(content["candidates"]) if k < number or c["name"] in names]


def name_of_best(content: Mapping) -> str:
    """Standing of the candidates in the enriched model; where the library does not explain the residual, they are
    nearest."""
    return "nearest, not the cause" if content["verdict"] == "outside_library" else "selected"


def standing_of(content: Mapping, entry: Mapping, otherwise: str) -> str:
    """Final standing of a candidate; `otherwise` where it is neither selected nor indistinguishable from a selected
    one, nor settled by the selected one: significant without it, excluded or not visible beside it."""
    if entry["named"]:
        return name_of_best(content)
    equals = set().union(*content["indistinguishable"])
    if entry["name"] in equals:
        return "indistinguishable from the selected"
    if _by_score_only(content, entry):
        return "significant by score only"
    if not _screened(content) or entry["standing"] not in ("significant", "small", "inadmissible"):
        return otherwise
    best = "nearest" if content["verdict"] == "outside_library" else "selected"
    if entry["name"] in {exclusion["name"] for exclusion in content["excluded"]}:
        return f"excluded beside the {best} cause"
    return f"not visible beside the {best} cause" if entry["name"] in content["cannot_tell"] else otherwise


def _by_score_only(content: Mapping, entry: Mapping) -> bool:
    """Whether the refit of a candidate did not confirm its score, and nothing was selected."""
    spots_alone = content["named"] and not _screened(content)
    nothing = content["verdict"] in ("none", "blind") or (spots_alone and content["verdict"] != "outside_library")
    return nothing and entry.get("standing") == "significant"


def unconfirmed(content: Mapping) -> list[str]:
    """Candidates whose scores are significant and whose refits do not confirm it, where nothing was selected."""
    return [entry["name"] for entry in content["candidates"]
            if _by_score_only(content, entry) and entry["name"] not in content["cannot_tell"]]


def below_margin(content: Mapping) -> list[str]:
    """Candidates that are significant, but smaller than the practical margin."""
    return [entry["name"] for entry in content["candidates"] if entry.get("standing") == "small"]


def _screened(content: Mapping) -> list[str]:
    """The named causes that were selected by their scores: without spots, which are found before."""
    spots = {entry["name"] for entry in content.get("spots", ())}
    return [name for name in content["named"] if name not in spots]


def heldout_drop(entry: Mapping) -> str:
    """Drop of chi-square of a candidate on held-out data, and whether both copies judged."""
    drop = entry["heldout_chi2_drop"]
    if drop is None:
        return "–"
    return f"{drop:.3g}" + (" (both)" if entry["heldout_copies"] == 2 else "")


def _selected(content: Mapping, titles: Mapping[str, str]) -> str:
    verb = "explains" if len(content["named"]) == 1 else "explain"
    share = content["fit"]["explainable_share_recovered"]
    heads = []
    won = _won(content)
    for place, title in enumerate(selected_titles(content, titles)):
        values = new_values(content, won[place]["new"] if place < len(won) else None, place)
        heads.append(with_size(title, values))
    amount = f"{100.0 * share:.3g} % of the explainable residual" if share is not None else "the channels"
    listed = " and ".join(heads) if len(heads) < 3 else ", ".join(heads[:-1]) + f", and {heads[-1]}"
    return f"{listed} {verb} {amount}"


def with_size(title: str, size: str) -> str:
    """A title with the values of its parameters, in one bracket with its form."""
    if not size:
        return title
    return f"{title[:-1]}; {size})" if title.endswith(")") else f"{title} ({size})"


def size_of_grey(content: Mapping, name: str | None) -> str:
    """Size of a candidate that changes grey values and has no parameter, "" of another one."""
    entry = next((c for c in content["candidates"] if c["name"] == name), None)
    if name not in UNITS_OF_GREY or not entry or not entry.get("expected_change"):
        return ""
    (label, value), = entry["expected_change"].items()
    return f"{label.partition(', place')[0]}: {with_std(value, entry['expected_change_std'], UNITS_OF_GREY[name])}"


def _won(content: Mapping) -> list[Mapping]:
    return [entry for entry in content.get("rounds", ()) if entry["winner"]]


def selected_titles(content: Mapping, titles: Mapping[str, str]) -> list[str]:
    """Titles of the selected candidates, each in its own form: an inclusion, then a gradient."""
    forms = [entry.get("form") for entry in _won(content)]
    return [_title(content, titles, name, forms[k] if k < len(forms) else None)
            for k, name in enumerate(content["named"])]


def _title(content: Mapping, titles: Mapping[str, str], name: str, form: str | None = None) -> str:
    entry = next((c for c in content["candidates"] if c["name"] == name), {})
    form = form or entry.get("form")
    return f"{titles.get(name, name.replace('_', ' '))}{f' ({FORMS.get(form, form)})' if form else ''}"


def new_values(content: Mapping, names: Sequence[str] | None, number: int) -> str:
    """Values of the parameters of a candidate; names : None counts all new parameters to the first candidate."""
    identified, enriched = content["model"]["parameters_before"], content["model"]["parameters_after"]
    if names is None:
        names = () if number else [n for n in enriched if n not in identified]
    cracks = [crack_words(content["cracks"][name]) for name in dict.fromkeys(_crack_of(n) for n in names)
              if name in (content.get("cracks") or {})]
    added = {n: enriched[n] for n in names if n in enriched and not (cracks and _crack_of(n))}
    labels = {n: _of_cause(label) for n, label in short_names(enriched).items()}
    stems = dict.fromkeys(_stem(n) for n in added if n.endswith("]"))
    courses = {stem: {n: p for n, p in enriched.items() if n.endswith("]") and _stem(n) == stem} for stem in stems}
    courses = {stem: course for stem, course in courses.items() if len(course) >= MIN_COURSE_UNKNOWNS
               or stem.endswith(("_knot", "_jump"))}
    texts = [f"{labels[n]} "
             + (with_std(p["value"], p["std"], p["unit"]) if p["std"] else "not determined")
             for n, p in added.items() if _stem(n) not in courses and not _is_open(n, p)]
    left_open = [f"{labels[n]} ≈ {with_std(_two_digits(p['value']), None, p['unit'])}"
                 for n, p in added.items() if _stem(n) not in courses and _is_open(n, p)]
    parts = [*cracks, *texts, *(_course(stem, course) for stem, course in courses.items())]
    return ", ".join([*parts, *([f"{', '.join(left_open)}, not determined"] if left_open else [])])


def _crack_of(name: str) -> str:
    """The crack that a degree of freedom is the length of, "" of another one."""
    head, _, tail = name.partition(".")
    return tail.partition(".")[0] if head == "crack" else ""


def crack_words(entry: Mapping) -> str:
    """Where a crack begins, its direction, its length in the first frame with one and in the last, and K there."""
    identified = [k for k, std in enumerate(entry["length_mm_std"]) if std and k]  # the reference is at rest
    place = "({:.3g}, {:.3g}) mm".format(*(round(x, 6) + 0.0 for x in entry["start_mm"]))  # an edge at 0 is at 0
    head = f"from {place}{' inside the body' if entry['inner'] else ' at an edge'} at {entry['direction_deg']:.0f}°"
    if not identified:
        return f"{head}, length not determined"
    lengths = [f"{with_std(entry['length_mm'][k], entry['length_mm_std'][k], 'mm')} in frame {entry['frames'][k]}"
               for k in (identified[0], identified[-1])]
    grows = (abs(entry["length_mm"][identified[-1]] - entry["length_mm"][identified[0]])
             > MIN_VALUE_STD * math.hypot(*(entry["length_mm_std"][k] for k in (identified[-1], identified[0]))))
    length = f"{lengths[0]} to {lengths[1]}" if grows else lengths[1].partition(" in ")[0] + " long"
    loaded = [k for k in identified if entry["K_I"][k] is not None and entry["K_I_std"][k]]
    if not loaded:
        return f"{head}, {length}"
    modes = ", ".join(f"{name} {with_std(entry[name][loaded[-1]], entry[f'{name}_std'][loaded[-1]], 'MPa √m')}"
                      for name in ("K_I", "K_II"))
    return f"{head}, {length}, {modes} in frame {entry['frames'][loaded[-1]]}"


def _of_cause(name: str) -> str:
    """A parameter of a cause beside its title: ``boundary.RIGHT.x.seating`` is ``seating of RIGHT in ux``."""
    head, *parts = name.split(".")
    if head == "boundary" and len(parts) == 3:
        return f"{parts[2].replace('_', ' ')} of {parts[0]} in u{parts[1]}"
    if head == "channel" and len(parts) == 2:
        return f"{parts[1].replace('_', ' ')} of {parts[0]}"
    return (".".join(parts) if head in SAID_BY_TITLE and parts else name).removesuffix("_deg").replace("_", " ")


def _two_digits(value: float) -> float:
    return float(f"{value:.2g}")


def _is_open(name: str, entry: Mapping) -> bool:
    """Whether a value has a standard deviation of half of it and more; zero is a direction and an offset of layers."""
    return not name.endswith(OF_ANY_VALUE) and bool(entry["std"]) and abs(entry["value"]) < MIN_VALUE_STD * entry["std"]


def _stem(name: str) -> str:
    return name.partition("[")[0]


def _course(stem: str, entries: Mapping[str, Mapping]) -> str:
    """Unknowns of many frames: root mean square and largest value."""
    name = stem.removesuffix("_at").removesuffix("_knot").removesuffix("_jump")
    title = name.replace(".", " ").replace("_", " ") if name.startswith("camera.") else _of_cause(name)
    determined = {name: p for name, p in entries.items() if p["std"]}
    if not determined:
        return f"{title} not determined"
    largest = max(determined, key=lambda name: abs(determined[name]["value"]))
    std, unit = min(p["std"] for p in determined.values()), determined[largest]["unit"]
    if stem.endswith("_jump"):
        jumps = [f"{with_std(p['value'], p['std'], unit)} in frame {frame_of(name)}"
                 for name, p in sorted(determined.items(), key=lambda pair: int(frame_of(pair[0])))]
        return f"{title} by {' and '.join(jumps) if len(jumps) < 3 else ', '.join(jumps[:-1]) + ' and ' + jumps[-1]}"
    if stem.endswith("_knot"):  # a course that is zero at other knots
        supposed = f", for an expansion of {SUPPOSED_EXPANSION_PER_K:g} per K" if title == TEMPERATURE else ""
        return (f"{title} {with_std(determined[largest]['value'], determined[largest]['std'], unit)} at most, in frame "
                f"{frame_of(largest)}{supposed}")
    rms = math.sqrt(sum(p["value"] ** 2 for p in determined.values()) / len(determined))
    most = number_text(determined[largest]["value"], std)
    return (f"{title} {number_text(rms, std)} {unit} rms, {most} {unit} at most in frame "
            f"{frame_of(largest)}")


def frame_of(name: str) -> str:
    """The frame in the name of a degree of freedom, ``NAME[FRAME]``."""
    return name.partition("[")[2].removesuffix("]")


def _moves(content: Mapping) -> list[str]:
    """Parameters whose value the missing physics had biased."""
    identified, enriched = content["model"]["parameters_before"], content["model"]["parameters_after"]
    labels, shifts = short_names(enriched), []
    for name, biased in identified.items():
        corrected = enriched.get(name)
        if corrected is None or biased["value"] is None or biased["std"] is None:
            continue
        if abs(corrected["value"] - biased["value"]) > MIN_MOVE_STD * (corrected["std"] or biased["std"]):
            shifts.append(f"{labels[name]} moves from {with_std(biased['value'], biased['std'], biased['unit'])} to "
                          f"{with_std(corrected['value'], corrected['std'], corrected['unit'])}")
    return shifts


def _open(content: Mapping, titles: Mapping[str, str]) -> list[str]:
    """Groups of indistinguishable candidates; a name that stands twice is the same physics in two materials."""
    groups = []
    for group in content["indistinguishable"]:
        members = [_title(content, titles, name) + (" (in one material or another)" if group.count(name) > 1 else "")
                   for name in dict.fromkeys(group)]
        groups.append(f"{' and '.join(members)} are indistinguishable under this loading")
    return groups


def _blind(content: Mapping) -> str:
    if all(c["visibility"] < MAX_HIDDEN_VISIBILITY for c in content["candidates"]):
        return (f"{SAYS_NOTHING}: the identified parameters imitate the effect of every "
                "candidate.")
    return (f"{SAYS_NOTHING} of the specimen: the residual of images and channels is "
            "noise, and would hide a candidate of plausible size "
            f"({len(content['candidates'])} candidates tested{_bounds(content)}).")


def _outside(content: Mapping, titles: Mapping[str, str]) -> str:
    share = content["fit"]["explainable_share_recovered"]
    side = side_in_words(content)
    text = f"{_when_where(content)}{_unexplained(content)} that is unexplained by the library, probably from {side}"
    if content["named"] and share is not None:
        best = " and ".join(selected_titles(content, titles))
        text += f" (nearest candidate: {best}, {100.0 * share:.3g} % of the explainable residual)"
    return _capital(f"{text}. Do not trust the identified parameters.") + _next(content)


def side_in_words(content: Mapping) -> str:
    """Where an unexplained part probably comes from."""
    sides = [SIDE_WORDS.get(content["mismatch"].get(key)) for key in ("side", "located_side")]
    unexplained = content.get("unexplained", ())
    if unexplained and MOTION not in unexplained:
        sides.append(SIDE_WORDS["force"])
    return " or ".join(side for side in dict.fromkeys(sides) if side) or "the images"


def _unexplained(content: Mapping) -> str:
    """What is unexplained: motion, readings of channels."""
    return " and ".join(quantity if quantity == MOTION else f"a reading of {quantity}"
                        for quantity in content.get("unexplained", ())) or MOTION


def when_and_where(content: Mapping, sizes: bool = False, visible: bool = True) -> str:
    """Onset and place, "" where neither is known; sizes : the values of a cause stand beside it; visible : also since
    when it exceeds the practical margin.

    The centre of a fitted inclusion is the place then: that of the source elements, from the residual alone, is
    another one by up to its radius.
    """
    return _when_where(content, not (sizes and _has_own_place(content)), visible).removesuffix(": ")


def _has_own_place(content: Mapping) -> bool:
    """Whether a selected cause has a determined centre among its parameters, or begins at a point."""
    return bool(content.get("cracks")) or any(name.endswith(CENTRE) and entry["std"]
               for name, entry in content["model"].get("parameters_after", {}).items())


def _when_where(content: Mapping, with_place: bool = True, with_visible: bool = True) -> str:
    onset, place = content["mismatch"].get("onset_frame"), with_place and content["mismatch"].get("place")
    visible = with_visible and content["mismatch"].get("visible_frame")
    when = f"from frame {onset} on" if onset else "from the start" if onset == 0 else ""
    if began := _began(content):
        when = began
    elif onset == 0 and (visible or 0) > 1:
        when += f" (more than noise from frame {visible} on)"
    location = f"{place}" if place else ""
    head = ", ".join(part for part in (when, location) if part)
    return f"{head}: " if head else ""


def _began(content: Mapping) -> str:
    """Since when the amplitude of a single selected cause differs from zero, "" where it has no course or from the
    start."""
    first = [course["onset_frames"] for course in content.get("courses") or () if course.get("onset_frames")]
    if len(content["named"]) != 1 or not first:
        return ""
    last_at_zero, visible = min(first)
    if not last_at_zero:
        return ""
    return f"from frame {visible} on" if visible == last_at_zero + 1 else (f"from between frames {last_at_zero} and "
                                                                           f"{visible} on")


def _bounds(content: Mapping) -> str:
    unseen = set(content["cannot_tell"])
    n, m = len({exclusion["name"] for exclusion in content["excluded"]} - unseen), len(unseen)
    k, small = len(set(unconfirmed(content))), len(set(below_margin(content)))
    return ((f", {n} of them excluded with a bound" if n else "") + (f", {m} that this test cannot see" if m else "")
            + (f", {k} significant by the score but not by the refit" if k else "")
            + (f", {small} significant but below the practical margin" if small else ""))


def _next(content: Mapping) -> str:
    texts = [text for text in (content.get("next_experiment"), content.get("separate")) if text]
    return f" Next: {'; '.join(texts)}." if texts else ""


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
