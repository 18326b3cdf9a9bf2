"""Time course of the residual: motion that follows the effect of the selected candidate in time.

A formal fit leaves motions that follow its effect in time: a cut that was fitted by an inclusion with next to no
stiffness, an uneven grip by a rotating one. Free motions of every frame (`idic.diagnose.residual.heldout`) share their
chi-square with the noise of all frames; motions with the time course of the effect concentrate it: uneven grips have an
excess of 14 to 26 standard deviations, and 4.7 to 6.4 in free motions. Motions collinear with the enriched model's
parameters are projected out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy import sparse

from idic.diagnose.residual.evidence import Evidence
from idic.diagnose.residual.excess import power
from idic.diagnose.residual.excess_left import MAX_INCLUSION_EXCESS_LEFT, ExcessLeft
from idic.diagnose.residual.heldout import Misfit
from idic.diagnose.residual.margin import ASSUMED, Margin
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.diagnose.residual.score import null_model
from idic.diagnose.residual.subspace import Grid, gain_and_rank, hats, projected

GRID_REFINEMENT = 2  # cells of this grid per cell of the free motions: the excess of a cut is narrow


def time_course_test(base: ResidualEvidence, enriched: ResidualEvidence, grid: Grid,
                     margin: Margin = ASSUMED) -> ExcessLeft:
    """Excess of the motions with the time course of the added candidate.

    Parameters
    ----------
    base, enriched : the whole recording under the identified and the enriched model
    grid : of the free motions
    margin : of the recording

    An inclusion explains most of any local compliance: with one in the model the bound on the excess is lower.
    """
    fine = replace(grid, cells=GRID_REFINEMENT * grid.cells)
    course = added_time_course(base, enriched)
    total = float(power(base.evidence) @ course**2)
    excess = ExcessLeft(_fit(base, fine, course), _fit(enriched, fine, course), total, margin_px=margin.px,
                        camera_px=margin.camera_px)
    if not has_new_inclusion(base, enriched):
        return excess
    return replace(excess, max_share=MAX_INCLUSION_EXCESS_LEFT, margin_px=margin.inclusion_px)


def added_time_course(base: ResidualEvidence, enriched: ResidualEvidence) -> np.ndarray:
    """Change of the simulated motion with the added candidate, over time; mean square 1  # (T,)"""
    changes = (enriched.u - base.u).reshape(len(enriched.u), -1)
    course = np.linalg.svd(changes @ changes.T)[0][:, 0]
    return course / np.sqrt(np.mean(course**2))


def has_new_inclusion(base: ResidualEvidence, enriched: ResidualEvidence) -> bool:
    """Whether an inclusion was added."""
    names = {(entry.element_set, entry.name) for entry in base.context.experiment.model.heterogeneities}
    return any(entry.is_spot and (entry.element_set, entry.name) not in names
               for entry in enriched.context.experiment.model.heterogeneities)


def _fit(residual: ResidualEvidence, grid: Grid, course: np.ndarray) -> Misfit:
    """Drop of chi-square by motions with this course, as one frame; the model's own parameters may move along."""
    evidence = residual.evidence
    null = null_model(evidence, residual.null)
    basis = hats(evidence, grid)
    matrix, rhs, cross = np.zeros((basis.n, basis.n)), np.zeros(basis.n), np.zeros((basis.n, null.white.n))
    fields = _white(evidence, basis.fields, course)
    for part, white, weighed in zip(evidence.parts, fields, null.weighed.fields, strict=True):
        own_matrix, own_rhs = projected(evidence, part, white)
        matrix, rhs, cross = matrix + own_matrix, rhs + own_rhs, cross + white.T @ weighed
    gain, rank = gain_and_rank(matrix - cross @ null.covariance @ cross.T, rhs - cross @ null.remaining)
    return Misfit(evidence.frames[-1:], np.array([gain]), np.array([rank]), np.zeros((1, 0)), float("nan"))


def _white(evidence: Evidence, fields: sparse.csr_array, course: np.ndarray) -> Iterator[sparse.csr_array]:
    """`Evidence.whiten` of fields times a course, frame by frame  # (n_seen, p) each

    What is zero stays so: as dense columns of all frames these would not fit into memory.
    """
    back, kappa = evidence.back, evidence.kappa
    shared = np.einsum("t,tnij->nij", course / kappa, back)
    for value, node_back, spread in zip(course, back, np.sqrt(kappa), strict=True):
        still = value * np.eye(evidence.n_components) - evidence.share * np.linalg.solve(node_back, shared)
        yield sparse.csr_array(_at_seen(evidence, still / spread) @ fields)


def _at_seen(evidence: Evidence, blocks: np.ndarray) -> sparse.csr_array:
    """Blocks of the nodes as a matrix over the seen dofs  # (n_nodes, c, c) -> (n_seen, n_seen)"""
    n, c = blocks.shape[:2]
    matrix = sparse.bsr_array((blocks, np.arange(n), np.arange(n + 1)), shape=(n * c, n * c)).tocsr()
    return matrix[evidence.seen][:, evidence.seen]
