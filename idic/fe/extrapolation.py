"""Extrapolation in time: two simulations with n/2 and n increments between two frames, and their limit.

The laws are integrated by backward Euler: the error of every frame begins with C h, h the length of an increment. Of
solutions with h and 2 h (Richardson's extrapolation, Hairer, Nørsett & Wanner 1993, section II.9,
doi:10.1007/978-3-540-78862-1)

    u = (2^p u_h - u_2h) / (2^p - 1),   p = 1

has an error of the next order (docs/method.md, equation 12.8); so have the channels. The weights are constants, so that
derivatives are extrapolated by the same formula and stay exact. Values that are prescribed are met by both, and by u.

The increments of both are frozen together: in a list of end times the fine ones come first, the coarse ones begin where
time goes back.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise, tee
from threading import Lock
from typing import TypeVar

import numpy as np

from idic.fe.equilibrium import Control
from idic.fe.time_march import FrameState, StepList, march
from idic.fe.body.body import Direction, Body

T = TypeVar("T")


def march_extrapolated(body: Body, params: Mapping[str, np.ndarray], times: np.ndarray,
                       directions: Sequence[Direction] = (), steps: StepList | None = None, increments: int = 2,
                       control: Control | None = None, warm_start: Iterable[np.ndarray] | None = None,
                       may_cut: bool = False) -> Iterator[FrameState]:
    """Simulate the whole test twice, side by side, and yield the extrapolated `FrameState` of every frame.

    Its points are those of the fine simulation.

    Parameters
    ----------
    increments : per frame, of the fine simulation, even; the coarse one takes half of them
    params, times, directions, steps, control, warm_start, may_cut : as for `idic.fe.time_march.march`

    Raises
    ------
    InputError, NotConverged
        As `idic.fe.time_march.march`, where one of the two fails.
    """
    numbers, warm = (increments, increments // 2), (None, None) if warm_start is None else for_two(warm_start)
    frozen = [None, None] if steps is None else [StepList(ends) for ends in steps.split()]
    fine, coarse = (march(body, params, times, directions, step_list, number, control, start, may_cut)
                    for step_list, number, start in zip(frozen, numbers, warm, strict=True))
    order = time_order(body)
    for fine_state, coarse_state in zip(fine, coarse, strict=True):
        yield _extrapolated(fine_state, coarse_state, order)


def for_two(items: Iterable[T]) -> tuple[Iterator[T], Iterator[T]]:
    """The same items twice, for two simulations each of which may look ahead in a thread of its own."""
    lock = Lock()

    def one_by_one(shared: Iterator[T]) -> Iterator[T]:
        while True:
            with lock:
                try:
                    item = next(shared)
                except StopIteration:
                    return
            yield item

    first, second = tee(items)
    return one_by_one(first), one_by_one(second)


def time_order(body: Body) -> int:
    """Order of the error of a simulation in the length of its increments: the lowest among its laws with a history."""
    return min((section.law.spec.time_order for section in body.sections if section.law.spec.n_state), default=1)


def _extrapolated(fine: FrameState, coarse: FrameState, order: int) -> FrameState:
    share = 1.0 / (2.0**order - 1.0)
    ahead = {name: getattr(fine, name) + share * (getattr(fine, name) - getattr(coarse, name))
             for name in ("u", "channels", "du", "dchannels", "local_du", "local_dchannels", "rise", "d_rise",
                          "local_rise")
             if getattr(fine, name) is not None}
    return replace(fine, n_newton=fine.n_newton + coarse.n_newton,
                   steps=StepList(fine.steps.times + coarse.steps.times), **ahead)


def whole_increments(times: np.ndarray, number: int) -> tuple[float, ...]:
    """End times (s) of `number` equal increments between two frames; times : (n_frames,) s"""
    return tuple(float(t) for a, b in pairwise(times)
                 for t in np.append(a + (b - a) / number * np.arange(1, number), b))


def increments_to_try(body: Body, times: np.ndarray, substeps: int, last_ends: Sequence[float] | None,
                      extrapolated: bool = False) -> list[tuple[float, ...] | None]:
    """Lists of increments for a model whose parameters moved since it was last solved, in the order to try them.

    Parameters
    ----------
    times : (n_frames,) s
    substeps : increments per frame; of the fine simulation, where two are extrapolated
    last_ends : end times of the increments of the last solution; None: there is none

    Returns
    -------
    list
        Increments are kept as they were, so that solutions are comparable, and chosen anew (None) where they fail.
        But cuts that only a poor start needed are dropped as soon as whole increments converge: otherwise they would
        remain as an error of the time integration. (Not with follower pressures, whose first increments are small on
        purpose.)
    """
    if last_ends is None:
        return [None]
    uncut_ends = whole_increments(times, substeps)
    if extrapolated:
        uncut_ends += whole_increments(times, substeps // 2)
    more = len(last_ends) > len(uncut_ends) and not body.loads.pressure_faces
    return [*([uncut_ends] if more else []), tuple(last_ends), None]
