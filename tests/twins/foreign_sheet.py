"""Finite elements in plane stress that share no code with idic's: the truth of virtual tests with terms combined.

Eight-node elements with four points; tangent by difference quotients, stress as the complex-step derivative of the
energy, F33 an unknown of every point. The flow is integrated in short steps along the straight path of F in an
increment; a step flows along the mean of the normals before and after it. The equations are those of a law's
documentation: Simo's flow on a neo-Hookean body, or Hill's on orthotropic elasticity in the strain (g - 1/g) / 4.

Tensors in the plane are (11, 22, 33, 12); F is (11, 12, 21, 22, 33).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

compiled = njit(cache=True, error_model="numpy")
GAUSS = np.array([-1.0, 1.0]) / np.sqrt(3.0)
DIFFERENCE, COMPLEX_STEP = 1e-7, 1e-30
TOLERANCE, MOST_ITERATIONS, SHORTEST = 1e-7, 12, 1e-3  # of the residual; of an increment over the time of a frame


@dataclass(frozen=True)
class Material:
    """Parameters, MPa and s; zero: without the term.

    elastic : E, nu; or E1, E2, nu12, G12 and the angle of axis 1, rad
    hill : f, g, h, n; damage : S, s of Lemaitre
    """

    elastic: tuple[float, ...]
    yield_stress: float
    H: float
    hill: tuple[float, ...] = (0.5, 0.5, 0.5, 1.5)
    C: float = 0.0
    gamma: float = 0.0
    eta: float = 0.0
    m: float = 1.0
    damage: tuple[float, float] = (0.0, 1.0)

    def numbers(self) -> np.ndarray:
        """A stiffness of e (11, 22, 33, 23 as 12; 12) or G and kappa, angle and the others in one array."""
        head = np.zeros(8)
        if len(self.elastic) == 2:
            E, nu = self.elastic
            head[1:3] = 0.5 * E / (1.0 + nu), E / (3.0 * (1.0 - 2.0 * nu))
        else:  # direction 3 as 2, nu23 = nu12
            E1, E2, nu, G12, angle = self.elastic
            C = np.linalg.inv([[1.0 / E1, -nu / E1, -nu / E1], [-nu / E1, 1.0 / E2, -nu / E2],
                               [-nu / E1, -nu / E2, 1.0 / E2]])
            head[:] = 1.0, C[0, 0], C[0, 1], C[1, 1], C[1, 2], 2.0 * G12, angle, 0.0
        return np.array([*head, *self.hill, self.yield_stress, self.H, self.C, self.gamma, self.eta, self.m,
                         *self.damage, *self.elastic[:2]])


@compiled
def product(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + 2.0 * a[3] * b[3]


@compiled
def polar(F):
    """(cos, sin) of the rotation and U."""
    c, s = F[0] + F[3], F[2] - F[1]
    size = np.sqrt(c * c + s * s)
    c, s = c / size, s / size
    return c, s, (c * F[0] + s * F[2], c * F[3] - s * F[1], F[4], c * F[1] + s * F[3])


@compiled
def between(U, c):
    """U c U."""
    a11, a12, a21, a22 = U[0] * c[0] + U[3] * c[3], U[0] * c[3] + U[3] * c[1], U[3] * c[0] + U[1] * c[3], (
        U[3] * c[3] + U[1] * c[1])
    return a11 * U[0] + a12 * U[3], a21 * U[3] + a22 * U[1], U[2] * c[2] * U[2], a11 * U[3] + a12 * U[1]


@compiled
def inverse(s):
    d = s[0] * s[1] - s[3] * s[3]
    return s[1] / d, s[0] / d, 1.0 / s[2], -s[3] / d


@compiled
def turned(s, c, r):
    """Components in axes turned by the angle with cosine c and sine r."""
    return (c * c * s[0] + r * r * s[1] + 2.0 * c * r * s[3], r * r * s[0] + c * c * s[1] - 2.0 * c * r * s[3], s[2],
            c * r * (s[1] - s[0]) + (c * c - r * r) * s[3])


@compiled
def measure(F, cp, k):
    """What the elastic energy depends on, in axes that turn with the material, and J."""
    _, _, U = polar(F)
    J = U[2] * (U[0] * U[1] - U[3] * U[3])
    g = between(U, cp)
    if k[0] == 0.0:
        w = J ** (-2.0 / 3.0)
        return (w * g[0], w * g[1], w * g[2], w * g[3]), J
    h = inverse(g)
    e = (0.25 * (g[0] - h[0]), 0.25 * (g[1] - h[1]), 0.25 * (g[2] - h[2]), 0.25 * (g[3] - h[3]))
    return turned(e, np.cos(k[6]), np.sin(k[6])), J


@compiled
def stress(x, k):
    """Its part that flows: the deviator of a neo-Hookean body, or all of it."""
    if k[0] == 0.0:
        mean = (x[0] + x[1] + x[2]) / 3.0
        return k[1] * (x[0] - mean), k[1] * (x[1] - mean), k[1] * (x[2] - mean), k[1] * x[3]
    return (k[1] * x[0] + k[2] * (x[1] + x[2]), k[2] * x[0] + k[3] * x[1] + k[4] * x[2],
            k[2] * x[0] + k[4] * x[1] + k[3] * x[2], k[5] * x[3])


@compiled
def energy(F, cp, k):
    x, J = measure(F, cp, k)
    if k[0] == 0.0:
        return 0.5 * k[1] * (x[0] + x[1] + x[2]) + 0.5 * k[2] * (J - 1.0) ** 2
    return 0.5 * product(x, stress(x, k))


@compiled
def normal(t, a, k):
    """(q, dq/dt) of the stress less the back stress 2/3 C a."""
    w = 2.0 / 3.0 * k[14]
    s0, s1, s2, s3 = t[0] - w * a[0], t[1] - w * a[1], t[2] - w * a[2], t[3] - w * a[3]
    f, g, h, n = k[8], k[9], k[10], k[11]
    d = (g * (s0 - s2) + h * (s0 - s1), f * (s1 - s2) + h * (s1 - s0), f * (s2 - s1) + g * (s2 - s0), n * s3)
    q = np.sqrt(d[0] * s0 + d[1] * s1 + d[2] * s2 + 2.0 * d[3] * s3)
    return q, (d[0] / q, d[1] / q, d[2] / q, d[3] / q)


@compiled
def moved(x, N, size):
    return x[0] - size * N[0], x[1] - size * N[1], x[2] - size * N[2], x[3] - size * N[3]


@compiled
def recovered(a, N, dp, k):
    """Back strain after dp: a' = N - gamma a, trapezoidal."""
    z = 0.5 * k[15] * dp
    return ((a[0] * (1.0 - z) + dp * N[0]) / (1.0 + z), (a[1] * (1.0 - z) + dp * N[1]) / (1.0 + z),
            (a[2] * (1.0 - z) + dp * N[2]) / (1.0 + z), (a[3] * (1.0 - z) + dp * N[3]) / (1.0 + z))


@compiled
def excess(x, a, N, dp, p, width, dt, k):
    """Overstress after a flow of dp along N, and what of it the rate does not carry."""
    q, _ = normal(stress(moved(x, N, width * dp), k), recovered(a, N, dp, k), k)
    carried = k[16] * (dp / dt) ** (1.0 / k[17]) if k[16] > 0.0 else 0.0
    return q - k[12] - k[13] * (p + dp) - carried


@compiled
def grown(x, a, N, first, p, width, dt, k):
    """dp at which nothing is left: Illinois' false position."""
    low, high, at_low = 0.0, 1e-6, first
    at_high = excess(x, a, N, high, p, width, dt, k)
    while at_high > 0.0:
        low, at_low, high = high, at_high, 2.0 * high
        at_high = excess(x, a, N, high, p, width, dt, k)
    side = 0
    for _ in range(200):
        mid = (low * at_high - high * at_low) / (at_high - at_low)
        value = excess(x, a, N, mid, p, width, dt, k)
        if abs(value) < 1e-9 * k[12] or high - low < 1e-15:
            return mid
        if value > 0.0:
            low, at_low = mid, value
            at_high *= 0.5 if side == 1 else 1.0
            side = 1
        else:
            high, at_high = mid, value
            at_low *= 0.5 if side == -1 else 1.0
            side = -1
    return mid


@compiled
def plastic_state(F, x, J, k):
    """Cp^-1 of the measure x at F."""
    _, _, U = polar(F)
    if k[0] == 0.0:
        w = J ** (2.0 / 3.0)
        g = (w * x[0], w * x[1], w * x[2], w * x[3])
    else:
        e = turned(x, np.cos(k[6]), -np.sin(k[6]))
        r0, r1 = 1.0 + 4.0 * (e[0] * e[0] + e[3] * e[3]), 1.0 + 4.0 * (e[1] * e[1] + e[3] * e[3])
        r3, d = 4.0 * e[3] * (e[0] + e[1]), 0.0
        d = np.sqrt(r0 * r1 - r3 * r3)
        root = np.sqrt(r0 + r1 + 2.0 * d)
        g = (2.0 * e[0] + (r0 + d) / root, 2.0 * e[1] + (r1 + d) / root, 2.0 * e[2] + np.sqrt(1.0 + 4.0 * e[2] ** 2),
             2.0 * e[3] + r3 / root)
    return between(inverse(U), g)


@compiled
def damage_rate(x, J, k):
    """dD/dp of Lemaitre, cracks closed towards uniaxial compression."""
    s = stress(x, k)
    q, pressure = np.sqrt(1.5 * product(s, s)), k[2] * (J - 1.0) * J
    E, nu, ratio = k[20], k[21], pressure / q
    Y = q * q / (2.0 * E) * (2.0 / 3.0 * (1.0 + nu) + 3.0 * (1.0 - 2.0 * nu) * ratio * ratio)
    opened = min(max(1.0 + 3.0 * ratio, 0.0), 1.0)
    return (Y / k[18]) ** k[19] * opened * opened * (3.0 - 2.0 * opened)


@compiled
def step(F, before, dt, k, after):
    """The flow of one step that ends with F; state : Cp^-1 (4), p, a (4), D."""
    after[:] = before
    cp, a, p = (before[0], before[1], before[2], before[3]), (before[5], before[6], before[7], before[8]), before[4]
    x, J = measure(F, cp, k)
    q, N = normal(stress(x, k), a, k)
    first = q - k[12] - k[13] * p
    if first <= 0.0:
        return
    width = 2.0 * (x[0] + x[1] + x[2]) / 3.0 if k[0] == 0.0 else 1.0
    start, dp = N, 0.0
    for _ in range(3):
        dp = grown(x, a, N, first, p, width, dt, k)
        _, end = normal(stress(moved(x, N, width * dp), k), recovered(a, N, dp, k), k)
        N = (0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]), 0.5 * (start[2] + end[2]), 0.5 * (start[3] + end[3]))
    x, a = moved(x, N, width * dp), recovered(a, N, dp, k)
    cp = plastic_state(F, x, J, k)
    for i in range(4):
        after[i], after[5 + i] = cp[i], a[i]
    after[4] = p + dp
    if k[18] > 0.0:
        after[9] += damage_rate(x, J, k) * dp


@compiled
def follow(F0, F1, state, dt, steps, k, after, P):
    """Along the straight path from F0 to F1. With a rate steps are short after a turn, where overstress relaxes fast,
    and every step is the extrapolation of itself and its two halves."""
    F, before, half, whole, part = np.empty(5), state.copy(), np.empty(10), np.empty(10), 0.0
    after[:] = state
    for i in range(steps):
        last, part = part, (i + 1.0) / steps
        if k[16] > 0.0:
            part *= part
            F[:] = F0 + (F1 - F0) * (0.5 * (last + part))
            step(F, before, 0.5 * dt * (part - last), k, half)
        F[:] = F0 + (F1 - F0) * part
        step(F, before, dt * (part - last), k, whole)
        if k[16] > 0.0:
            step(F, half, 0.5 * dt * (part - last), k, after)
            before[:] = 2.0 * after - whole
        else:
            before[:] = whole
    after[:] = before
    cp, shifted = (after[0], after[1], after[2], after[3]), np.empty(5, np.complex128)
    for j in range(5):
        for i in range(5):
            shifted[i] = F1[i] + (COMPLEX_STEP * 1j if i == j else 0.0)
        P[j] = (1.0 - after[9]) * energy(shifted, cp, k).imag / COMPLEX_STEP


@compiled
def points(F0, F1, states, dt, steps, k, after, P, A):
    """Stress (m, 5) and tangent (m, 5, 5) of all points."""
    other, scratch = np.empty(5), np.empty(10)
    for i in range(len(F0)):
        follow(F0[i], F1[i], states[i], dt, steps, k, after[i], P[i])
        F = F1[i].copy()
        for j in range(5):
            F[j] += DIFFERENCE
            follow(F0[i], F, states[i], dt, steps, k, scratch, other)
            A[i, :, j] = (other - P[i]) / DIFFERENCE
            F[j] = F1[i, j]


def gradients(nodes: np.ndarray, cells: np.ndarray):
    """dN/dX (nel, 4, 8, 2) and areas (nel, 4) of the points."""
    a, b = np.array([-1, 1, 1, -1]), np.array([-1, -1, 1, 1])
    rows = []
    for eta in GAUSS:
        for xi in GAUSS:
            rows.append(np.vstack([
                np.column_stack([0.25 * a * (1 + b * eta) * (2 * a * xi + b * eta),
                                 0.25 * b * (1 + a * xi) * (a * xi + 2 * b * eta)]),
                [[-xi * (1 - eta), -0.5 * (1 - xi**2)], [0.5 * (1 - eta**2), -eta * (1 + xi)],
                 [-xi * (1 + eta), 0.5 * (1 - xi**2)], [-0.5 * (1 - eta**2), -eta * (1 - xi)]]]))
    jacobian = np.einsum("gna,enb->egab", np.array(rows), nodes[cells])
    return np.einsum("egba,gna->egnb", np.linalg.inv(jacobian), np.array(rows)), np.linalg.det(jacobian)


@dataclass(frozen=True)
class State:
    """A converged state: motion (n,) mm, F (m, 5), histories of the points (m, 10), nodal forces (n,) N."""

    u: np.ndarray
    F: np.ndarray
    points: np.ndarray
    force: np.ndarray


class Sheet:
    """A mesh of eight-node elements with its material; the motion of some of its degrees of freedom is given."""

    def __init__(self, mesh, thickness: float, material: Material, held: np.ndarray, steps: int):
        (block,), self.k, self.steps, self.n = mesh.blocks, material.numbers(), steps, 2 * mesh.n_nodes
        G, areas = gradients(mesh.nodes, block.connectivity)
        dofs = (2 * block.connectivity[:, :, None] + np.arange(2)).reshape(-1, 16)
        self.places = np.repeat(dofs, 4, axis=0)  # of a point
        self.B = np.zeros((len(self.places), 4, 16))  # of F11, F12, F21, F22
        for i in range(4):
            self.B[:, i, i // 2::2] = G.reshape(-1, 8, 2)[:, :, i % 2]
        self.weights = areas.ravel() * thickness
        self.held, self.free = held, np.setdiff1d(np.arange(self.n), held)

    def start(self) -> State:
        m = len(self.places)
        return State(np.zeros(self.n), np.tile([1.0, 0.0, 0.0, 1.0, 1.0], (m, 1)),
                     np.tile([1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], (m, 1)), np.zeros(self.n))

    def equilibrium(self, before: State, wanted: np.ndarray, dt: float) -> State | None:
        """After dt (s), with `wanted` motion (mm) of what is held; None where Newton's iteration does not arrive."""
        u, F, after, m = before.u.copy(), before.F.copy(), before.points.copy(), len(self.places)
        P, A = np.zeros((m, 5)), np.zeros((m, 5, 5))
        for iteration in range(MOST_ITERATIONS):
            points(before.F, F, before.points, dt, self.steps, self.k, after, P, A)
            if not np.isfinite(A).all():
                return None
            across = A[:, :4, 4] / A[:, 4, 4:]
            inner = np.einsum("pcj,pc->pj", self.B, (P[:, :4] - across * P[:, 4:]) * self.weights[:, None])
            f = np.bincount(self.places.ravel(), inner.ravel(), minlength=self.n)
            if iteration > 0 and max(np.abs(f[self.free]).max() / np.abs(f).max(),
                                     np.abs(P[:, 4]).max() / self.k[12]) < TOLERANCE:
                return State(u, F, after, f)
            condensed = (A[:, :4, :4] - across[:, :, None] * A[:, 4:, :4]) * self.weights[:, None, None]
            own = self.B.transpose(0, 2, 1) @ condensed @ self.B
            rows, columns = np.repeat(self.places, 16, axis=1), np.tile(self.places, 16)
            K = coo_array((own.ravel(), (rows.ravel(), columns.ravel())), shape=(self.n, self.n)).tocsc()
            du = np.zeros(self.n)
            du[self.held] = wanted - u[self.held]
            du[self.free] = splu(K[self.free][:, self.free].tocsc()).solve(-(f + K @ du)[self.free])
            u += du
            dF = np.einsum("pcj,pj->pc", self.B, du[self.places])
            F[:, 4] -= (P[:, 4] + np.einsum("pc,pc->p", A[:, 4, :4], dF)) / A[:, 4, 4]
            F[:, :4] += dF
        return None


def moved_sheet(mesh, thickness: float, material: Material, times: np.ndarray, drives: list, increments: int = 3,
                steps: int = 8):
    """Motion (n_frames, n_nodes, 2) mm, nodal forces (n_frames, n_nodes, 2) N and the histories of the points (m, 10).

    drives : (node set, 0 | 1, course in all frames (n_frames,) mm); increments are halved where they do not converge
    """
    held = np.concatenate([2 * mesh.node_sets[name] + component for name, component, _ in drives])
    courses = np.concatenate([np.repeat(np.asarray(course)[:, None], len(mesh.node_sets[name]), axis=1)
                              for name, _, course in drives], axis=1)
    held, first = np.unique(held, return_index=True)
    courses, sheet = courses[:, first], Sheet(mesh, thickness, material, held, steps)
    state = sheet.start()
    us, forces = [state.u.reshape(-1, 2)], [state.force.reshape(-1, 2)]
    for frame in range(1, len(times)):
        ends, done = list(np.linspace(1.0, 0.0, increments, endpoint=False)), 0.0
        while ends:
            share = ends[-1]
            at = courses[frame - 1] + (courses[frame] - courses[frame - 1]) * share
            new = sheet.equilibrium(state, at, (times[frame] - times[frame - 1]) * (share - done))
            if new is None:
                ends.append(0.5 * (done + share))
                assert ends[-1] - done > SHORTEST, f"no equilibrium before frame {frame}"
            else:
                state, done = new, ends.pop()
        us.append(state.u.reshape(-1, 2))
        forces.append(state.force.reshape(-1, 2))
    return np.array(us), np.array(forces), state.points
