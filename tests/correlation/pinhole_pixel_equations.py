"""The equation for a camera with a lens, to read: residual, M and b of one frame, pixel by pixel.

    X(x)  the material point that the pixel x shows: the ray of x meets a face of the mesh there
    r(x)  = f(x) - g(P_t(X + u))                                        docs/method.md, equation 17.1
    L_i   = (F^-T grad f) . J_t(X + u) phi_i                            equation 17.3
    F     = J_t(X + u) dY [J(X) dX]^-1                                  equation 17.4

P is the projection, J its 2 x 3 Jacobian, dX and dY (3 x 2) the tangents of the surface before and after the motion; t
is the frame. Everything is exact at every pixel. The identification computes M and b from the images of the nodes
(`idic.correlation.views.pinhole_view`) with one F per element (`image_equations.frame`); the tests compare the two.
"""

from __future__ import annotations

import numpy as np

from correlation.pixel_equations import PixelEquations
from idic.correlation import CELLS, N_NODES, PixelMap, in_space
from idic.fe import cell_type
from idic.images import PlacedCamera
from images.spline_reference import inside, spline_slopes, spline_values


def pinhole_normal_equations(pixel_map: PixelMap, nodes: np.ndarray, camera: PlacedCamera, f: np.ndarray,
                             g: np.ndarray, u: np.ndarray, du: np.ndarray, degree: int = 3,
                             later: PlacedCamera | None = None) -> PixelEquations:
    """M and b of one frame.

    nodes : (n_nodes, 2|3) mm; f, g : (ny, nx) reference image and frame, GV; u : (n_nodes, 2|3) mm; du : (n_nodes, 2|3,
    n) its derivatives, mm per unit; degree : of the spline; later : the camera of the frame, where the specimen moves.
    """
    later = camera if later is None else later
    x, still, moved = pixel_map.points(), in_space(nodes), in_space(nodes) + in_space(u)
    here, there = pixel_map.interpolate(still), pixel_map.interpolate(moved)  # (n_pixels, 3) mm
    seen = later.project(there)
    valid = inside(seen, pixel_map.shape)
    r = np.where(valid, spline_values(f, x, degree) - spline_values(g, seen, degree), 0.0)

    before = camera.jacobian(here) @ _tangents(pixel_map, still)  # (n_pixels, 2, 2)
    jacobian = later.jacobian(there)
    F = jacobian @ _tangents(pixel_map, moved) @ np.linalg.inv(before)
    grad_g = np.linalg.solve(np.swapaxes(F, 1, 2), spline_slopes(f, x, degree)[:, :, None])[:, :, 0]
    phi = pixel_map.interpolate(in_space(du).reshape(len(du), -1)).reshape(len(x), 3, -1)  # (n_pixels, 3, n)
    L = np.where(valid[:, None], np.einsum("xc,xcd,xdi->xi", grad_g, jacobian, phi), 0.0)
    return PixelEquations(M=L.T @ L, b=L.T @ r, r=r, L=L, valid=valid)


def _tangents(pixel_map: PixelMap, points: np.ndarray) -> np.ndarray:
    """d point / d (a, b) at every pixel  # (n_nodes, 3) -> (n_pixels, 3, 2)"""
    owner = np.repeat(np.arange(pixel_map.n_elements), pixel_map.pixels_per_element)
    found = np.empty((len(owner), 3, 2))
    places = np.column_stack([pixel_map.a, pixel_map.b]).astype(float)  # (n_pixels, 2) in the reference cell
    for kind in np.unique(pixel_map.kind):
        of_kind = np.flatnonzero(pixel_map.kind[owner] == kind)
        n, by = N_NODES[kind], cell_type(CELLS[kind]).shape_gradients(places[of_kind])  # (n_pixels, n, 2)
        found[of_kind] = np.einsum("xic,xid->xcd", points[pixel_map.conn[owner[of_kind], :n]], by)
    return found
