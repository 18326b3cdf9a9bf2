"""Courses of a planned test among holds, unloadings, reversals and directions, and the search for the best one.

A course is the share of the plan's largest load at four times, in a direction: the sign by which every column moves.
It takes as long and as many frames as the plan, and never more load. The search begins with the best of a menu and
changes one time after the other, then the direction.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

Program = Mapping[str, Sequence[Sequence[float]]]
Shape = tuple[float, ...]
Direction = tuple[tuple[str, int], ...]

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

    words : what it does; shape : shares of the largest load at four times
    direction : (column, sign) of those that move; sign -1: against the course of the plan
    """

    words: str
    direction: Direction
    shape: Shape

    def program(self, plan: Program) -> dict[str, list[list[float]]]:
        """The courses under [design.program]; columns that do not move stay at zero."""
        end = max(points[-1][0] for points in plan.values())
        times = [end * k / len(self.shape) for k in range(len(self.shape) + 1)]
        signs = dict(self.direction)
        return {column: [[round(time, 9), round(peak(points) * share * signs.get(column, 0), 9)]
                         for time, share in zip(times, (0.0, *self.shape), strict=True)]
                for column, points in plan.items()}


def peak(points: Sequence[Sequence[float]]) -> float:
    """The value of a course that is farthest from zero."""
    return max((value for _, value in points), key=abs)


def directions(plan: Program) -> tuple[Direction, ...]:
    """All columns together, each alone, and each pair against one another; one column has one direction."""
    columns = tuple(plan)
    if len(columns) == 1:
        return (((columns[0], 1),),)
    return (tuple((column, 1) for column in columns), *(((column, 1),) for column in columns),
            *(((first, 1), (second, -1)) for first, second in combinations(columns, 2)))


def menu(plan: Program) -> Iterator[Course]:
    """The courses that a search begins with: every shape in all columns, and a load and unload in other directions."""
    together, *further_directions = directions(plan)
    yield from (_course(together, shape, plan) for shape in MENU.values())
    yield from (_course(direction, MENU["load, then unload"], plan) for direction in further_directions)


def neighbours(course: Course, plan: Program) -> Iterator[Course]:
    """The course with another level at one of its times (the largest load is reached), or another direction."""
    for k, present_level in enumerate(course.shape):
        for level in LEVELS:
            shape = (*course.shape[:k], level, *course.shape[k + 1:])
            if level != present_level and max(map(abs, shape)) == 1.0:
                yield _course(course.direction, shape, plan)
    for direction in directions(plan):
        if direction != course.direction:
            yield _course(direction, course.shape, plan)


def _course(direction: Direction, shape: Shape, plan: Program) -> Course:
    """A course with its words."""
    bare = Course("", direction, shape)
    return replace(bare, words=direction_words(direction, plan) + in_words(shape))


def direction_words(direction: Direction, plan: Program) -> str:
    """What moves, before the words of a shape; nothing where all columns move as planned."""
    if direction == directions(plan)[0]:
        return ""
    forward, against = (" and ".join(column for column, sign in direction if sign == way) for way in (1, -1))
    return f"{forward} against {against}, " if against else f"{forward} alone, "


def in_words(shape: Shape) -> str:
    """A course by its levels."""
    menu_words = next((words for words, levels in MENU.items() if levels == shape), None)
    levels_text = ", ".join(f"{100 * share:.0f}" for share in shape)
    return menu_words or f"load by way of {levels_text} % of the largest load"


def best_course(plan: Program, merit_of: Callable[[Course], float],
                progress: Callable[[int, int], None] = lambda count, total: None) -> tuple[Course, float]:
    """The course with the largest merit that the search meets, and its merit; -inf of courses that do not end."""
    values: dict[tuple[Direction, Shape], float] = {}

    def value(course: Course) -> float:
        key = (course.direction, course.shape)
        if key not in values:
            values[key] = merit_of(course)
            progress(len(values), MAX_TRIALS)
        return values[key]

    best = max(menu(plan), key=value)
    improves = True
    while improves and len(values) < MAX_TRIALS:
        improves = False
        for trial in neighbours(best, plan):
            if len(values) >= MAX_TRIALS:
                break
            if value(trial) > value(best):
                best, improves = trial, True
                break
    return best, value(best)
