"""Cost of whole identifications from volumes: CPU seconds, wall, and peak memory of all processes.

python studies/evidence/volumes/scale.py OUT [SIDE:SCANS:ELEMENTS:WORKERS[:ITERATIONS] ...]

A bar fills a cube of SIDE voxels and is pulled in SCANS scans (8 bit, the first two at rest): elastic-plastic with
linear hardening, four unknowns, ELEMENTS cubed hex8, the truth on 12 x 12 x 14 hex20. Scans are rendered slice by
slice, in two threads, as a sum of plane waves at the material point of each voxel. Memory is that of `idic identify`
and of all that it starts, summed, ten times a second; pages of a file that two processes share count twice.
ITERATIONS: stop after so many. Default: 256 voxels and 4, 8, 16 scans, 384 and 512 voxels and 8 scans with 31 cubed
hex8, two workers.

Measured beside other jobs: 256:8:20:2 569 s, 425 CPU s, 3.5 GB, E +0.18 +- 0.80 %, nu -0.21 +- 0.30 %, yield stress
+0.18 +- 0.33 %, hardening -7.0 +- 6.3 % (noise alone: 0.02, 0.01, 0.02, 0.24 %); 512:8:31:2 25 min, 2039 CPU s
(simulations 1014, scans 362), 8.9 GB, converged after 11 evaluations, and 258 CPU s, 3.5 GB for the sums of a model's
error at its end: E +0.82 %, nu -0.51 %, yield stress +0.02 %, hardening -5.2 %, by the two meshes (`meshes.py`), are
1.2, 1.8, 0.1 and 1.0 std.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numba
import numpy as np
import psutil

from idic.fe import Block, Body, Constraints, Mesh, Reaction, Section, march, raise_order
from idic.laws import compile as compile_law
from idic.virtual_tests.meshes import write_inp
from idic.virtual_tests.volume_bar import TRUTH

DEFAULT = ("256:4:20:2", "256:8:20:2", "256:16:20:2", "256:8:31:2", "384:8:31:2", "512:8:31:2")
VOXEL_MM, RIM_PX, NOISE_GV, FORCE_NOISE_N, STRAIN = 0.01, 6.0, 4.0, 0.05, 0.03
N_WAVES, WAVELENGTHS_PX, CONTRAST_GV = 16, (5.0, 11.0), 32.0
TRUE_ELEMENTS, RENDERING_THREADS = (12, 12, 14), 2
INVERSE_STEPS = 4  # of x -> X, each gains one and a half digits at a strain of 3 %

TOML = """\
[experiment]
volumes = "scans/*.npy"
loads = "loads.csv"
mesh = "mesh.inp"
kind = "solid"
still_frames = [0, 1]

[scanner]
voxel_mm = {voxel}
origin_px = [{rim}, {rim}, {rim}]
axes = ["+col", "+row", "+slice"]

[material.BODY]
law = "j2_linear"
E = {{ value = 1350, unit = "MPa", identify = true, bounds = [50, 2e4] }}
nu = {{ value = 0.32, identify = true, bounds = [0.0, 0.49] }}
yield_stress = {{ value = 33, unit = "MPa", identify = true, bounds = [3, 300] }}
hardening_modulus = {{ value = 70, unit = "MPa", identify = true }}

[[boundary]]
nodes = "BOTTOM"
ux = 0.0
uy = 0.0
uz = 0.0

[[boundary]]
nodes = "TOP"
ux = 0.0
uy = 0.0
uz = {{ column = "stroke_mm" }}

[[channel]]
column = "force_N"
simulated = {{ reaction = "TOP", component = "z" }}
noise_std = {noise}
"""


def brick(counts: tuple[int, int, int], side_mm: float) -> Mesh:
    """A cube of hex8, node 0 at its origin, x fastest."""
    nx, ny, nz = counts
    z, y, x = np.meshgrid(*(np.linspace(0.0, side_mm, n + 1) for n in (nz, ny, nx)), indexing="ij")
    number = np.arange(x.size).reshape(nz + 1, ny + 1, nx + 1)
    corners = [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0)]
    cells = np.stack([number[c:nz + c, b:ny + b, a:nx + a].ravel() for c, b, a in corners], axis=1)
    return Mesh(np.column_stack([x.ravel(), y.ravel(), z.ravel()]), (Block("hex8", cells),),
                element_sets={"BODY": np.arange(len(cells))},
                node_sets={"BOTTOM": number[0].ravel(), "TOP": number[-1].ravel()})


def pulled(mesh: Mesh, stroke_mm: np.ndarray, increments: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """Displacements (n_scans, n_nodes, 3) mm and force (n_scans,) N between rigid grips; increments : per scan."""
    times = np.linspace(0.0, len(stroke_mm) - 1.0, increments * (len(stroke_mm) - 1) + 1)
    bottom, top = mesh.node_sets["BOTTOM"], mesh.node_sets["TOP"]
    dofs = np.concatenate([3 * top + 2, 3 * top, 3 * top + 1, *(3 * bottom + k for k in range(3))])
    basis = np.zeros((len(dofs), 1))
    basis[:len(top)] = 1.0
    law = compile_law("j2_linear", "finite")
    body = Body(mesh=mesh, kind="solid", sections=(Section("BODY", law, mesh.element_sets["BODY"]),),
                constraints=Constraints(dofs, basis, np.interp(times, np.arange(len(stroke_mm)), stroke_mm)[:, None]),
                channels=(Reaction(3 * top + 2),))
    values = np.array([TRUTH[f"BODY.{name}"] for name in law.spec.parameter_names])
    states = [(state.u.copy(), state.channels[0]) for k, state in enumerate(march(body, {"BODY": values}, times))
              if k % increments == 0]
    return np.array([u for u, _ in states]), np.array([force for _, force in states])


def on_half_grid(u: np.ndarray, mesh: Mesh, counts: tuple[int, int, int]) -> np.ndarray:
    """Nodal values of hex20 at the corners, middles of edges, of faces and of elements  # (n_z, n_y, n_x, 3)

    u : (n_nodes, 3). The serendipity functions there: -1/4 at corners; 1/2 (face) or 1/4 (element) at edges.
    """
    shape = 2 * np.array(counts[::-1]) + 1
    far = mesh.nodes.max(axis=0)
    x, y, z = np.rint(mesh.nodes / far * 2 * np.array(counts)).astype(int).T
    grid, known = np.zeros((*shape, 3)), np.zeros(shape, bool)
    grid[z, y, x], known[z, y, x] = u, True
    whole, half = slice(None, None, 2), slice(1, None, 2)

    def ends(at: tuple, axes: tuple[int, ...]) -> list[np.ndarray]:
        """Values beside the points `at`, one step along each of these axes."""
        places = [[]]
        for axis in range(3):
            ways = (slice(None, -2, 2), slice(2, None, 2)) if axis in axes else (at[axis],)
            places = [[*place, way] for place in places for way in ways]
        return [grid[tuple(place)] for place in places]

    for axes in ((0, 1), (0, 2), (1, 2)):
        at = tuple(half if axis in axes else whole for axis in range(3))
        edges = [value for axis in axes for value in ends(at, (axis,))]
        grid[at], known[at] = 0.5 * sum(edges) - 0.25 * sum(ends(at, axes)), True
    at = (half,) * 3
    edges = [value for axes in ((0, 1), (0, 2), (1, 2)) for value in ends(at, axes)]
    grid[at], known[at] = 0.25 * sum(edges) - 0.25 * sum(ends(at, (0, 1, 2))), True
    assert known.all()
    return grid


@numba.njit(cache=True, fastmath=True, nogil=True)
def _slice(z, n, side, counts, u, waves, phases, out):
    """Texture at the material points of a slice; u (nz, ny, nx, 3) voxels, waves (n, 3) radians per voxel"""
    point, step, w = np.empty(3), np.empty(3), np.empty((3, 2))
    base = np.empty(3, np.int64)
    for y in range(n):
        for x in range(n):
            point[0], point[1], point[2] = x, y, z
            for _ in range(INVERSE_STEPS):
                for d in range(3):
                    t = (point[d] - RIM_PX) / side * counts[d]
                    base[d] = min(max(int(np.floor(t)), 0), counts[d] - 1)
                    w[d, 1] = t - base[d]
                    w[d, 0] = 1.0 - w[d, 1]
                step[:] = 0.0
                for a in range(2):
                    for b in range(2):
                        for c in range(2):
                            weight = w[2, a] * w[1, b] * w[0, c]
                            for d in range(3):
                                step[d] += weight * u[base[2] + a, base[1] + b, base[0] + c, d]
                point[0], point[1], point[2] = x - step[0], y - step[1], z - step[2]
            total = 0.0
            for k in range(waves.shape[0]):
                total += np.cos(waves[k, 0] * point[0] + waves[k, 1] * point[1] + waves[k, 2] * point[2] + phases[k])
            out[y, x] = total


def write(folder: Path, n: int, n_scans: int, elements: int, seed: int = 0) -> None:
    """Scans, log, mesh and experiment.toml."""
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "scans").mkdir(parents=True)
    rng, side_px = np.random.default_rng(seed), n - 1.0 - 2.0 * RIM_PX
    truth = raise_order(brick(TRUE_ELEMENTS, side_px * VOXEL_MM))
    stroke = np.concatenate([[0.0], np.linspace(0.0, STRAIN * side_px * VOXEL_MM, n_scans - 1)])
    motion, force = pulled(truth, stroke)
    ways = rng.normal(size=(N_WAVES, 3))
    waves = ways * (2.0 * np.pi / (rng.uniform(*WAVELENGTHS_PX, N_WAVES) * np.linalg.norm(ways, axis=1)))[:, None]
    phases, counts = rng.uniform(0.0, 2.0 * np.pi, N_WAVES), 2 * np.array(TRUE_ELEMENTS)
    for scan, u in enumerate(motion):
        target = np.lib.format.open_memmap(folder / "scans" / f"scan_{scan:02d}.npy", "w+", np.uint8, (n, n, n))
        on_grid = on_half_grid(u / VOXEL_MM, truth, TRUE_ELEMENTS)

        def render(z: int, own: np.random.Generator, on_grid=on_grid, target=target) -> None:
            plane = np.empty((n, n))
            _slice(z, n, side_px, counts, on_grid, waves, phases, plane)
            values = 128.0 + CONTRAST_GV * np.sqrt(2.0 / N_WAVES) * plane + NOISE_GV * own.standard_normal((n, n))
            target[z] = np.clip(np.rint(values), 0, 255)

        with ThreadPoolExecutor(RENDERING_THREADS) as pool:
            list(pool.map(render, range(n), rng.spawn(n)))
        target.flush()
        del target
    force = force + FORCE_NOISE_N * rng.standard_normal(n_scans)
    np.savetxt(folder / "loads.csv", np.column_stack([np.arange(n_scans), 60.0 * np.arange(n_scans), stroke, force]),
               delimiter=",", header="frame,time_s,stroke_mm,force_N", comments="", fmt=["%d", "%g", "%.9g", "%.9g"])
    write_inp(brick((elements,) * 3, side_px * VOXEL_MM), folder / "mesh.inp", "Bar")
    (folder / "experiment.toml").write_text(TOML.format(voxel=VOXEL_MM, rim=RIM_PX, noise=FORCE_NOISE_N))


def measured(folder: Path, run: Path, workers: int, iterations: int | None = None) -> dict[str, float]:
    """Wall and CPU seconds of `idic identify`, and its peak memory: of it alone, of all processes, in GB."""
    shutil.rmtree(run, ignore_errors=True)
    start_s, cpu_s, driver, together = time.perf_counter(), {}, 0, 0
    limit = [] if iterations is None else ["--set", f"options.max_iterations={iterations}"]
    process = psutil.Popen([sys.executable, "-m", "idic", "identify", str(folder), "--out", str(run), "--workers",
                            str(workers), *limit], stdout=subprocess.DEVNULL)
    while process.poll() is None:
        sizes = []
        for member in (process, *process.children(recursive=True)):
            try:
                with member.oneshot():
                    sizes.append(member.memory_info().rss)
                    spent = member.cpu_times()
                cpu_s[member.pid] = spent.user + spent.system
            except psutil.Error:
                continue
        driver, together = max(driver, *sizes[:1], 0), max(together, sum(sizes))
        time.sleep(0.1)
    return {"wall_s": time.perf_counter() - start_s, "cpu_s": sum(cpu_s.values()), "driver_gb": driver / 1e9,
            "all_gb": together / 1e9, "exit": process.returncode}


def main() -> None:
    out = Path(sys.argv[1])
    for case in sys.argv[2:] or DEFAULT:
        n, n_scans, elements, workers, *iterations = map(int, case.split(":"))
        folder = out / "experiment"
        start_s = time.process_time()
        write(folder, n, n_scans, elements)
        rendering = time.process_time() - start_s
        figures = measured(folder, out / "run", workers, *iterations)
        result = json.loads((out / "run" / "result.json").read_text(encoding="utf-8"))
        errors = " ".join(f"{(result['parameters'][name]['value'] - truth) / result['parameters'][name]['std']:+.2f}"
                          for name, truth in TRUTH.items())
        cost = {name: round(value, 1) for name, value in result["cost"].items() if isinstance(value, (int, float))}
        print(f"{n}³ x {n_scans}, {elements}³ hex8, {workers} workers: wall {figures['wall_s']:.0f} s, CPU "
              f"{figures['cpu_s']:.0f} s, memory {figures['driver_gb']:.2f} GB driver, {figures['all_gb']:.2f} GB all; "
              f"{result['status']} after {result['iterations']} iterations, errors {errors} std; rendering "
              f"{rendering:.0f} s; {cost}", flush=True)


if __name__ == "__main__":
    main()
