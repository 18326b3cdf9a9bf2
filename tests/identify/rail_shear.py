"""A V-notched rail shear specimen and a strip in tension as a DIC system exports them: ARAMIS stages with the force.

The truth is solved with six-node triangles that share no code with what identifies; facets average the motion and
none reaches over an edge, so that the points end half a facet before the specimen does. Lengths in mm.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.path import Path as Region
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from idic.fe import mesh_polygon, raise_order

GAUSS = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4]]) / 6.0  # area coordinates, equal weights
WOVEN = {"E1": 55e3, "E2": 55e3, "nu12": 0.05, "G12": 4e3}  # MPa
UNIDIRECTIONAL = {"E1": 130e3, "E2": 9e3, "nu12": 0.3, "G12": 4.5e3}
THICKNESS, PITCH, FACET = 2.0, 1.5, 2.0
NOISE_MM, FORCE_NOISE_N = 0.5e-3, 2.0
HALF, WAIST, ROOT = 12.5, 15.5, 1.3  # half the width between the rails and between the notches, radius of a notch
STRIP = (12.5, 40.0)  # half width and half length


@dataclass(frozen=True)
class Specimen:
    """outline : entries for the mesher; polygon : (n, 2) fine corners; view : half sizes of what the camera sees;
    along : axis between the ends; motion : of the loaded end along y; holes : x, y, radius of each"""

    outline: list
    polygon: np.ndarray
    view: tuple[float, float]
    along: int
    motion: float
    holes: tuple[tuple[float, float, float], ...] = ()


def rail(strain: float = 0.01) -> Specimen:
    """Sheared between two rails at x = -HALF and HALF; notches of 90 degrees above and below."""
    centre, reach = WAIST + ROOT, ROOT * np.sqrt(0.5)
    edge = centre - reach + HALF - reach
    outline = [[-HALF, -edge], [-reach, reach - centre], [0.0, -WAIST, reach, reach - centre], [HALF, -edge],
               [HALF, edge], [reach, centre - reach], [0.0, WAIST, -reach, centre - reach], [-HALF, edge]]
    turn = np.linspace(0.25 * np.pi, -0.25 * np.pi, 21)
    top = np.column_stack([ROOT * np.sin(turn), centre - ROOT * np.cos(turn)])
    polygon = np.vstack([[-HALF, -edge], -top, [HALF, -edge], [HALF, edge], top, [-HALF, edge]])
    return Specimen(outline, polygon, (HALF, edge), 0, 2.0 * HALF * strain)


def strip(strain: float = 0.004) -> Specimen:
    """Pulled along y; the camera sees its middle."""
    a, b = STRIP
    corners = np.array([[-a, -b], [a, -b], [a, b], [-a, b]])
    return Specimen(corners.tolist(), corners, (a, 25.0), 1, 2.0 * b * strain)


def waisted(strain: float = 0.002) -> Specimen:
    """Pulled along y, narrower in the middle, where it has a hole; the camera sees no ends."""
    half = np.array([[10.0, -30.0], [10.0, -22.0], [7.0, -13.0], [7.0, 13.0], [10.0, 22.0], [10.0, 30.0]])
    corners = np.vstack([half, half[::-1] * [-1.0, 1.0]])
    return Specimen(corners.tolist(), corners, (10.0, 26.0), 1, 60.0 * strain, ((0.0, 0.0, 2.5),))


def write_stages(folder: Path, specimen: Specimen, ply: dict, angle_deg: float = 0.0, stages: int = 8,
                 size: float = 0.8, seed: int = 0, stiffer: float = 1.0, slip: float | None = None) -> None:
    """The folder of stages as an ARAMIS export.

    stiffer : factor of thickness and stiffness of this specimen; slip : what the grip loses past the middle of the
    test (mm), where the travel of the machine is a second analog channel
    """
    rng = np.random.default_rng((26, seed))
    nodes, cells, u, force = solved(specimen, ply, angle_deg, size)
    at = facets(specimen)
    step = FACET * (np.arange(3) - 1) / 3.0
    moved = np.mean([motion_at(nodes, cells, u, at + [a, b]) for a in step for b in step], axis=0)
    (folder / "stages").mkdir(parents=True)
    for k in range(stages):
        share = k / (stages - 1)
        places = np.column_stack([at + share * moved, np.zeros(len(at))]) + rng.normal(0.0, NOISE_MM, (len(at), 3))
        read = share * stiffer * force + rng.normal(0.0, FORCE_NOISE_N)
        travel = [] if slip is None else [
            "# Name : Weg", "travel_mm;untransformed;transformed",
            f"{(way := share * specimen.motion + slip * (share > 0.5)):.5f};{way / 5.0:.5f};{way:.5f}"]
        rows = [f"{number};{x:.5f};{y:.5f};{z:.5f}" for number, (x, y, z) in enumerate(places)]
        (folder / "stages" / f"Stufe_{k:04d}.csv").write_text("\n".join([
            "# Units: length:mm angle:deg time:s force:N ", f"# Stage: Stufe {k}", "stage;index;relative_time;date",
            f'"Stufe {k}";{k};{2.0 * k:.4f};"2024-02-28T14:06:{k:02d}.5"', "# Name : Kraft",
            "force;untransformed;transformed", f"{read:.4f};{read / 400.0:.4f};{read:.4f}", *travel,
            "# Name : Flaeche 1", "id;x;y;z", *rows]) + "\n")


def facets(specimen: Specimen) -> np.ndarray:
    """Middles of the facets: a grid, half a facet within the specimen and the view  # (n, 2)"""
    reach = [np.arange(-half + 0.5 * FACET + 0.3 * axis, half - 0.5 * FACET + 1e-9, PITCH)
             for axis, half in enumerate(specimen.view)]
    at = np.stack(np.meshgrid(*reach), axis=-1).reshape(-1, 2)
    a = specimen.polygon
    along = np.roll(a, -1, axis=0) - a
    share = np.clip(((at[:, None] - a) * along).sum(axis=-1) / (along**2).sum(axis=-1), 0.0, 1.0)
    far = np.linalg.norm(at[:, None] - (a + share[..., None] * along), axis=-1).min(axis=1)
    for x, y, radius in specimen.holes:
        far = np.minimum(far, np.hypot(*(at - [x, y]).T) - radius)
    return at[Region(a).contains_points(at) & (far > 0.5 * FACET - 1e-9)]


def solved(specimen: Specimen, ply: dict, angle_deg: float,
           size: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Nodes, triangles, displacement (n, 2) at the last stage, and the force along y on the loaded end  # N"""
    mesh = raise_order(mesh_polygon(specimen.outline, specimen.holes, size))
    nodes, cells = mesh.nodes, mesh.blocks[0].connectivity
    stiffness = np.zeros((len(cells), 12, 12))
    for point in GAUSS:
        slopes = _slopes(point)
        jacobian = np.einsum("eai,aj->eij", nodes[cells], slopes)
        gradient = np.einsum("aj,eji->eai", slopes, np.linalg.inv(jacobian))
        B = np.zeros((len(cells), 3, 12))
        B[:, 0, 0::2] = B[:, 2, 1::2] = gradient[:, :, 0]
        B[:, 1, 1::2] = B[:, 2, 0::2] = gradient[:, :, 1]
        weight = np.linalg.det(jacobian) / 6.0 * THICKNESS
        stiffness += np.einsum("eki,kl,elj,e->eij", B, _plane_stress(ply, angle_deg), B, weight)
    dofs = np.stack([2 * cells, 2 * cells + 1], axis=-1).reshape(len(cells), 12)
    K = sparse.csc_array(sparse.coo_array((stiffness.ravel(), (np.repeat(dofs, 12, axis=1).ravel(),
                                                               np.tile(dofs, (1, 12)).ravel())),
                                          shape=(2 * len(nodes),) * 2))
    end = nodes[:, specimen.along]
    held, loaded = np.flatnonzero(end < end.min() + 1e-6), np.flatnonzero(end > end.max() - 1e-6)
    given = np.concatenate([2 * held, 2 * held + 1, 2 * loaded, 2 * loaded + 1])
    u = np.zeros(2 * len(nodes))
    u[2 * loaded + 1] = specimen.motion
    free = np.setdiff1d(np.arange(len(u)), given)
    u[free] = splu(K[free][:, free]).solve(-(K[free] @ u))
    return nodes, cells, u.reshape(-1, 2), float((K @ u)[2 * loaded + 1].sum())


def motion_at(nodes: np.ndarray, cells: np.ndarray, u: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Displacement at places of the body  # (n, 2)"""
    corners = nodes[cells[:, :3]]
    near = cKDTree(corners.mean(axis=1)).query(at, k=20)[1]  # (n, 20)
    a, b, c = (corners[near][:, :, k] for k in range(3))
    shares = np.linalg.solve(np.stack([b - a, c - a], axis=-1), (at[:, None] - a)[..., None])[..., 0]
    shares = np.concatenate([1.0 - shares.sum(axis=-1, keepdims=True), shares], axis=-1)
    best = shares.min(axis=-1).argmax(axis=1)
    row = np.arange(len(at))
    assert shares[row, best].min() > -1e-2  # edges of triangles cut the arcs
    l1, l2, l3 = shares[row, best].T
    weights = np.stack([l1 * (2 * l1 - 1), l2 * (2 * l2 - 1), l3 * (2 * l3 - 1), 4 * l1 * l2, 4 * l2 * l3, 4 * l3 * l1])
    return np.einsum("an,nai->ni", weights, u[cells[near[row, best]]])


def _slopes(point: np.ndarray) -> np.ndarray:
    a, b, c = point
    return np.array([[1 - 4 * a, 1 - 4 * a], [4 * b - 1, 0], [0, 4 * c - 1], [4 * (a - b), -4 * b], [4 * c, 4 * b],
                     [-4 * c, 4 * (a - c)]])


def _plane_stress(ply: dict, angle_deg: float) -> np.ndarray:
    e1, e2, nu, g = (ply[name] for name in ("E1", "E2", "nu12", "G12"))
    own = np.array([[e1, nu * e2, 0.0], [nu * e2, e2, 0.0], [0.0, 0.0, g * (1.0 - nu * nu * e2 / e1)]])
    own /= 1.0 - nu * nu * e2 / e1
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    turned = np.array([[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]])
    return turned.T @ own @ turned
