"""Along which line a crack would explain the residual best: a matched filter over places, directions and lengths.

Across a straight crack of half length a, in a body whose traction without it is t, the motion jumps by

    delta(s) = 4/E' (a^2 - s^2)^1/2 t(s)                                                  (s from its middle)

in both modes (Sneddon 1946, doi:10.1098/rspa.1946.0018); of a crack that begins at an edge, s is counted from there. A
jump on a line with the normal n is an eigenstrain, and with the adjoint motion w of the weighed residual p
(`idic.diagnose.locate.adjoint_sources`), whose stress is sigma(w),

    p . du = int delta . sigma(w) n ds

is the score of the motion du by which the bounded body answers. So one adjoint solution scores every line, on the mesh
without a crack. The jump follows the load, or the load times a ramp of a crack that grows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, vstack
from scipy.spatial import cKDTree

from idic.diagnose.locate.adjoint_sources import adjoint_motion, recorded_residual, residuals_with_draws
from idic.diagnose.locate.freedoms import in_images
from idic.diagnose.locate.place import element_centres
from idic.diagnose.locate.tangents import ModelTangent, tangents
from idic.diagnose.residual.evidence import Columns, Courses
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.diagnose.residual.score import NullModel, null_model, score
from idic.fe import Mesh
from idic.identification import Identification

N_NEAREST = 6  # elements that are looked at for one that holds a point
SMOOTHING = 0.5  # of an element: standard deviation of the mean of stresses at a point
N_POINTS = 12  # of a line, at which its tractions are compared
TURN_DEG = 15.0  # between the directions of the first search
MAX_LEAN_DEG = 75.0  # of a crack at an edge, from the normal of the edge
LENGTHS = (2.0, 3.0, 4.5, 6.5, 9.5, 14.0, 20.0)  # sizes of an element
INNER_LENGTHS = (3.0, 6.5, 14.0)
MAX_STARTS = 250  # places along the edges, and places inside
MAX_ALTERNATIVES, MIN_Z_SHARE = 5, 0.75  # further lines, with so much of the best z
MIN_APART, MIN_TURN_DEG = 1.5, 20.0  # sizes of an element between the middles of two of them, or degrees
MIN_ROOM = 1.0  # sizes of an element between a tip and the next edge
DRAWS = 40
N_EXACT = 8  # discs of every radius whose score is computed with its exact standard deviation
LINES_AT_ONCE = 1000  # whose tractions are held together
SEED = 41
SOFT_RADII = (1.0, 1.6, 2.5, 4.0, 6.5)  # sizes of an element: discs of another stiffness that a crack is compared with


@dataclass(frozen=True)
class Line:
    """A straight crack. start, end : (2,) mm; inner : whether it begins inside the body and not at an edge."""

    start: tuple[float, float]
    end: tuple[float, float]
    inner: bool

    @property
    def length(self) -> float:
        """mm"""
        return float(np.hypot(*np.subtract(self.end, self.start)))

    @property
    def middle(self) -> np.ndarray:
        """Halfway  # (2,) mm"""
        return 0.5 * np.add(self.start, self.end)

    @property
    def direction_deg(self) -> float:
        """From its start, from the x axis."""
        return float(np.degrees(np.arctan2(self.end[1] - self.start[1], self.end[0] - self.start[0])))

    def turned(self, degrees: float) -> Line:
        """Another direction, about its start."""
        angle = np.radians(self.direction_deg + degrees)
        return Line(self.start, _shifted(self.start, self.length * np.cos(angle), self.length * np.sin(angle)),
                    self.inner)

    def lengthened(self, by: float) -> Line:
        """With its tip further on (mm)."""
        return self.moved(0.0, 0.0, 1.0 + by / self.length)

    def moved(self, along_x: float, along_y: float, longer: float = 1.0) -> Line:
        """Another place, and a factor of the length."""
        start = _shifted(self.start, along_x, along_y)
        way = np.subtract(self.end, self.start)
        return Line(start, _shifted(start, longer * way[0], longer * way[1]), self.inner)


@dataclass(frozen=True)
class CrackPath:
    """The line that explains most.

    alternatives : further lines, each at another place or in another direction, that explain nearly as much; z :
    standard deviations of its score; z_soft : of the best disc of another stiffness; size : mm, of an element
    """

    line: Line
    alternatives: tuple[Line, ...]
    z: float
    z_soft: float
    size: float


def crack_path(identification: Identification, residual: ResidualEvidence) -> CrackPath | None:
    """The line along which a crack explains most of the residual of a sheet; None where none of a tensile side does.

    Raises
    ------
    NotConverged
        If a law finds no answer along the path of the identified model.
    """
    field = _Field.of(identification, residual)
    mesh = identification.experiment.model.mesh
    size = field.cells.size
    starts = [*_edge_lines(mesh, size), *_inner_lines(field, size)]
    scored = field.scored(starts)
    if not len(scored) or not np.isfinite(scored).any():
        return None
    line, z = starts[int(np.nanargmax(scored))], float(np.nanmax(scored))
    lines = [_refined(field, line, z, size)[0], line, *_distinct(starts, scored, size)]
    z = field.exact(field.forces_of(lines))
    order = np.argsort(-z)
    return CrackPath(lines[int(order[0])], tuple(lines[int(k)] for k in order[1:] if z[k] > MIN_Z_SHARE * z.max()),
                     float(z.max()), field.softest(size), size)


def _distinct(lines: Sequence[Line], z: np.ndarray, size: float) -> tuple[Line, ...]:
    """Lines that explain nearly as much as the best one, at other places or in other directions."""
    order = np.argsort(-np.nan_to_num(z))
    distinct = [lines[order[0]]]
    for k in order[1:]:
        if not z[k] > MIN_Z_SHARE * z[order[0]] or len(distinct) > MAX_ALTERNATIVES:
            break
        if all(_differ(lines[k], line, size) for line in distinct):
            distinct.append(lines[k])
    return tuple(distinct[1:])


def _differ(first: Line, second: Line, size: float) -> bool:
    """Whether the middles of two lines, or their directions, are apart."""
    distance = np.linalg.norm(first.middle - second.middle)
    turn = abs((first.direction_deg - second.direction_deg + 90.0) % 180.0 - 90.0)
    return bool(distance > MIN_APART * size or turn > MIN_TURN_DEG)


@dataclass(frozen=True, eq=False)
class Cells:
    """The elements of a plane mesh by place: centres (n, 2) mm, sizes (n,) mm, corners (n, 4, 2) mm."""

    centres: np.ndarray
    sizes: np.ndarray
    corners: np.ndarray
    tree: cKDTree

    @classmethod
    def of(cls, mesh: Mesh) -> Cells:
        centres, corners = element_centres(mesh)[:, :2], _corners(mesh)
        return cls(centres, _sizes(corners), corners, cKDTree(centres))

    @property
    def size(self) -> float:
        """Median size of an element, mm"""
        return float(np.median(self.sizes))

    def holds(self, points: np.ndarray) -> np.ndarray:
        """Whether points lie in an element  # (n, 2) mm -> (n,) bool"""
        inside = np.zeros(len(points), dtype=bool)
        _, nearest = self.tree.query(points, k=min(N_NEAREST, len(self.centres)))
        for elements in nearest.T:
            open_points = np.flatnonzero(~inside)
            corners = self.corners[elements[open_points]]
            side, to_point = np.roll(corners, -1, axis=1) - corners, points[open_points, None] - corners
            cross = side[..., 0] * to_point[..., 1] - side[..., 1] * to_point[..., 0]
            inside[open_points] = (cross >= -1e-9 * self.sizes[elements[open_points], None] ** 2).all(axis=1)
        return inside

    def around(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Elements around points, and their weights in a smooth mean  # (n, k), (n, k)"""
        distance, elements = self.tree.query(points, k=min(N_NEAREST, len(self.centres)))
        weights = np.exp(-0.5 * (distance / (SMOOTHING * self.sizes[elements])) ** 2)
        return elements, weights / weights.sum(axis=1, keepdims=True)

    def room_ahead(self, line: Line) -> float:
        """From the start of a line to where it leaves the body, mm"""
        steps = np.arange(0.25, 1e4, 0.1) * self.size
        steps = steps[steps < 2.0 * float(np.linalg.norm(np.ptp(self.centres, axis=0)))]
        inside = self.holds(np.add(line.start, steps[:, None] * np.subtract(line.end, line.start) / line.length))
        return float(steps[np.argmin(inside)] if not inside.all() else steps[-1])


@dataclass(frozen=True, eq=False)
class _Field:
    """What lines are scored by.

    stress : (n_elements, 2, 2) MPa, of the model in the frame with the largest motion; adjoint : (n_courses,
    n_elements, 3, 1 + D) stress xx, yy, xy of the adjoint motions, the first of the residual and the others of noise;
    work : (n_courses, n_elements, 1 + D) scores of the stiffness; courses : (n_courses, T) of the jumps; stress_of :
    (3 n_elements, n_dof) stress xx, yy, xy of a motion
    """

    cells: Cells
    stress: np.ndarray
    adjoint: np.ndarray
    work: np.ndarray
    residual: ResidualEvidence
    null: NullModel
    tangent: ModelTangent
    courses: np.ndarray
    stress_of: csr_array

    @classmethod
    def of(cls, identification: Identification, residual: ResidualEvidence) -> _Field:
        evidence, null = residual.evidence, null_model(residual.evidence, residual.null)
        motion = residual.solved_u.reshape(len(residual.u), -1)
        peak = int(np.argmax((motion**2).sum(axis=1)))
        course = motion @ motion[peak] / ((motion[peak] @ motion[peak]) or 1.0)
        ramp = np.arange(1, len(course) + 1) / len(course)
        q, channel_q = residuals_with_draws(evidence, null, np.random.default_rng(SEED), DRAWS)
        p = recorded_residual(evidence, q)
        (tangent,) = tangents(identification, residual, only=peak)
        courses = np.array([course, course * ramp])
        fields = np.array([adjoint_motion(residual, tangent, np.einsum("t,tij->ij", c, p), np.einsum("t,tij->ij", c,
                                                                                               channel_q))
                           for c in courses])
        stress, stress_of = _stresses(tangent)
        adjoint = np.array([(stress_of @ field).reshape(len(stress), 3, -1) for field in fields])
        work = np.array([tangent.element_work(-field) for field in fields])
        return cls(Cells.of(identification.experiment.model.mesh), stress, adjoint, work, residual, null, tangent,
                   courses, stress_of)

    def exact(self, forces: np.ndarray) -> np.ndarray:
        """Standard deviations by which nodal forces show, each of its better course  # (n_dof, n) -> (n,)

        The body answers to them; what it answers is scored like the column of a candidate.
        """
        du = self.tangent.answer(np.zeros_like(forces), forces)
        body, n = self.tangent.system.body, forces.shape[1]
        internal = self.tangent.times(du) - forces
        readings = np.array([channel.factor * internal[np.asarray(channel.dofs, dtype=np.int64)].sum(axis=0)
                             for channel in body.channels]).reshape(-1, n)
        if self.tangent.readings is not None:
            readings = readings + self.tangent.readings.motion @ du
        motion = du.reshape(-1, body.mesh.n_dim, n)
        motions = np.tile(np.arange(n), len(self.courses))
        amplitude = np.repeat(self.courses.T, n, axis=1)  # (T, 2 n)
        columns = Columns(tuple(map(str, range(len(motions)))),
                          np.array([in_images(self.residual, t, motion) for t in range(len(amplitude))]),
                          amplitude[:, None] * readings[:, motions], courses=Courses(motions, amplitude))
        return np.fmax.reduce(score(self.residual.evidence, self.null, columns).z.reshape(-1, n))

    def forces_of(self, lines: Sequence[Line]) -> np.ndarray:
        """Nodal forces of the jumps of lines inside the body  # (n_dof, n)"""
        return self.stress_of.T @ self._rows(lines).toarray().T

    def scored(self, lines: Sequence[Line]) -> np.ndarray:
        """Standard deviations by which each line shows, of its better course; NaN of one that leaves the body"""
        z = np.full(len(lines), np.nan)
        inside = np.flatnonzero(self._is_inside(lines))
        if not len(inside):
            return z
        matrix = self._rows([lines[int(k)] for k in inside])
        for adjoint in self.adjoint:
            scores = matrix @ adjoint.reshape(-1, adjoint.shape[2])
            std = np.sqrt(np.mean(scores[:, 1:] ** 2, axis=1))
            with np.errstate(divide="ignore", invalid="ignore"):
                z[inside] = np.fmax(z[inside], scores[:, 0] / std)
        return z

    def softest(self, size: float) -> float:
        """The same of the best disc of another stiffness, exactly."""
        rows = []
        for radius in SOFT_RADII:
            members = self.cells.tree.query_ball_point(self.cells.centres, radius * size)
            places = np.repeat(np.arange(len(members)), [len(disc) for disc in members])
            discs = csr_array((np.ones(len(places)), (places, np.concatenate(members))), shape=2 * (len(members),))
            z = np.zeros(len(members))
            for work in self.work:
                scores = discs @ work
                std = np.sqrt(np.mean(scores[:, 1:] ** 2, axis=1))
                z = np.maximum(z, np.abs(scores[:, 0]) / np.maximum(std, 1e-300))
            rows += [discs[[k]] for k in np.argsort(-z)[:N_EXACT]]
        softer = -self.tangent.element_forces().T @ vstack(rows).toarray().T
        return float(np.max(np.abs(self.exact(np.asarray(softer)))))

    def _is_inside(self, lines: Sequence[Line]) -> np.ndarray:
        """Whether a line, its start at an edge left out, stays inside with some room beyond its tip  # (n,) bool"""
        if not lines:
            return np.zeros(0, dtype=bool)
        starts, ends, inner = _ends(lines)
        way = (ends - starts) / np.maximum(np.linalg.norm(ends - starts, axis=1), 1e-300)[:, None]
        room = MIN_ROOM * self.cells.size
        low = np.where(inner, -room, 0.1 * room)
        length = np.linalg.norm(ends - starts, axis=1)
        share = np.linspace(0.0, 1.0, N_POINTS)
        along = low[:, None] + share * (length + room - low)[:, None]
        points = starts[:, None] + along[..., None] * way[:, None]
        return np.all(self.cells.holds(points.reshape(-1, 2)).reshape(len(lines), -1), axis=1)

    def _rows(self, lines: Sequence[Line]) -> csr_array:
        """Weights of the adjoint stress: the work of the jump of every line  # (n, 3 n_elements)"""
        return vstack([self._rows_together(lines[k:k + LINES_AT_ONCE]) for k in range(0, len(lines), LINES_AT_ONCE)],
                      format="csr")

    def _rows_together(self, lines: Sequence[Line]) -> csr_array:
        starts, ends, inner = _ends(lines)
        way = ends - starts
        length = np.hypot(way[:, 0], way[:, 1])
        tangent = way / length[:, None]
        normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
        share = (np.arange(N_POINTS) + 0.5) / N_POINTS
        points = starts[:, None] + share[:, None] * way[:, None]  # (n, N_POINTS, 2)
        elements, parts = (field.reshape(len(lines), N_POINTS, -1)
                           for field in self.cells.around(points.reshape(-1, 2)))  # (n, N_POINTS, k)
        traction = np.einsum("lpk,lpkij,lj->lpi", parts, self.stress[elements], normal)
        opening = np.einsum("lpi,li->lp", traction, normal)
        traction -= np.minimum(opening, 0.0)[..., None] * normal[:, None]  # faces in contact do not pass each other
        half = np.where(inner, 0.5, 1.0) * length
        place = (share - np.where(inner, 0.5, 0.0)[:, None]) * length[:, None]
        jump = np.sqrt(np.maximum(half[:, None] ** 2 - place**2, 0.0))[..., None] * traction
        x, y = normal[:, None, 0], normal[:, None, 1]
        weights = np.stack([jump[..., 0] * x, jump[..., 1] * y, jump[..., 0] * y + jump[..., 1] * x],
                           axis=-1) * (length / N_POINTS)[:, None, None]
        columns = 3 * elements[..., None] + np.arange(3)
        rows = np.broadcast_to(np.arange(len(lines))[:, None, None, None], columns.shape)
        values = parts[..., None] * weights[:, :, None]
        return csr_array((values.ravel(), (rows.ravel(), columns.ravel())), shape=(len(lines), 3 * len(self.stress)))


def _ends(lines: Sequence[Line]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Starts and ends, and which begin inside the body  # (n, 2) mm, (n, 2) mm, (n,) bool"""
    return (np.array([line.start for line in lines]), np.array([line.end for line in lines]),
            np.array([line.inner for line in lines]))


def _stresses(tangent: ModelTangent) -> tuple[np.ndarray, csr_array]:
    """Mean stress of every element: of the model (n, 2, 2) MPa, and by the motion of the nodes (3 n, n_dof) MPa/mm."""
    body = tangent.system.body
    n = body.mesh.n_elements
    stress, rows, columns, values = np.zeros((n, 2, 2)), [], [], []
    for group, at in zip(tangent.system.groups, tangent.evaluation.groups, strict=True):
        per, n_el = group.points_per_element, len(group.elements)
        weights = group.weights.reshape(n_el, per)
        weights = weights / weights.sum(axis=1, keepdims=True)
        stress[group.elements] = np.einsum("ep,epij->eij", weights, at.P.reshape(n_el, per, 2, 2))
        assert at.A is not None  # evaluated with its stiffness
        A = at.A.reshape(n_el, per, 2, 2, 2, 2)
        grads = group.grads.reshape(n_el, per, -1, 2)
        tensor = np.einsum("ep,epijkl,epal->eijak", weights, A, grads).reshape(n_el, 2, 2, -1)
        parts = np.stack([tensor[:, 0, 0], tensor[:, 1, 1], 0.5 * (tensor[:, 0, 1] + tensor[:, 1, 0])], axis=1)
        rows.append(np.repeat(3 * np.asarray(group.elements)[:, None] + np.arange(3), parts.shape[2]))
        columns.append(np.repeat(group.dofs[:, None], 3, axis=1).ravel())
        values.append(parts.ravel())
    matrix = csr_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))),
                       shape=(3 * n, body.n_dof))
    return stress, matrix


def _edge_lines(mesh: Mesh, size: float) -> list[Line]:
    """Lines from the edges of the body, outer and of holes, in all directions and lengths."""
    lines = []
    for loop in mesh.boundary_edges():
        ends = np.array([mesh.face_nodes(edge)[:2] for edge in loop])
        a, b = mesh.nodes[ends[:, 0], :2], mesh.nodes[ends[:, 1], :2]
        step = max(1, len(loop) // MAX_STARTS)
        for start, end in zip(a[::step], b[::step], strict=True):
            way = (end - start) / np.linalg.norm(end - start)
            inward = np.degrees(np.arctan2(way[0], -way[1]))  # the material is on the left
            for lean in np.arange(-MAX_LEAN_DEG, MAX_LEAN_DEG + 1.0, TURN_DEG):
                lines += _rays(0.5 * (start + end), inward + lean, size, inner=False)
    return lines


def _inner_lines(field: _Field, size: float) -> list[Line]:
    """Lines inside the body."""
    step = max(1, len(field.cells.centres) // MAX_STARTS)
    lines = []
    for centre in field.cells.centres[::step]:
        for turn in np.arange(0.0, 180.0, TURN_DEG):
            for ray in _rays(centre, turn, size, inner=True):
                half = 0.5 * np.subtract(ray.end, ray.start)
                lines.append(ray.moved(-half[0], -half[1]))
    return lines


def _rays(start: np.ndarray, degrees: float, size: float, inner: bool) -> list[Line]:
    way = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    begin = (float(start[0]), float(start[1]))
    return [Line(begin, _shifted(begin, *(length * size * way)), inner)
            for length in (INNER_LENGTHS if inner else LENGTHS)]


def _refined(field: _Field, line: Line, z: float, size: float) -> tuple[Line, float]:
    """The best line near one: smaller and smaller steps of place, direction and length."""
    for step in (0.5, 0.5, 0.25, 0.25, 0.12, 0.12, 0.06, 0.06):
        way = np.subtract(line.end, line.start) / line.length
        across = np.array([-way[1], way[0]])
        shifts = [0.0 * way, *(sign * step * size * axis for sign in (-1.0, 1.0)
                               for axis in ((across, way) if line.inner else (across,)))]
        lines = [line.turned(turn).moved(float(shift[0]), float(shift[1]), longer) for shift in shifts
                 for turn in (-0.6 * TURN_DEG * step, 0.0, 0.6 * TURN_DEG * step)
                 for longer in (1.0 - 0.3 * step, 1.0, 1.0 + 0.3 * step)]
        scored = field.scored(lines)
        best = int(np.nanargmax(scored)) if np.isfinite(scored).any() else -1
        if best >= 0 and scored[best] > z:
            line, z = lines[best], float(scored[best])
    return line, z


def _corners(mesh: Mesh) -> np.ndarray:
    """Corners of every element, counter-clockwise; the last one twice of a triangle  # (n_elements, 4, 2) mm"""
    corners = np.zeros((mesh.n_elements, 4, 2))
    for block in mesh.blocks:
        n = block.kind.n_corners
        numbers = [*range(n), *[n - 1] * (4 - n)]
        corners[block.first:block.first + block.n_elements] = mesh.nodes[block.connectivity[:, numbers], :2]
    return corners


def _sizes(corners: np.ndarray) -> np.ndarray:
    """Square root of the area of every element  # (n_elements,) mm"""
    ahead = np.roll(corners, -1, axis=1)
    return np.sqrt(0.5 * np.abs(np.sum(corners[..., 0] * ahead[..., 1] - corners[..., 1] * ahead[..., 0], axis=1)))


def _shifted(point: tuple[float, float], along_x: float, along_y: float) -> tuple[float, float]:
    return float(point[0] + along_x), float(point[1] + along_y)
