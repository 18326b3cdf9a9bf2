"""Whether the motion in the images, the log and the times of the files confirm the order of the names.

Images in the order of time change by small steps. A wrong order has a jump that another order has not. Where the log
jumps at the same place, the jump happened.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.measure.sequence.thumbnails import length, smoothest_order, steps

MIN_FRAMES = 4
MIN_JUMP = 1.4  # largest step of the names over that of the smoothest order: a jump
MIN_JUMP_SHARE = 0.1  # of the largest distance of two images, by which the largest steps differ
MIN_GAIN = 1.1  # length of the order of the names over that of the smoothest one
MAX_EXCESS = 1.05  # of the length of an order that is as smooth as the smoothest one
MIN_AGREEMENT, MIN_BETTER = 0.7, 0.1  # correlation of distances between images and in the log: of a right order, and
#                                       by how much it surpasses a wrong one
MIN_AGREEMENT_OF_ANOTHER = 0.9  # of the order that refutes the names: the smoothest way through a random walk has 0.75
MIN_MOTION, MIN_MOTION_PX = 2.0, 0.25  # largest distance of two images over the smallest, and itself: less is noise
MAX_LISTED = 40  # images of an order that a message writes whole
_OF_FILES = {"written": "the times in the files", "saved": "the times at which the files were saved"}


@dataclass(frozen=True, eq=False)
class OrderEvidence:
    """What says in which order the images of a test are; they are in that of their names.

    distance : (n, n) px between images; courses : (m, n) columns of the log over their range; paths : of the images;
    proposals : orders by the files, as places in `paths`
    """

    distance: np.ndarray
    courses: np.ndarray
    paths: Sequence[Path]
    proposals: Mapping[str, Sequence[int]]

    @property
    def names(self) -> list[int]:
        """The order of the names."""
        return list(range(len(self.paths)))

    def check(self) -> None:
        """InputError where another order explains images and log, and that of the names does not."""
        if self._is_confirmed_at_once():
            return
        right = self._right_order()
        if right is None:
            return
        step, labels = steps(self.distance, self.names), [path.name for path in self.paths]
        jump = int(np.argmax(step))
        finding = (f"with a step of about {step[jump]:.2g} px from {labels[jump]} to {labels[jump + 1]} (others: "
                   f"{np.median(step):.2g} px)" if step[jump] > MIN_JUMP * np.median(step)
                   else "whose motion is not that of the log")
        name = self._name(right)
        raise InputError(
            "the motion in the images contradicts the order of their names", key="experiment.order",
            file=self.paths[0].parent,
            expected=f"small steps of the pattern from image to image, as in {_shown([labels[k] for k in right])}"
                     + (f", the order of {_OF_FILES[name]}" if name in _OF_FILES else ""),
            found=f"{_shown(labels)}, {finding}",
            remedy=f"look at the images. If the first order is right, write {self._statement(right)} under "
                   '[experiment]; if that of the names is right, write order = "names"')

    def warnings(self) -> list[str]:
        """Orders by the times of the files that are not that of the names."""
        labels = [path.name for path in self.paths]
        times = {name: order for name, order in self.proposals.items() if name in _OF_FILES and order != self.names}
        is_smooth = bool(times) and self._is_smooth()
        confirmed = {name: is_smooth and list(order) != self.names[::-1] for name, order in times.items()}
        meaning = {True: "The motion in the images is that of the names",
                   False: "The motion in the images does not decide"}  # backwards it is as smooth
        return [f"two orders of the images: {_shown(labels)} by their names, {_shown([labels[k] for k in order])} by "
                f'{_OF_FILES[name]}. {meaning[confirmed[name]]}: write order = "names", or {self._statement(order)}'
                for name, order in times.items() if name == "written" or not confirmed[name]]

    def _is_confirmed_at_once(self) -> bool:
        """Whether nothing speaks against the names: too few images, no motion, no jump, or that of the log."""
        if len(self.paths) < MIN_FRAMES or not _shows_motion(self.distance):
            return True
        nearest = np.where(np.eye(len(self.distance), dtype=bool), np.inf, self.distance).min(axis=1)
        return bool(steps(self.distance, self.names).max() < MIN_JUMP * np.median(nearest))

    def _is_smooth(self) -> bool:
        if len(self.paths) < MIN_FRAMES or not _shows_motion(self.distance):
            return False
        if _agreement(self.names, self.distance, self.courses) > MIN_AGREEMENT:
            return True
        shortest = length(self.distance, smoothest_order(self.distance, [self.names]))
        return length(self.distance, self.names) <= MAX_EXCESS * shortest

    def _right_order(self) -> list[int] | None:
        """The first order that is better than that of the names."""
        names = self.names
        proposals = [list(order) for order in self.proposals.values() if list(order) != names]
        best = smoothest_order(self.distance, [names, *proposals])
        candidates = [*proposals, _towards(best, self.distance, self.courses)]
        return next((order for order in candidates
                     if order != names and _refutes(order, names, self.distance, self.courses)), None)

    def _name(self, order: Sequence[int]) -> str:
        return next((name for name, proposal in self.proposals.items() if list(proposal) == list(order)), "")

    def _statement(self, order: Sequence[int]) -> str:
        """The line that states an order."""
        name = self._name(order)
        if name and name not in _OF_FILES:
            return f'order = "{name}"'
        files = [f'"{self.paths[k].parent.name}/{self.paths[k].name}"' for k in order]
        listed = ", ".join(files) if len(files) <= MAX_LISTED else f"{', '.join(files[:3])}, …, {files[-1]}"
        return f'order = "listed" with images = [{listed}]'


def _shows_motion(distance: np.ndarray) -> bool:
    pairs_px = distance[~np.eye(len(distance), dtype=bool)]
    return len(pairs_px) > 0 and pairs_px.max() > max(MIN_MOTION * float(pairs_px.min()), MIN_MOTION_PX)


def _refutes(order: Sequence[int], names: Sequence[int], distance: np.ndarray, courses: np.ndarray) -> bool:
    """Whether this order is better than that of the names, by the images and by the log."""
    if len(courses):
        at = _places(order)
        agreement = _agreement(order, distance, courses, at)
        return agreement > max(MIN_AGREEMENT_OF_ANOTHER, _agreement(names, distance, courses, at) + MIN_BETTER)
    step, step_of_names = steps(distance, order), steps(distance, names)
    jump = step_of_names.max() - step.max()
    return bool(step_of_names.max() > MIN_JUMP * step.max() and jump > MIN_JUMP_SHARE * distance.max()
                and step_of_names.sum() > MIN_GAIN * step.sum())


def _places(order: Sequence[int]) -> np.ndarray:
    """The places that an order changes, and two on both sides of them."""
    changed = np.flatnonzero(np.array(order) != np.arange(len(order)))
    return np.arange(max(changed[0] - 2, 0), min(changed[-1] + 3, len(order)))


def _agreement(order: Sequence[int], distance: np.ndarray, courses: np.ndarray,
               places: np.ndarray | None = None) -> float:
    """Correlation of the distances of the images, placed in an order, with those of the rows of the log, of the column
    that has the largest; places : of the images that count, None: all."""
    at = np.arange(len(order)) if places is None else places
    first, second = np.triu_indices(len(at), 1)
    pairs = at[first], at[second]
    in_images = distance[np.ix_(list(order), list(order))][pairs]
    in_log = [np.abs(course[pairs[0]] - course[pairs[1]]) for course in courses]
    return max((float(np.corrcoef(column, in_images)[0, 1]) for column in in_log
                if np.ptp(column) > 0.0 and np.ptp(in_images) > 0.0), default=0.0)


def _towards(order: Sequence[int], distance: np.ndarray, courses: np.ndarray) -> list[int]:
    """The order or its reverse: which the log follows clearly better, or in which more pairs are as in the names."""
    ways = list(order), list(order)[::-1]
    agreements = [_agreement(way, distance, courses) for way in ways]
    if abs(agreements[0] - agreements[1]) > MIN_BETTER:
        return max(ways, key=lambda way: _agreement(way, distance, courses))
    rising = sum(1 if later > k else -1 for k, later in combinations(order, 2))
    return ways[0] if rising >= 0 else ways[1]


def _shown(labels: Sequence[str]) -> str:
    if len(labels) <= 6:
        return ", ".join(labels)
    return f"{', '.join(labels[:3])} … {', '.join(labels[-2:])}"
