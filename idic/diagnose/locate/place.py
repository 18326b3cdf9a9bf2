"""Where the source is: the elements whose stiffness the residual would change most, and how sure their place is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from idic.diagnose.locate.adjoint_sources import MIN_SOURCE_SHARE, MAX_ELEMENT_P, SourceMap
from idic.fe import Mesh, cell_type

MAX_ROUNDING_SHARE = 1e-9  # of the size of a body: a coordinate that is smaller is a sum that should be zero


@dataclass(frozen=True, eq=False)
class Place:
    """Elements of the source.

    elements : (n,) global indices; centroid, centroid_std, extent : (dim,) mm, extent along the axes; p_value : of the
    strongest element, family-wise; has_centre : whether an element lies at the centroid, which may be the middle of a
    hole or between two corners
    """

    elements: np.ndarray
    centroid: np.ndarray
    centroid_std: np.ndarray
    extent: np.ndarray
    p_value: float
    has_centre: bool = True


def place_of(mesh: Mesh, source_map: SourceMap) -> Place | None:
    """Elements whose statistic is at least `MIN_SOURCE_SHARE` of the largest and of its sign; None where none is
    significant.

    Mismatch projected on the identified parameters changes sign in the rest of the body: of the two, the stronger side
    is the source.
    """
    if source_map.p.min() > MAX_ELEMENT_P:
        return None
    centres = element_centres(mesh)
    elements = _belonging(source_map.z, source_map.p)
    points = centres[elements]
    centroids = [_centroid(centres, source_map.z + noise, source_map.p) for noise in source_map.draws]
    element_nodes = [_nodes_of(mesh, int(e)) for e in elements]
    centroid, nodes = _centroid(centres, source_map.z, source_map.p), np.concatenate(element_nodes)
    size = max(np.linalg.norm(mesh.nodes[of] - at, axis=1).max() for of, at in zip(element_nodes, points, strict=True))
    return Place(elements, centroid, np.std(centroids, axis=0), np.ptp(mesh.nodes[nodes], axis=0),
                 float(source_map.p.min()), bool(np.linalg.norm(points - centroid, axis=1).min() <= size))


def _belonging(z: np.ndarray, p: np.ndarray) -> np.ndarray:
    statistic = (z**2).sum(axis=1)
    strongest = int(np.argmax(statistic))
    is_alike = z @ z[strongest] > 0.0  # the same course in time, and sign
    return np.flatnonzero((statistic >= MIN_SOURCE_SHARE * statistic[strongest]) & is_alike & (p <= MAX_ELEMENT_P))


def _centroid(centres: np.ndarray, z: np.ndarray, p: np.ndarray) -> np.ndarray:
    elements = _belonging(z, p)
    if not len(elements):
        return centres[int(np.argmax((z**2).sum(axis=1)))]
    return np.average(centres[elements], axis=0, weights=(z[elements] ** 2).sum(axis=1))


def clusters(mesh: Mesh, elements: np.ndarray) -> list[np.ndarray]:
    """Elements that hang together by their nodes, the largest cluster first"""
    owners = np.concatenate([np.full(len(_nodes_of(mesh, int(e))), k) for k, e in enumerate(elements)])
    nodes = np.concatenate([_nodes_of(mesh, int(e)) for e in elements])
    touching = csr_array((np.ones(len(nodes)), (owners, nodes)), shape=(len(elements), len(mesh.nodes)))
    label = connected_components(touching @ touching.T, directed=False)[1]
    return sorted((elements[label == k] for k in np.unique(label)), key=len, reverse=True)


def in_words(place, stds=None, size: float = 0.0) -> str:
    """Coordinates of a place, to three digits but to a whole unit at least, with standard deviations if given.

    size : of the body or of a part of it: a coordinate within rounding of zero is zero
    """
    rounding = MAX_ROUNDING_SHARE * max(size, *(abs(x) for x in place))
    texts = ["0" if abs(x) <= rounding else f"{x:.3g}" if abs(x) < 999.5 else f"{x:.0f}" for x in place]
    if stds is not None:
        texts = [f"{text} ± {std:.1g}" for text, std in zip(texts, stds, strict=True)]
    return f"({', '.join(texts)})"


def element_centres(mesh: Mesh) -> np.ndarray:
    """Mean of the corner nodes  # (n_elements, dim) mm"""
    return np.concatenate([mesh.nodes[block.connectivity[:, :_corners(block.cell)]].mean(axis=1)
                           for block in mesh.blocks])


def _corners(name: str) -> int:
    return cell_type(name).n_corners


def _nodes_of(mesh: Mesh, element: int) -> np.ndarray:
    block = mesh.block_of(element)
    return block.connectivity[element - block.first]
