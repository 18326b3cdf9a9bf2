"""A virtual in-situ test in a scanner: Gaussian blobs at material points, carried by the solution of another mesh.

The bar has a waist, is held at its bottom and pulled at its top. Blobs are rendered at their deformed places, by no
spline: what is compared with is not the correlator's own interpolation.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from idic.experiment_file import load_experiment
from idic.fe import cell_type
from idic.model import build_forward

VOXEL_MM, ORIGIN_PX, NOISE_GV, CONTRAST_GV = 0.02, np.array([10.0, 9.0, 7.0]), 2.0, 30.0
BLOB_PX, FORCE_NOISE = 1.6, 2.0
STEP_MM = 1e-4  # of the differences for a deformation gradient
COARSE, FINE = (3, 5), (5, 8)
LINEAR = 'law = "elastic"'
ELASTIC = (LINEAR + '\nE = {{ value = {E}, unit = "MPa", identify = true }}\n'
           "nu = {{ value = {nu}, identify = true }}\n")
TRUTH = {"E": 70000.0, "nu": 0.33}


@dataclass(frozen=True)
class Tomograms:
    """side : voxels of a cube; n_scans : with the two at rest; drift : (n_scans, 3) voxels, motion of each scan;
    growth : (n_scans,) of all lengths in each scan, about the middle of the volume; seed : of texture and noise; mesh,
    true_mesh : elements across and along, of the user and of the truth; hidden : tables of the truth alone; strain : at
    the end; noise_gv : of a voxel; law : of the truth, with its further keys"""

    side: int = 44
    n_scans: int = 4
    drift: np.ndarray | None = None
    growth: np.ndarray | None = None
    extra: str = field(default="")
    seed: int = 3
    mesh: tuple[int, int] = COARSE
    true_mesh: tuple[int, int] = FINE
    hidden: str = ""
    strain: float = 0.012
    noise_gv: float = NOISE_GV
    law: str = LINEAR

    @property
    def size_mm(self) -> np.ndarray:
        """Width, depth and length of the bar."""
        return VOXEL_MM * (self.side - np.array([20.0, 18.0, 14.0]))

    def write(self, folder: Path) -> Path:
        """Mesh, log, scans and experiment.toml."""
        (folder / "scans").mkdir(parents=True)
        self._mesh(self.mesh, folder / "mesh.inp")
        self._mesh(self.true_mesh, folder / "fine.inp")
        stroke = np.concatenate([[0.0], np.linspace(0.0, self.strain * self.size_mm[2], self.n_scans - 1)])
        log = np.column_stack([60.0 * np.arange(self.n_scans), stroke, 0.0 * stroke])
        _write_log(folder, log)
        np.save(folder / "scans" / "scan_00.npy", np.zeros((self.side,) * 3, np.uint16))
        for k in range(1, self.n_scans):
            np.save(folder / "scans" / f"scan_{k:02d}.npy", np.zeros((self.side,) * 3, np.uint16))
        truth = self.tables("fine.inp", TRUTH).replace("still_frames = [0, 1]\n", "").replace(
            "[scanner]\n", "[scanner]\nnoise_std_gv = 1.0\n").replace(LINEAR, self.law) + self.hidden
        (folder / "truth.toml").write_text(truth)
        experiment = load_experiment(folder / "truth.toml")
        states = list(build_forward(experiment).march(experiment.model.parameters))
        rng = np.random.default_rng(self.seed)
        at_rest = self.n_scans - len(states)
        log[at_rest:, 2] = [state.channels[0] for state in states]
        log[:, 2] += FORCE_NOISE * rng.normal(size=self.n_scans)
        _write_log(folder, log)
        motions = [np.zeros_like(states[0].seen_u)] * at_rest + [state.seen_u for state in states]
        self._scans(folder, experiment.model.mesh.blocks[0].connectivity, motions, rng)
        (folder / "truth.toml").unlink()
        (folder / "fine.inp").unlink()
        (folder / "experiment.toml").write_text(self.tables("mesh.inp", {"E": 60000.0, "nu": 0.3}))
        return folder

    def tables(self, mesh: str, values: dict[str, float]) -> str:
        """experiment.toml"""
        return (f'[experiment]\nvolumes = "scans/*.npy"\nloads = "loads.csv"\nmesh = "{mesh}"\nkind = "solid"\n'
                f'still_frames = [0, 1]\nreference = [0, 1]\n\n[scanner]\nvoxel_mm = {VOXEL_MM}\n'
                f'origin_px = {ORIGIN_PX.tolist()}\naxes = ["+col", "+row", "+slice"]\n{self.extra}\n'
                f"[material.BODY]\n{ELASTIC.format(**values)}\n"
                '[[boundary]]\nnodes = "BOTTOM"\nux = 0.0\nuy = 0.0\nuz = 0.0\n\n'
                '[[boundary]]\nnodes = "TOP"\nux = 0.0\nuy = 0.0\nuz = { column = "stroke_mm" }\n\n'
                '[[channel]]\ncolumn = "force_N"\nsimulated = { reaction = "TOP", component = "z" }\n'
                f"noise_std = {FORCE_NOISE}\n")

    def _waist(self, z: np.ndarray) -> np.ndarray:
        return 1.0 - 0.25 * np.sin(np.pi * z / self.size_mm[2]) ** 2

    def _mesh(self, counts: tuple[int, int], file: Path) -> None:
        n, nz = counts
        x, y, z = (np.linspace(0.0, size, k + 1) for size, k in zip(self.size_mm, (n, n, nz), strict=True))
        Z, Y, X = np.meshgrid(z, y, x, indexing="ij")
        nodes = np.stack([X, Y, Z], axis=-1).reshape(-1, 3)
        middle = self.size_mm[0] / 2
        nodes[:, 0] = middle + (nodes[:, 0] - middle) * self._waist(nodes[:, 2])
        def at(a, b, c):
            return (c * (n + 1) + b) * (n + 1) + a + 1
        cells = [[at(a, b, c), at(a + 1, b, c), at(a + 1, b + 1, c), at(a, b + 1, c), at(a, b, c + 1),
                  at(a + 1, b, c + 1), at(a + 1, b + 1, c + 1), at(a, b + 1, c + 1)]
                 for c in range(nz) for b in range(n) for a in range(n)]
        lines = ["*NODE", *(f"{k}, {p[0]:.9g}, {p[1]:.9g}, {p[2]:.9g}" for k, p in enumerate(nodes, 1)),
                 "*ELEMENT, TYPE=C3D8, ELSET=BODY",
                 *(", ".join(map(str, [k, *cell])) for k, cell in enumerate(cells, 1))]
        for name, chosen in (("BOTTOM", nodes[:, 2] < 1e-9), ("TOP", nodes[:, 2] > self.size_mm[2] - 1e-9)):
            lines += [f"*NSET, NSET={name}", ",\n".join(str(k + 1) for k in np.flatnonzero(chosen))]
        file.write_text("\n".join(lines) + "\n")

    def _carried(self, points: np.ndarray, cells: np.ndarray, motion: np.ndarray) -> np.ndarray:
        """Points after the motion of the fine mesh, whose elements beyond the bar go on straight  # (n, 3) mm"""
        n, nz = self.true_mesh
        width, depth, length = self.size_mm
        layers = self._waist(np.linspace(0.0, length, nz + 1))
        c = np.clip((points[:, 2] / length * nz).astype(int), 0, nz - 1)
        t = points[:, 2] / length * nz - c
        x = (width / 2 + (points[:, 0] - width / 2) / (layers[c] * (1 - t) + layers[c + 1] * t)) / width * n
        y = points[:, 1] / depth * n
        a, b = np.clip(x.astype(int), 0, n - 1), np.clip(y.astype(int), 0, n - 1)
        N = cell_type("hex8").shape_functions(np.clip(2.0 * np.column_stack([x - a, y - b, t]) - 1.0, -2.5, 2.5))
        return points + np.einsum("vi,vic->vc", N, motion[cells[(c * n + b) * n + a]])

    def _scans(self, folder: Path, cells: np.ndarray, motions: list[np.ndarray], rng: np.random.Generator) -> None:
        n_blobs = int(1.2 * (self.side / 4.5) ** 3)
        points = rng.uniform(-0.2, self.size_mm + 0.2, (n_blobs, 3))
        heights, scale = rng.normal(size=n_blobs), None
        for k, motion in enumerate(motions):
            places = self._places(points, cells, motion, k)
            F = np.stack([self._places(points + way, cells, motion, k) - self._places(points - way, cells, motion, k)
                          for way in STEP_MM * np.eye(3)], axis=-1) * VOXEL_MM / (2.0 * STEP_MM)
            texture = rendered(places, heights, self.side, np.linalg.inv(F))
            scale = CONTRAST_GV / texture.std() if scale is None else scale
            image = 128.0 + scale * texture + self.noise_gv * rng.normal(size=texture.shape)
            np.save(folder / "scans" / f"scan_{k:02d}.npy", np.clip(np.rint(100.0 * image), 0, 65535).astype(np.uint16))

    def _places(self, points: np.ndarray, cells: np.ndarray, motion: np.ndarray, k: int) -> np.ndarray:
        """Where scan k shows material points  # (n, 3) mm -> (n, 3) voxels"""
        places = self._carried(points, cells, motion) / VOXEL_MM + ORIGIN_PX
        places = places if self.drift is None else places + self.drift[k]
        return places if self.growth is None else places + self.growth[k] * (places - 0.5 * (self.side - 1))


def rendered(places: np.ndarray, heights: np.ndarray, side: int, inverse: np.ndarray) -> np.ndarray:
    """The sum of Gaussian blobs that the material has stretched  # (side, side, side)

    places : (n, 3) column, row, slice; inverse : (n, 3, 3) of the deformation gradients. Blobs that keep their shape
    move by 0.006 voxels otherwise than the material between them, at a strain of 4 %.
    """
    reach = int(np.ceil(4 * BLOB_PX))
    rim = 2 * reach + 2
    volume = np.zeros((side + 2 * rim,) * 3)
    inside = ((places > -reach) & (places < side + reach - 1)).all(axis=1)
    line = np.arange(2 * reach + 1.0)
    for place, height, G in zip(places[inside], heights[inside], inverse[inside] / BLOB_PX, strict=True):
        first = np.floor(place).astype(int) - reach
        x, y, z = (first + line[:, None] - place).T
        metric = G.T @ G
        square = (metric[0, 0] * x**2 + 2.0 * y[:, None] * metric[0, 1] * x + metric[1, 1] * y[:, None] ** 2
                  + (2.0 * z * (metric[0, 2] * x + metric[1, 2] * y[:, None])[..., None]).transpose(2, 0, 1)
                  + metric[2, 2] * z[:, None, None] ** 2)
        a, b, c = first + rim
        volume[c:c + len(z), b:b + len(y), a:a + len(x)] += height * np.exp(-0.5 * square)
    return volume[rim:rim + side, rim:rim + side, rim:rim + side]


def _write_log(folder: Path, log: np.ndarray) -> None:
    rows = "\n".join(f"{time:g},{stroke:.9g},{force:.9g}" for time, stroke, force in log)
    (folder / "loads.csv").write_text(f"time_s,stroke_mm,force_N\n{rows}\n")
