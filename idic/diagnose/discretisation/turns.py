"""The error of plane stress and the parameters that belong to it, found in turns.

With the error e held, the parameters p of the least-squares solution have a step s(p, e) left; with the new parameters
bricks move otherwise. Wanted is s(p, e(p)) = 0. A turn that takes the whole step converges by a factor D, the part of
it that the new error takes back; what the turns show of

    s(p + d, e(p + d)) = s(p, e(p)) - (1 - D) d

begins at the derivatives of the error, where they are known, and is learned by Broyden's rule (Math. Comput. 19 (1965)
577, doi:10.1090/S0025-5718-1965-0198670-6) in the metric of chi-square, in which it does not depend on the units of the
parameters, and the next turn takes (1 - D)^-1 s.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.correlation import FrameResponse, correlated_frames
from idic.diagnose.discretisation.bricks import Bricks, bricks_of, simulated_sheet
from idic.diagnose.discretisation.following import at_values, following, moved
from idic.diagnose.discretisation.thickness_std import taken_back
from idic.diagnose.residual.heldout import fit
from idic.diagnose.residual.residual_evidence import ResidualEvidence, residual_evidence
from idic.diagnose.residual.score import null_model
from idic.diagnose.residual.subspace import Grid
from idic.errors import NotConverged
from idic.identification import Identification
from idic.model import MotionError

MAX_TURNS, TURNED_STD = 12, 0.1  # of error and parameters; standard deviations of the last step
SETTLED_SHARE = 1e-4  # of the mismatch in chi-square: a last step that would bring less is of no use to a wrong model
PARTS_OF_STEP = (1.0, 0.5, 0.25, 0.125)


@dataclass(frozen=True, eq=False)
class Left:
    """What the parameters would still move beside a held error.

    found : with the error; step, std : (n,) of the free parameters, those that a bound holds back at rest; gain : of
    chi-square by the step; gram : (n, n) its second derivative, halved
    """

    found: Identification
    residual: ResidualEvidence
    step: np.ndarray
    std: np.ndarray
    gain: float
    gram: np.ndarray

    def at(self, step: np.ndarray) -> Identification:
        """After a step of the free parameters  # (n,)"""
        return moved(self.found, dict(zip(self.found.parameters.free, step.tolist(), strict=True)))

    def reached(self, step: np.ndarray) -> np.ndarray:
        """The part of a step that the bounds of the parameters leave, in standard deviations  # (n,)"""
        there = self.at(step).parameters
        return np.array([there[name].value - self.found.parameters[name].value for name in there.free]) / self.std


@dataclass(frozen=True, eq=False)
class Sheet:
    """A model simulated in plane stress, with derivatives by `names`, once for all errors; found : without an error"""

    found: Identification
    frames: tuple[FrameResponse, ...]
    names: tuple[str, ...]

    def guesses(self, other: Identification, names: Sequence[str]) -> Iterator[np.ndarray]:
        """First guesses at other parameters, which the frames are differentiated by: to first order  # (n_nodes, 2)"""
        change = np.array([other.parameters[name].value - self.found.parameters[name].value for name in names])
        return (one.u + one.du @ change for one in self.frames)

    def left(self, error: MotionError) -> Left:
        """Beside an error."""
        experiment = self.found.experiment
        there = at_values(self.found, replace(experiment, motion_error=error), self.found.parameters.as_values())
        wanted = set(correlated_frames(experiment, range(experiment.n_frames)))
        responses = [replace(one, u=one.u + error.u[one.frame], channels=one.channels + error.channels[one.frame])
                     for one in self.frames if one.frame in wanted]
        residual = residual_evidence(there, light=False, responses=responses)
        null, (steps, gain) = null_model(residual.evidence, residual.null), following(residual)
        return Left(there, residual, np.array([steps.get(name, 0.0) for name in null.names]),
                    np.sqrt(np.maximum(np.diagonal(null.covariance), 1e-300)), gain,
                    null.gram)


def sheet_at(found: Identification, near: Sheet | None = None) -> Sheet:
    """The sheet at the parameters of an identification; near : at similar ones.

    Raises
    ------
    NotConverged
        If equilibrium is not found.
    """
    there = at_values(found, replace(found.experiment, motion_error=None), found.parameters.as_values())
    names = tuple(name for name in there.parameters.free if there.forward.moves(name))
    guesses = None if near is None else near.guesses(there, names)
    return Sheet(there, tuple(simulated_sheet(there, names, guesses)), names)


@dataclass(frozen=True, eq=False)
class Begun:
    """A model in plane stress and its bricks, with the derivatives of the error."""

    sheet: Sheet
    bricks: Bricks


def begun_at(found: Identification) -> Begun | None:
    """Where turns may begin; None where one of the two cannot be simulated."""
    try:
        sheet = sheet_at(found)
    except NotConverged:
        return None
    bricks = bricks_of(sheet.found, sheet.frames, of_sheet=sheet.names)
    return None if bricks is None else Begun(sheet, bricks)


def in_turns(found: Identification, mesh: MotionError | None, grid: Grid, bar: float = np.inf,
             first: MotionError | None = None, begun: Begun | None = None) -> tuple[MotionError, Identification] | None:
    """The error of plane stress on top of that of the mesh, and the parameters that belong to it; None where bricks
    cannot be simulated, or where chi-square does not fall below the bar.

    Every turn takes the whole step of the parameters (module), or the first of its parts that leaves them less to
    move and at which bricks find an equilibrium: before the first turn a plate that yields may be seven standard
    deviations off. Where no part does, the turns end with the error that has been found; so they do where the last step
    brings a ten-thousandth of the mismatch, as a model that is wrong by more has no parameters to be known so well.

    first : the error of plane stress of `found`, where it has been computed; begun : with its derivatives
    """
    if begun is None:
        try:
            sheet = sheet_at(found)
        except NotConverged:
            return None
        bricks = bricks_of(sheet.found, sheet.frames) if first is None else Bricks(first)
    else:
        sheet, bricks = begun.sheet, begun.bricks
    if bricks is None:
        return None
    left = sheet.left(_on_top(mesh, bricks))
    scale, slope = left.std, np.eye(len(left.step))
    if bricks.changes is not None:
        slope -= taken_back(left.residual, null_model(left.residual.evidence, left.residual.null), bricks.changes)
    there = fit(left.residual, grid)
    for _ in range(1, MAX_TURNS):
        settled = left.gain < SETTLED_SHARE * float(there.gain.sum() - there.rank.sum())
        if settled or np.abs(left.reached(left.step)).max(initial=0.0) < TURNED_STD:
            break
        further = scale * np.linalg.lstsq(slope, left.step / scale)[0]
        turn = turned(sheet, left, bricks, further) or turned(sheet, left, bricks, left.step)
        if turn is None:
            return _on_top(mesh, bricks), left.found
        before, at, (sheet, bricks) = left, sheet.found.parameters, turn
        left = sheet.left(_on_top(mesh, bricks))
        taken = np.array([sheet.found.parameters[name].value - at[name].value for name in at.free])
        slope = learned(slope, taken / scale, (before.step - left.step) / scale, left.gram * np.outer(scale, scale))
        there = fit(left.residual, grid)
        if there.chi2 - left.gain >= bar:
            return None
    return _on_top(mesh, bricks), left.at(left.step)


def turned(sheet: Sheet, here: Left, bricks: Bricks, step: np.ndarray) -> tuple[Sheet, Bricks] | None:
    """Sheet and bricks after a step of the free parameters, or the first of its parts after which they would move less
    beside the error that is known; None where none does or bricks cannot be simulated.

    here : residual and remaining step at the sheet; step : (n,), in the order of its free parameters
    """
    for part in PARTS_OF_STEP:
        tried = moved(sheet.found, dict(zip(sheet.found.parameters.free, (part * step).tolist(), strict=True)))
        try:
            there = sheet_at(tried, sheet)
        except NotConverged:
            continue
        known = here.found.experiment.motion_error
        if there.left(known).gain < here.gain:  # type: ignore[arg-type]
            found = bricks_of(there.found, there.frames, bricks)
            if found is not None:
                return there, found
    return None


def learned(slope: np.ndarray, taken: np.ndarray, change: np.ndarray, gram: np.ndarray) -> np.ndarray:
    """Derivative of the remaining step by the step taken, true to the last step and unchanged across it  # (n, n)

    taken, change : (n,) step taken, and decrease of the remaining step; gram : (n, n) the metric
    """
    weight = gram @ taken
    return slope + np.outer(change - slope @ taken, weight) / max(float(taken @ weight), 1e-300)


def _on_top(mesh: MotionError | None, bricks: Bricks) -> MotionError:
    """The error of plane stress on top of that of the mesh."""
    nothing = MotionError(np.zeros_like(bricks.error.u), np.zeros_like(bricks.error.channels))
    return (mesh or nothing).with_thickness(bricks.error)
