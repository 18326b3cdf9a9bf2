"""From cuts of a mesh to the seams of a body: when each pair of nodes opens, and its stiffness while the tip passes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from idic.errors import NotConverged
from idic.fe.assembly.assembly import discretise, element_matrices, evaluate_system
from idic.fe.body.body import Body
from idic.fe.body.boundary import drives_at
from idic.fe.body.seam import Seam
from idic.fe.crack.cut import Cut, side_pairs


@dataclass(frozen=True)
class PassingTip:
    """How the tip of a crack passes an element: measured on an edge crack (tests/fe/test_crack_tip.py).

    share : of the stiffness of the two nodes of a pair alone, in series, that the body has against opening it: the
        nodes around them give way, too
    shorter : of an edge: a crack whose tip is on a node opens the body as one that is so much shorter
    """

    share: float
    shorter: float


QUADRATIC, LINEAR = PassingTip(0.2, 0.07), PassingTip(0.5, 0.25)  # elements with and without mid-side nodes



def with_seams(body: Body, cuts: Sequence[Cut], tips: np.ndarray, params: Mapping[str, np.ndarray],
               times: np.ndarray) -> Body:
    """The body with seams along the cuts of its mesh.

    Parameters
    ----------
    tips : (n_frames, n_cuts) mm, length of the open part of each
    params : of the laws, per section: how stiff the body is against opening a pair of nodes
    times : (n_frames,) s
    """
    stiffness = _nodal_stiffness(body, params, times)
    return replace(body, seams=tuple(_seam(cut, side_pairs(body.mesh, cut), stiffness, column)
                                     for cut, column in zip(cuts, tips.T, strict=True)))


def _nodal_stiffness(body: Body, params: Mapping[str, np.ndarray], times: np.ndarray) -> np.ndarray:
    """Stiffness of a body at rest against moving one node, all others held  # (n_nodes, d, d) N/mm"""
    system, d = discretise(body), body.mesh.n_dim
    evaluation = evaluate_system(system, params, np.zeros_like(body.mesh.nodes), system.rest_states(),
                                 float(times[-1] - times[0]) or 1.0, drives_at(body, times, times[0]))
    if evaluation.trouble:
        raise NotConverged(evaluation.trouble)
    stiffness = np.zeros((body.mesh.n_nodes, d, d))
    for group, g in zip(system.groups, evaluation.groups, strict=True):
        element_matrices(group, g)
        for k, nodes in enumerate(group.connectivity.T):
            rows = slice(k * d, (k + 1) * d)
            np.add.at(stiffness, nodes, g.Ke[:, rows, rows])
    return stiffness


def _seam(cut: Cut, middle: Sequence[np.ndarray], stiffness: np.ndarray, tips: np.ndarray) -> Seam:
    passing = QUADRATIC if any(map(len, middle)) else LINEAR
    places, pairs, begin, end = _tip_places(cut, passing.shorter), [], [], []
    for k, (start, stop) in enumerate(pairwise(places)):
        of_edge = middle[k].tolist()
        if cut.left_nodes[k] != cut.right_nodes[k]:
            of_edge.append([int(cut.left_nodes[k]), int(cut.right_nodes[k])])
        pairs += of_edge
        begin += [start] * len(of_edge)
        end += [stop] * len(of_edge)
    nodes = np.array(pairs, dtype=np.int64)
    compliance = sum(np.linalg.inv(stiffness[side]) for side in nodes.T)
    return Seam(nodes, np.array(begin), np.array(end), passing.share * np.linalg.inv(compliance), tips)


def _tip_places(cut: Cut, shorter: float) -> np.ndarray:
    """Lengths of the crack whose tip is on each node of the cut  # (n + 1,) mm"""
    edges = np.diff(cut.place)
    around = 0.5 * (np.append(edges, edges[-1]) + np.append(edges[0], edges))
    places = cut.place - shorter * around
    places[0] = 0.0
    return places
