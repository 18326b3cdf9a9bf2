"""`idic design --separate RUN`: plans ranked by the expected log-odds between the candidates, and the best course.

Content of ``separation`` in design.json: ``run``, ``members``; ``plans``, the best first:
``name``, ``log_odds`` (of its worst pair; null where a model does not get through), ``separated`` (pairs with 99:1),
``frames`` and ``load`` at which every pair reaches 99:1 (null: not in this plan), ``more_frames`` (factor that would),
``pairs``, ``problem``;
``course`` of the first plan with [design.program]: ``plan``, ``words``, ``program``, and the same; ``sentences``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from idic.errors import InputError, NotConverged
from idic.experiment_file import locate, read_toml, with_overrides
from idic.identification import expected_odds
from idic.run.separation.courses import Course, best_course
from idic.run.separation.members import Diagnosed, diagnosed, planned

ODDS_SHARE = 0.01  # in the rank, of the odds beside the chance: it decides between plans that both decide
MAX_SHOWN_ODDS = 999  # to one; more says no more


def separation_content(run: Path | str, paths: Sequence[Path | str], names: Sequence[str],
                       overrides: Mapping[str, Any] | None = None, noise_std_gv: float | None = None,
                       progress: Callable[[int, int], None] = lambda count, total: None) -> dict:
    """The entry ``separation`` of design.json.

    Parameters
    ----------
    run : a diagnosed RUN; paths, names : of the plans
    progress : called with the number of simulated courses and of all

    Raises
    ------
    InputError
        As `diagnosed` and `planned`.
    """
    origin = diagnosed(run)
    plans = [{"name": name, **_of_plan(origin, path, overrides, noise_std_gv)}
             for name, path in zip(names, paths, strict=True)]
    by_name = dict(zip(names, paths, strict=True))
    plans.sort(key=_merit, reverse=True)
    course = _course(origin, [(plan["name"], by_name[plan["name"]]) for plan in plans], overrides, noise_std_gv,
                     progress)
    content = {"run": str(run), "members": [model.name for model in origin.models], "plans": plans,
               "course": course}
    return content | {"sentences": sentences(content)}


def _merit(plan: Mapping) -> float:
    """What a plan is ranked by: the mean over the pairs of the chance that it decides, and of the odds where that is
    one. Two candidates that no plan tells apart must not make all plans alike; -inf where a model does not get through.
    """
    if plan["log_odds"] is None:
        return -np.inf
    log_odds = np.array([pair["log_odds"] for pair in plan["pairs"]])
    return float(np.mean(1.0 - np.exp(-log_odds) + ODDS_SHARE * np.log1p(log_odds)))


def _of_plan(origin: Diagnosed, path: Path | str, overrides: Mapping[str, Any] | None,
             noise_std_gv: float | None) -> dict:
    """The odds of every pair in one plan."""
    planned_tests = {model.name: planned(model, origin, path, overrides, noise_std_gv) for model in origin.models}
    try:
        pairs = [pair.content() for pair in expected_odds(planned_tests)]
    except NotConverged as problem:
        return {"log_odds": None, "frames": None, "load": None, "more_frames": None, "separated": 0,
                "pairs": [], "problem": str(problem)}
    worst = min(pairs, key=lambda pair: pair["log_odds"])
    is_whole = all(pair["frames"] is not None for pair in pairs)
    last_pair = max(pairs, key=lambda pair: pair["frames"] or 0)
    return {"log_odds": worst["log_odds"], "frames": last_pair["frames"] if is_whole else None,
            "load": last_pair["load"] if is_whole else None, "more_frames": worst["more_frames"],
            "separated": sum(pair["frames"] is not None for pair in pairs), "pairs": pairs, "problem": ""}


def _course(origin: Diagnosed, plans: Sequence[tuple[str, Path | str]],
            overrides: Mapping[str, Any] | None, noise_std_gv: float | None,
            progress: Callable[[int, int], None]) -> dict | None:
    """The best course of the first plan that has a programme; None without one."""
    for name, path in plans:
        program = with_overrides(read_toml(locate(path)), overrides).get("design", {}).get("program")
        if not program:
            continue

        def merit_of(course: Course, path: Path | str = path, program: Mapping = program) -> float:
            edits = {**(overrides or {}), "design.program": course.program(program)}
            try:
                return _merit(_of_plan(origin, path, edits, noise_std_gv))
            except InputError:
                return -np.inf  # a course that the plan refuses

        course, merit = best_course(program, merit_of, progress)
        if not np.isfinite(merit):
            return None
        courses = course.program(program)
        plan = _of_plan(origin, path, {**(overrides or {}), "design.program": courses}, noise_std_gv)
        return {"plan": name, "words": course.words, "program": courses, **plan}
    return None


def sentences(content: Mapping) -> list[str]:
    """What a reader wants to know first: the best plan, how far it goes, and the best course."""
    members = " and ".join(name.replace("_", " ") for name in content["members"])
    best, course = content["plans"][0], content["course"]
    if best["log_odds"] is None:
        return [f"No plan is simulated with {members}: {best['problem']}"]
    texts = [f"{best['name']} separates best between {members}: {_reach(best)}."]
    if course is not None:
        texts.append(f"Best course of {course['plan']}, in its time and up to its largest load: {course['words']}; "
                     f"{_reach(course)}.")
    if course is None or course["frames"] is None:
        texts += _undecided(best if course is None else course)
    return texts


def _reach(plan: Mapping) -> str:
    """How far a plan goes, in half a sentence."""
    if plan["frames"] is not None:
        load = "" if plan["load"] is None else f", at {100 * plan['load']:.0f} % of its largest load"
        return f"99:1 after {plan['frames']} frames{load}, {odds_text(plan['log_odds'])} at its end"
    if len(plan["pairs"]) > 1:
        return f"99:1 for {plan['separated']} of {len(plan['pairs'])} pairs"
    more = "" if plan["more_frames"] is None else f", 99:1 would take {plan['more_frames']:.2g} times the frames"
    return f"{odds_text(plan['log_odds'])} at its end{more}"


def _undecided(plan: Mapping) -> list[str]:
    """Pairs that stay together, in a sentence."""
    pairs = [" / ".join(name.replace("_", " ") for name in pair["members"]) + f" ({odds_text(pair['log_odds'])})"
             for pair in plan["pairs"] if pair["frames"] is None]
    return [f"Not separated by 99:1: {', '.join(pairs)}. A plan with another specimen, direction or sensor may."]


def odds_text(log_odds: float) -> str:
    """Odds to one, as far as they say something."""
    if log_odds > np.log(MAX_SHOWN_ODDS):
        return f"over {MAX_SHOWN_ODDS}:1"
    return f"{np.exp(log_odds):.2g}:1"
