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

import numpy as np

from idic.diagnose.discretisation.following import moved
from idic.diagnose.discretisation.sheet import Left, Sheet, SheetAndBricks, sheet_at
from idic.diagnose.discretisation.thickness_std import taken_back
from idic.diagnose.residual.heldout import misfit_of
from idic.diagnose.residual.score import null_model
from idic.diagnose.residual.subspace import Grid
from idic.errors import NotConverged
from idic.identification import Identification
from idic.model import MotionError
from idic.simulation_error import Bricks

MAX_TURNS, TURNED_STD = 12, 0.1  # of error and parameters; standard deviations of the last step
SETTLED_SHARE = 1e-4  # of the mismatch in chi-square: a last step that would bring less is of no use to a wrong model
PARTS_OF_STEP = (1.0, 0.5, 0.25, 0.125)


def in_turns(identification: Identification, mesh: MotionError | None, grid: Grid, bar: float = np.inf,
             first: MotionError | None = None,
             begun: SheetAndBricks | None = None) -> tuple[MotionError, Identification] | None:
    """The error of plane stress on top of that of the mesh, and the parameters that belong to it; None where bricks
    cannot be simulated, or where chi-square does not fall below the bar.

    Every turn takes the whole step of the parameters (module), or the first of its parts that leaves them less to
    move and at which bricks find an equilibrium: before the first turn a plate that yields may be seven standard
    deviations off. Where no part does, the turns end with the error that has been found; so they do where the last step
    brings a ten-thousandth of the mismatch, as a model that is wrong by more has no parameters to be known so well.

    first : the error of plane stress of `identification`, where it has been computed; begun : with its derivatives
    """
    if begun is None:
        try:
            sheet = sheet_at(identification)
        except NotConverged:
            return None
        bricks = Bricks.of(sheet.identification.model_point, sheet.frames) if first is None else Bricks(first)
    else:
        sheet, bricks = begun.sheet, begun.bricks
    if bricks is None:
        return None
    remainder = sheet.left(bricks.error.on_top_of(mesh))
    scale, slope = remainder.std, np.eye(len(remainder.step))
    if bricks.changes is not None:
        slope -= taken_back(remainder.residual, null_model(remainder.residual.evidence, remainder.residual.null),
                            bricks.changes)
    misfit = misfit_of(remainder.residual, grid)
    for _ in range(1, MAX_TURNS):
        settled = remainder.gain < SETTLED_SHARE * float(misfit.gain.sum() - misfit.rank.sum())
        if settled or np.abs(remainder.reached(remainder.step)).max(initial=0.0) < TURNED_STD:
            break
        whole_step = scale * np.linalg.lstsq(slope, remainder.step / scale)[0]
        turn = turned(sheet, remainder, bricks, whole_step) or turned(sheet, remainder, bricks, remainder.step)
        if turn is None:
            return bricks.error.on_top_of(mesh), remainder.identification
        former, at, (sheet, bricks) = remainder, sheet.identification.parameters, turn
        remainder = sheet.left(bricks.error.on_top_of(mesh))
        step = np.array([sheet.identification.parameters[name].value - at[name].value for name in at.free])
        slope = learned(slope, step / scale, (former.step - remainder.step) / scale,
                        remainder.gram * np.outer(scale, scale))
        misfit = misfit_of(remainder.residual, grid)
        if misfit.chi2 - remainder.gain >= bar:
            return None
    return bricks.error.on_top_of(mesh), remainder.at(remainder.step)


def turned(sheet: Sheet, remainder: Left, bricks: Bricks, step: np.ndarray) -> tuple[Sheet, Bricks] | None:
    """Sheet and bricks after a step of the free parameters, or the first of its parts after which they would move less
    beside the error that is known; None where none does or bricks cannot be simulated.

    remainder : residual and remaining step at the sheet; step : (n,), in the order of its free parameters
    """
    for part in PARTS_OF_STEP:
        tried = moved(sheet.identification,
                      dict(zip(sheet.identification.parameters.free, (part * step).tolist(), strict=True)))
        try:
            neighbour = sheet_at(tried, sheet)
        except NotConverged:
            continue
        if neighbour.left(remainder.error).gain < remainder.gain:
            bricks_there = Bricks.of(neighbour.identification.model_point, neighbour.frames, bricks)
            if bricks_there is not None:
                return neighbour, bricks_there
    return None


def learned(slope: np.ndarray, step: np.ndarray, change: np.ndarray, gram: np.ndarray) -> np.ndarray:
    """Derivative of the remaining step by the step taken, true to the last step and unchanged across it  # (n, n)

    step, change : (n,) step taken, and decrease of the remaining step; gram : (n, n) the metric
    """
    weight = gram @ step
    return slope + np.outer(change - slope @ step, weight) / max(float(step @ weight), 1e-300)
