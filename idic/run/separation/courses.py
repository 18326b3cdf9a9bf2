"""Courses of a planned test among holds, unloadings, reversals and directions, and the search for the best one.

A course is the share of the plan's largest load at four times; it takes as long and as many frames as the plan, and
never more load. The search begins with the best of a menu and changes one time after the other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

Program = Mapping[str, Sequence[Sequence[float]]]
Shape = tuple[float, ...]

LEVELS = (-1.0, 0.0, 0.5, 1.0)  # shares of the largest load
MENU: dict[str, Shape] = {
    "load steadily": (0.25, 0.5, 0.75, 1.0), "load, then hold": (0.5, 1.0, 1.0, 1.0),
    "load, then unload": (0.5, 1.0, 0.5, 0.0), "load, unload, then wait": (1.0, 0.0, 0.0, 0.0),
    "load, unload, load again": (1.0, 0.0, 1.0, 1.0), "load, then reverse": (1.0, 0.5, -0.5, -1.0),
    "load the other way": (-0.25, -0.5, -0.75, -1.0), "hold half, then load": (0.5, 0.5, 0.5, 1.0)}
MAX_TRIALS = 36  # courses of a search, each simulated with every model


@dataclass(frozen=True)
class Course:
    """A course of the columns of a plan.

    words : what it does; columns : those that move; shape : shares of the largest load at four times
    """

    words: str
    columns: tuple[str, ...]
    shape: Shape

    def program(self, plan: Program) -> dict[str, list[list[float]]]:
        """The courses under [design.program]; columns that do not move stay at zero."""
        end = max(points[-1][0] for points in plan.values())
        times = [end * k / len(self.shape) for k in range(len(self.shape) + 1)]
        return {column: [[round(time, 9), round(peak(points) * share * (column in self.columns), 9)]
                         for time, share in zip(times, (0.0, *self.shape), strict=True)]
                for column, points in plan.items()}


def peak(points: Sequence[Sequence[float]]) -> float:
    """The value of a course that is farthest from zero."""
    return max((value for _, value in points), key=abs)


def menu(plan: Program) -> Iterator[Course]:
    """The courses that a search begins with: every shape in all columns, and steady load in each column alone."""
    columns = tuple(plan)
    yield from (Course(words, columns, shape) for words, shape in MENU.items())
    if len(columns) > 1:
        yield from (Course(f"{column} alone, load, then unload", (column,), MENU["load, then unload"])
                    for column in columns)


def neighbours(course: Course) -> Iterator[Course]:
    """The course with another level at one of its times, as long as it reaches the largest load."""
    for k, present_level in enumerate(course.shape):
        for level in LEVELS:
            shape = (*course.shape[:k], level, *course.shape[k + 1:])
            if level != present_level and max(map(abs, shape)) == 1.0:
                yield Course(in_words(shape), course.columns, shape)


def in_words(shape: Shape) -> str:
    """A course by its levels."""
    menu_words = next((words for words, levels in MENU.items() if levels == shape), None)
    levels_text = ", ".join(f"{100 * share:.0f}" for share in shape)
    return menu_words or f"load by way of {levels_text} % of the largest load"


def best_course(plan: Program, merit_of: Callable[[Course], float],
                progress: Callable[[int, int], None] = lambda count, total: None) -> tuple[Course, float]:
    """The course with the largest merit that the search meets, and its merit; -inf of courses that do not end."""
    values: dict[tuple[tuple[str, ...], Shape], float] = {}

    def value(course: Course) -> float:
        key = (course.columns, course.shape)
        if key not in values:
            values[key] = merit_of(course)
            progress(len(values), MAX_TRIALS)
        return values[key]

    best = max(menu(plan), key=value)
    improves = True
    while improves and len(values) < MAX_TRIALS:
        improves = False
        for trial in neighbours(best):
            if len(values) >= MAX_TRIALS:
                break
            if value(trial) > value(best):
                best, improves = trial, True
                break
    return best, value(best)
