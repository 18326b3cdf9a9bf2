"""The motion of a mesh on which most matches agree: every match proposes one, the mesh bends what wins.

A wrong match agrees with no other. The motion begins as the similarity that one match states (its turn and stretch) and
most others confirm, goes on as the affine motion of those, and ends as the smooth motion of the mesh through all
matches that are near it: a bent or necked body is no affine one.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from idic.measure.far.features import Matches

MAX_PROPOSALS = 400  # the most distinct matches, each of which proposes a motion
TOLERANCES = (0.08, 0.04)  # of the size of the body: 10 % of stretch across half of it, by a similarity; a bend of the
#                            affine motion
MIN_TOLERANCE_PX = 3.0  # a match is placed to a pixel
MESH_TOLERANCES = (0.03, 0.015)  # of the size of the body, as the smooth motion approaches the matches
MIN_AGREEING = 8  # matches at different places; unrelated speckle reaches 2 (24 pairs of 1.2 to 4 px)
MIN_SPREAD = 0.2  # of the size of the body, in its shorter direction: less says nothing of a turn
SMOOTH_SHARE = 0.5  # wave length over the size of the body that the smooth motion damps by half: a neck, not a mismatch


def agreed_motion(matches: Matches, nodes_px: np.ndarray, places: sparse.csr_array,
                  penalty: Callable[[float, int], sparse.csc_array]) -> np.ndarray | None:
    """Motion of the nodes that most matches agree on.

    Parameters
    ----------
    nodes_px : (n_nodes, 2) in the image of the matches' places
    places : (n_matches, n_nodes) shape functions at the matches; rows of zeros where a match lies on no element
    penalty : (wave length in px, number of matches) -> (2 n_nodes, 2 n_nodes), of a rough motion: it damps waves of
        that length by half where so many matches of unit weight lie on the mesh

    Returns
    -------
    (n_nodes, 2) px; None where fewer than `MIN_AGREEING` matches agree
    """
    size = float(np.ptp(matches.places, axis=0).max()) if len(matches) else 0.0
    if len(matches) < MIN_AGREEING or size == 0.0:
        return None
    affine = _proposed(matches, _tolerance(TOLERANCES[0], size))
    for share in TOLERANCES[1:]:
        if affine is None:
            return None
        affine = _affine(matches, _agreeing(matches, affine, TOLERANCES[0] * size))
        if affine is not None:
            affine = _affine(matches, _agreeing(matches, affine, _tolerance(share, size)))
    if affine is None:
        return None
    return _on_mesh(matches, affine, nodes_px, places, partial(penalty, SMOOTH_SHARE * size), size)


def _tolerance(share: float, size: float) -> float:
    return max(share * size, MIN_TOLERANCE_PX)


def _proposed(matches: Matches, tolerance: float) -> np.ndarray | None:
    """The similarity of the match with which most others agree, as target = [1, place] @ fit  # (3, 2)"""
    n = min(len(matches), MAX_PROPOSALS)
    turns, origins = matches.turns[:n], matches.places[:n]
    votes = np.array([_different(matches, matches.targets[k] + (matches.places - origins[k]) @ turns[k].T, tolerance)
                      for k in range(n)])
    best = int(np.argmax(votes))
    if votes[best] < MIN_AGREEING:
        return None
    return np.vstack([matches.targets[best] - turns[best] @ origins[best], turns[best].T])


def _different(matches: Matches, expected: np.ndarray, tolerance: float) -> int:
    """Matches near their expected place; several features at one place count once."""
    agreeing = np.linalg.norm(expected - matches.targets, axis=1) < tolerance
    return len(np.unique(np.rint(matches.places[agreeing]), axis=0))


def _agreeing(matches: Matches, affine: np.ndarray, tolerance: float) -> np.ndarray:
    expected = np.column_stack([np.ones(len(matches)), matches.places]) @ affine
    return np.linalg.norm(expected - matches.targets, axis=1) < tolerance


def _affine(matches: Matches, agree: np.ndarray) -> np.ndarray | None:
    """The affine motion of the matches that agree; None where they are few or all in one place or line."""
    chosen = matches.places[agree]
    if len(np.unique(np.rint(chosen), axis=0)) < MIN_AGREEING:
        return None
    extent = np.linalg.svd(chosen - chosen.mean(axis=0), compute_uv=False) / np.sqrt(len(chosen))
    places = matches.places - matches.places.mean(axis=0)
    extent_of_all = np.linalg.svd(places, compute_uv=False) / np.sqrt(len(matches))
    if extent[1] < MIN_SPREAD * extent_of_all[1]:
        return None
    return np.linalg.lstsq(np.column_stack([np.ones(len(chosen)), chosen]), matches.targets[agree], rcond=None)[0]


def _on_mesh(matches: Matches, affine: np.ndarray, nodes_px: np.ndarray, places: sparse.csr_array,
             penalty: Callable[[int], sparse.csc_array], size: float) -> np.ndarray:
    """The smooth motion of the mesh through the matches near it, from the affine one on  # (n_nodes, 2) px"""
    base = np.column_stack([np.ones(len(nodes_px)), nodes_px]) @ affine - nodes_px
    on_mesh = np.asarray(places.sum(axis=1)).ravel() > 0.5
    measured = matches.targets - matches.places
    u = base
    for share in MESH_TOLERANCES:
        gap = measured - places @ u
        agreeing = on_mesh & (np.linalg.norm(gap, axis=1) < _tolerance(share, size))
        if agreeing.sum() < MIN_AGREEING:
            break
        gap_of_base = measured[agreeing] - places[agreeing] @ base
        trial = base + _smoothed(places[agreeing], gap_of_base, penalty(int(agreeing.sum())))
        if not np.isfinite(trial).all():
            break
        u = trial
    return u


def _smoothed(places: sparse.csr_array, gap: np.ndarray, penalty: sparse.csc_array) -> np.ndarray:
    """min |P v - gap|² + v^T R v  # (n, 2) px at the matches -> (n_nodes, 2) px"""
    components = sparse.kron(places, sparse.eye_array(2), format="csr")
    ridge = 1e-6 * places.shape[0] / places.shape[1]  # nodes without a match stay with the affine motion
    matrix = sparse.csc_matrix(components.T @ components + penalty + ridge * sparse.eye_array(components.shape[1]))
    return splu(matrix).solve(components.T @ gap.ravel()).reshape(-1, 2)
