"""Small cross-sections, rough surfaces whose deformed height map is known exactly, and the slow pixelwise route."""

import numpy as np
from scipy import ndimage

from idic.fe import make_mesh
from idic.images import Camera

PIXEL = 0.332e-3  # mm
SHAPE = (41, 120)
WIDTH = 60 * PIXEL  # half the section, mm


def strip_mesh(low, high, n, seed=0):
    """One layer of quad8 elements of unequal width; the upper edge is TOP."""
    rng = np.random.default_rng(seed)
    x = np.linspace(low, high, n + 1)
    x[1:-1] += 0.2 * (high - low) / n * (rng.random(n - 1) - 0.5)
    return layer_mesh(x, bend=0.02)


def layer_mesh(x, bend=0.0):
    """Quad8 elements between the places x (n + 1,), one layer; the upper middle nodes a little off the middle."""
    n, height = len(x) - 1, 2e-3
    bottom, top = np.stack([x, 0 * x], axis=1), np.stack([x, 0 * x + height], axis=1)
    low, high = 0.5 * (bottom[1:] + bottom[:-1]), 0.5 * (top[1:] + top[:-1])
    high[:, 0] += bend * np.diff(x) * np.sign(high[:, 0])
    upright = 0.5 * (bottom + top)
    nodes = np.concatenate([bottom, top, low, high, upright])
    k = np.arange(n)
    b, t, lo, hi, u = (offset + k for offset in (0, n + 1, 2 * n + 2, 3 * n + 2, 4 * n + 2))
    cells = np.stack([b, b + 1, t + 1, t, lo, u + 1, hi, u], axis=1)
    return make_mesh(nodes, [("quad8", cells)], edge_sets={"TOP": np.stack([k, 0 * k + 2], axis=1)})


def camera(shift=0.0):
    return Camera.from_table(pixel_size=PIXEL, origin=(0.5 * (SHAPE[1] - 1) + shift, 0.5 * (SHAPE[0] - 1)))


class Surface:
    """f(column, row) as a sum of cosines, and the motion u(column), h(column) in px and um; all odd or even about
    the middle of the image, so that half a section shows the whole."""

    def __init__(self, seed=0, size=1.0):
        rng = np.random.default_rng(seed)
        self.k = rng.normal(0.0, 0.25, (40, 2))
        self.phase, self.size = rng.random(40) * 2 * np.pi, size
        self.middle = 0.5 * (SHAPE[1] - 1)

    def f(self, column, row):
        angle = np.multiply.outer(column, self.k[:, 0]) + np.multiply.outer(row, self.k[:, 1]) + self.phase
        return 0.25 * np.cos(angle).sum(axis=-1)

    def u(self, column):
        s = (column - self.middle) / 50.0
        return self.size * 1.3 * s * (1.0 + 0.4 * s**2)

    def h(self, column):
        s = (column - self.middle) / 50.0
        return self.size * (40.0 - 6.0 * s**2 + 1.5 * s**4)

    def image(self):
        column, row = np.meshgrid(np.arange(SHAPE[1], dtype=float), np.arange(SHAPE[0], dtype=float))
        return self.f(column, row).astype(np.float32)

    def deformed(self):
        """g(x + u(x)) = f(x) + h(x), solved for x column by column."""
        seen = np.arange(SHAPE[1], dtype=float)
        x = seen.copy()
        for _ in range(60):
            x = seen - self.u(x)
        column, row = np.meshgrid(x, np.arange(SHAPE[0], dtype=float))
        return (self.f(column, row) + self.h(column)).astype(np.float32)

    def nodal(self, mesh, seen_by):
        """The motion at the nodes  # (n_nodes, 3)"""
        column = seen_by.project(mesh.nodes * [1.0, 0.0])[:, 0]
        return np.stack([self.u(column), 0 * column, self.h(column)], axis=1)


def pixelwise(section_map, image, frame, motion, degree=5):
    """r (ny, n_columns) and the rows L (ny, n_columns, 3 n_nodes) of every pixel, in double precision, by SciPy."""
    pm = section_map
    u, h, du, dh = (np.zeros(pm.n_columns) for _ in range(4))
    n = np.zeros((pm.n_columns, pm.n_nodes))
    for k in range(pm.n_columns):
        for a in range(3):
            n[k, pm.conn[k, a]] += pm.weight[k, a]
            u[k] += pm.side[k] * pm.weight[k, a] * motion[pm.conn[k, a], 0]
            h[k] += pm.weight[k, a] * motion[pm.conn[k, a], 2]
            du[k] += pm.side[k] * pm.slope[k, a] * motion[pm.conn[k, a], 0]
            dh[k] += pm.slope[k, a] * motion[pm.conn[k, a], 2]
    g, f = (ndimage.spline_filter1d(values.astype(float), degree, axis=1, mode="mirror") for values in (frame, image))
    rows = np.arange(pm.shape[0], dtype=float)[:, None]

    def value(coefficients, column):
        """The spline along the rows only, at whole rows."""
        out = np.empty((pm.shape[0], len(column)))
        for i in range(pm.shape[0]):
            out[i] = ndimage.map_coordinates(coefficients[i], column[None], order=degree, mode="mirror",
                                             prefilter=False)
        return out + 0.0 * rows

    column, step = pm.column.astype(float), 1e-4
    r = image[:, pm.column] + h - value(g, column + u)
    fx = (value(f, column + step) - value(f, column - step)) / (2 * step)
    gx = (fx + dh) / (1.0 + du)
    L = np.zeros((*r.shape, pm.n_nodes, 3))
    L[..., 0] = (gx * pm.side)[:, :, None] * n
    L[..., 2] = -n
    return r, L.reshape(*r.shape, -1), fx, dh, du
