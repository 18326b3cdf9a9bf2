"""Position of a mesh with its own axes under measured points: a rigid fit of their outlines.

    Y = R(-angle) (p - origin),      d(Y) = margin        at the points p of an outline

d is the distance to the nearest edge of the mesh, positive inside; points end a margin before the edge of the specimen,
which is unknown. Gauss-Newton with bisquare weights (Beaton and Tukey 1974, doi:10.1080/00401706.1974.10489171), so
that the ends of a view within the specimen do not count. It starts from the centres, from every pair of holes, and from
turns all round.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from idic.errors import InputError
from idic.fe import Block

N_TURNS = 24  # starts all round
MAX_OUTLINE_POINTS = 150  # of the outline, in the starts; all of them in the end
MAX_REFINED = 24  # starts that are refined with all points
STEPS = 12  # of each scale of the weights
WIDE, NARROW = 6.0, 1.5  # scales of the weights, distances of neighbours: a grid shows an edge to half a distance
MIN_ON_EDGES = 0.5  # of the points of the outline within `NARROW` of an edge
MAX_STD = 0.35  # distances of neighbours: of the placement along any direction, of a turn at the rim
MAX_OUTSIDE = 0.01  # of all points: beyond the edges of the mesh, or in its holes
MAX_COST_RATIO = 1.2  # of two placements that fit alike
SAME = 1.0  # distances of neighbours: rms difference of two placements that are one
MAX_SYMMETRY_GAP = 0.5  # distances of neighbours, rms: of a mesh from its own image


@dataclass(frozen=True, eq=False)
class Edges:
    """Edges of a mesh that one cell has. start, along : (n, 2) mm; inward : (n, 2) unit normals; middle, size : of
    all"""

    start: np.ndarray
    along: np.ndarray
    inward: np.ndarray

    @classmethod
    def of(cls, nodes: np.ndarray, cells: Sequence[Block]) -> Edges:
        """nodes : (n, 2) mm in the plane of the view; cells : plane ones"""
        ends, centres = [], []
        for block in cells:
            corners = block.connectivity[:, :3 if block.cell.startswith("tri") else 4]
            ends.append(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2))
            centres.append(np.repeat(nodes[corners].mean(axis=1), corners.shape[1], axis=0))
        every, centre = np.concatenate(ends), np.concatenate(centres)
        _, first, count = np.unique(np.sort(every, axis=1), axis=0, return_index=True, return_counts=True)
        outer = first[count == 1]
        start, along = nodes[every[outer, 0]], nodes[every[outer, 1]] - nodes[every[outer, 0]]
        normal = np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(*along.T)[:, None]
        inside = np.sum(normal * (centre[outer] - start), axis=1) > 0
        return cls(start, along, np.where(inside[:, None], normal, -normal))

    def sampled(self, step: float) -> tuple[np.ndarray, np.ndarray]:
        """Points on the edges `step` distance, and the edge of each  # (m, 2), (m,)"""
        counts = np.maximum(np.ceil(np.hypot(*self.along.T) / step).astype(int), 1)
        edge = np.repeat(np.arange(len(counts)), counts)
        place = (np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts) + 0.5) / counts[edge]
        return self.start[edge] + place[:, None] * self.along[edge], edge

    def fitted_placement(self, points: np.ndarray, loops: Sequence[np.ndarray], pitch: float,
                         guess: Placement) -> tuple[Placement, list[Placement]]:
        """The placement of a mesh with these edges, in its axes, that is nearest to `guess` among those that fit best,
        and the others that fit alike.

        Parameters
        ----------
        points : all of them, (n, 2) mm; loops : boundary loops of them, (m, 2) mm, the outer one first; pitch :
        distance of neighbours
        guess : its origin NaN: nearest is the one with the smallest turn from its angle

        Raises
        ------
        InputError
            The outline does not lie along the edges, does not hold the mesh in every direction, or fits in several ways
            that are no symmetry of the mesh.
        """
        fit = _Fit.of(self, np.concatenate(loops), pitch)
        coarse = fit.thinned()
        rough = coarse.distinct([coarse.refined(start, (WIDE,)) for start in _starts(self, loops)])
        refined = fit.distinct([fit.refined(start, (WIDE, NARROW)) for start in rough[:MAX_REFINED]])
        fit_of_all = replace(fit, points=points)
        accepted = [placement for placement in refined
                    if np.mean(fit_of_all.distances(placement)[0] < -pitch) < MAX_OUTSIDE]
        strange_holes = [sum(replace(fit, points=hole).off(placement) for hole in loops[1:]) for placement in accepted]
        accepted = [placement for placement, number in zip(accepted, strange_holes, strict=True)
                    if number == min(strange_holes)]
        best = (accepted or refined)[0]
        if not accepted or best.on_edges < MIN_ON_EDGES:
            raise InputError("the outline of the points does not lie along the edges of the mesh",
                             key="camera.placement",
                             expected=f"{100 * MIN_ON_EDGES:.0f} % of it or more within {NARROW:g} distances of "
                                      "points, and no point outside the mesh",
                             found=f"{100 * best.on_edges:.0f} % in the best placement",
                             remedy="check the mesh and its unit, or place it: origin_mm, axes, rotation_deg")
        fit.check_held(best)
        alike = [placement for placement in accepted
                 if placement.cost < MAX_COST_RATIO * best.cost + (0.1 * pitch) ** 2]
        if np.isfinite(guess.origin).all():
            alike.sort(key=lambda placement: fit.distance(placement, guess))
            return alike[0], []
        strange = [placement for placement in alike[1:] if not fit.symmetric(best, placement)]
        if strange:
            raise InputError("the mesh fits the points in several ways", key="camera.placement",
                             expected="one placement, or several that are equal by symmetry of the mesh",
                             found="; ".join(_words(placement) for placement in (best, *strange)),
                             remedy="select one: give its origin_mm and rotation_deg next to placement")
        alike.sort(key=lambda placement: abs(_half_turns(placement.angle - guess.angle)))
        return alike[0], alike[1:]


@dataclass(frozen=True, eq=False)
class Placement:
    """origin : (2,) mm, where the origin of the mesh lies; angle : rad, counter-clockwise; margin : mm; cost : mean of
    the squared distances, limited (mm²); on_edges : part of the outline along the edges of the mesh"""

    origin: np.ndarray
    angle: float
    margin: float
    cost: float = np.inf
    on_edges: float = 0.0

    def into_mesh(self, points: np.ndarray) -> np.ndarray:
        """Points in the axes of the mesh  # (n, 2) mm"""
        return (points - self.origin) @ _rotation(self.angle)


def _words(placement: Placement) -> str:
    x, y = placement.origin
    return f"origin [{x:.3g}, {y:.3g}] mm turned by {np.degrees(_half_turns(placement.angle)):.2f}°"


def _half_turns(angle: float) -> float:
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)


def _rotation(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def _starts(edges: Edges, loops: Sequence[np.ndarray]) -> Iterator[Placement]:
    """Centre on centre, end on end, and every hole of the points on every hole of the mesh, turned all round."""
    ends = np.concatenate([edges.start, edges.start + edges.along])
    low, high = ends.min(axis=0), ends.max(axis=0)
    holes = [(hole.mean(axis=0), place) for hole in loops[1:] for place in _hole_centres(edges)]
    for angle in 2.0 * np.pi * np.arange(N_TURNS) / N_TURNS:
        turn = _rotation(angle)
        turned_loop = loops[0] @ turn  # in axes parallel to those of the mesh
        first, at_end = turned_loop.min(axis=0) - low, turned_loop.max(axis=0) - high
        middle = 0.5 * (first + at_end)
        for x, y in ((middle, middle), (first, middle), (at_end, middle), (middle, first), (middle, at_end)):
            yield Placement(turn @ [x[0], y[1]], float(angle), 0.0)
        for at, mesh_centre in holes:
            yield Placement(at - turn @ mesh_centre, float(angle), 0.0)


def _hole_centres(edges: Edges) -> list[np.ndarray]:
    """Middles of the closed groups of edges but the largest one."""
    ends = np.round(np.concatenate([edges.start, edges.start + edges.along]), 9)
    _, number = np.unique(ends, axis=0, return_inverse=True)
    n = len(edges.start)
    label = np.arange(number.max() + 1)
    first, second = number[:n], number[n:]
    while True:  # the smallest number of a group spreads along it
        lowest = np.minimum(label[first], label[second])
        spread = label.copy()
        np.minimum.at(spread, first, lowest)
        np.minimum.at(spread, second, lowest)
        spread = spread[spread]
        if np.array_equal(spread, label):
            break
        label = spread
    groups = [edges.start[label[first] == name] for name in np.unique(label)]
    groups.sort(key=lambda group: -float(np.prod(np.ptp(group, axis=0))))
    return [0.5 * (group.min(axis=0) + group.max(axis=0)) for group in groups[1:]]


@dataclass(frozen=True, eq=False)
class _Fit:
    """The points of an outline and the edges that they are laid along.

    points : (n, 2) mm; tree : of points on the edges; edge : (m,) of each of them
    """

    edges: Edges
    points: np.ndarray
    pitch: float
    tree: scipy.spatial.cKDTree
    edge: np.ndarray

    @classmethod
    def of(cls, edges: Edges, points: np.ndarray, pitch: float) -> _Fit:
        samples, edge = edges.sampled(0.25 * pitch)
        return cls(edges, points, pitch, scipy.spatial.cKDTree(samples), edge)

    def thinned(self) -> _Fit:
        """With some points only."""
        return replace(self, points=self.points[::max(len(self.points) // MAX_OUTLINE_POINTS, 1)])

    def distances(self, placement: Placement) -> tuple[np.ndarray, np.ndarray]:
        """d of every point, and its inward direction in the axes of the mesh  # (n,), (n, 2)"""
        at = placement.into_mesh(self.points)
        edge = self.edge[self.tree.query(at)[1]]
        start, along, inward = self.edges.start[edge], self.edges.along[edge], self.edges.inward[edge]
        share = np.clip(np.sum((at - start) * along, axis=1) / np.sum(along**2, axis=1), 0.0, 1.0)
        gap = at - start - share[:, None] * along
        size = np.hypot(*gap.T)
        sign = np.where(np.sum(gap * inward, axis=1) >= 0, 1.0, -1.0)
        corner = (share == 0.0) | (share == 1.0)
        direction = np.where((corner & (size > 1e-9))[:, None], sign[:, None] * gap / np.maximum(size, 1e-9)[:, None],
                             inward)
        return sign * size, direction

    def refined(self, placement: Placement, scales: Sequence[float]) -> Placement:
        """Gauss-Newton with weights of each scale, then the cost."""
        for scale in scales:
            for _ in range(STEPS):
                r, jacobian = self._linear(placement)
                weight = _bisquare(r / (scale * self.pitch))
                weighted = weight[:, None] * jacobian
                normal = jacobian.T @ weighted + 1e-9 * np.eye(4) * max(float(weight.sum()), 1e-9)
                step = np.linalg.solve(normal, -weighted.T @ r)
                turn = step[2] / self._radius
                placement = Placement(self._moved(placement, step[:2], turn), placement.angle + turn,
                                      float(np.clip(placement.margin + step[3], 0.0, 5.0 * self.pitch)))
        r = self._linear(placement)[0]
        limit = NARROW * self.pitch
        return replace(placement, cost=float(np.mean(np.minimum(r**2, limit**2))),
                       on_edges=float(np.mean(np.abs(r) < limit)))

    def check_held(self, placement: Placement) -> None:
        """Refuse a placement that the outline leaves open in a direction."""
        r, jacobian = self._linear(placement)
        weight = _bisquare(r / (NARROW * self.pitch))
        values, vectors = np.linalg.eigh(jacobian.T @ (weight[:, None] * jacobian))
        noise = max(float(np.sqrt(placement.cost)), 0.1 * self.pitch)
        if noise < MAX_STD * self.pitch * np.sqrt(max(values[0], 1e-300)):
            return
        x, y, turn, _ = np.abs(vectors[:, 0])
        along = _rotation(placement.angle).T @ vectors[:2, 0]
        raise InputError("the outline of the points does not fix the position of the mesh", key="camera.placement",
                         expected="edges of the specimen in different directions, or a hole, in view",
                         found="nothing that fixes the rotation" if turn > max(x, y) else
                         f"nothing that fixes the position along ({along[0]:.2f}, {along[1]:.2f}) of the mesh",
                         remedy="place it: origin_mm, axes and rotation_deg without placement")

    def distinct(self, placements: Sequence[Placement]) -> list[Placement]:
        """Without repetitions, the best one first."""
        unique: list[Placement] = []
        for placement in sorted(placements, key=lambda placement: placement.cost):
            if not any(self.distance(placement, earlier) < SAME * self.pitch for earlier in unique):
                unique.append(placement)
        return unique

    def off(self, placement: Placement) -> bool:
        """Whether most of the points are beside the edges."""
        return bool(np.median(np.abs(self.distances(placement)[0] - placement.margin)) > NARROW * self.pitch)

    def distance(self, first: Placement, second: Placement) -> float:
        """rms distance of the outline in two placements, mm"""
        return float(np.sqrt(np.mean(np.sum((first.into_mesh(self.points) - second.into_mesh(self.points)) ** 2,
                                            axis=1))))

    def symmetric(self, first: Placement, second: Placement) -> bool:
        """Whether the mesh lies on itself when it is moved from one placement to the other."""
        samples = self.tree.data @ _rotation(first.angle).T + first.origin
        gap = self.tree.query(second.into_mesh(samples))[0]
        return bool(np.sqrt(np.mean(gap**2)) < MAX_SYMMETRY_GAP * self.pitch)

    @property
    def _middle(self) -> np.ndarray:
        return self.points.mean(axis=0)

    @property
    def _radius(self) -> float:
        return float(np.hypot(*(self.points - self._middle).T).max())

    def _moved(self, placement: Placement, shift: np.ndarray, turn: float) -> np.ndarray:
        """The origin after a turn about the middle of the points and a shift, both in the axes of the points."""
        return self._middle + _rotation(turn) @ (placement.origin - self._middle) + shift

    def _linear(self, placement: Placement) -> tuple[np.ndarray, np.ndarray]:
        """d less the margin, and its derivatives by shift (2), turn at the rim, margin  # (n,) mm, (n, 4)"""
        d, direction = self.distances(placement)
        # in the axes of the points: the mesh moves, the points stay
        outward = -direction @ _rotation(placement.angle).T
        x, y = (self.points - self._middle).T
        turn = (outward[:, 1] * x - outward[:, 0] * y) / self._radius
        return d - placement.margin, np.column_stack([outward, turn, -np.ones(len(d))])


def _bisquare(r: np.ndarray) -> np.ndarray:
    """Weights (1 - r²)², zero from 1 on."""
    return np.maximum(1.0 - r**2, 0.0) ** 2
