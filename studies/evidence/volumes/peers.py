"""Free FE-DVC of idic beside pyxel and the local step of al-dvc: CPU time and error on the same two volumes.

python studies/evidence/volumes/peers.py PYTHON OUT [SIDE]

PYTHON : an interpreter that has pyxel-dic and al-dvc. Volumes of SIDE voxels cubed: plane waves of 5 to 11 voxels,
contrast 32, independent noise of 3 grey values, a motion of 1.6 voxels with 1 % strain and a wave of half a voxel over
80. hex8 of 12 voxels; subsets of al-dvc every 12 voxels. Error: rms over the nodes that are no surface, per component,
in voxels. Peers run in processes of their own, one thread each; time is CPU time from volumes and mesh to motion,
without imports and, of al-dvc and idic, without what the first run compiles.

Measured, 96 voxels (CPU s, error): idic 0.19, 0.022 with the default length, 0.24, 0.030 with next to none; pyxel
2026.10 3.5, 0.026, length 24, 3.1, 0.029, length 5, 4.3, 0.033 without; al-dvc 1.2 0.47, 0.024, subset 16, 0.83, 0.049,
subset 24. 128 voxels: idic 0.50, 0.024; al-dvc, subset 16, 1.5, 0.026. Load 16 on two cores.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from scale import TOML, brick

from idic.experiment_file import load_experiment
from idic.measure import volume_motion
from idic.virtual_tests.meshes import write_inp

NODE_PX, RIM_PX, NOISE_GV, CONTRAST_GV, VOXEL_MM = 12, 8, 3.0, 32.0, 0.01
N_WAVES, WAVELENGTHS_PX, STEPS = 32, (5.0, 11.0), 25
LENGTHS_PX = (1.0, 24.0)  # of idic: next to none, the default


def motion(points: np.ndarray) -> np.ndarray:
    """Of material points  # (3, ...) voxels x, y, z -> the same"""
    x, y, z = points
    wave = 0.5 * np.sin(2.0 * np.pi * (y + 0.4 * z) / 80.0)
    return np.stack([1.3 + 0.01 * (x - 48.0) + wave, -0.8 - 0.004 * (y - 48.0), 0.6 + 0.006 * (z - 48.0) - wave])


def scans(side: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Reference and deformed volume  # (z, y, x) uint8"""
    rng = np.random.default_rng(seed)
    ways = rng.normal(size=(N_WAVES, 3))
    waves = ways * (2.0 * np.pi / (rng.uniform(*WAVELENGTHS_PX, N_WAVES) * np.linalg.norm(ways, axis=1)))[:, None]
    phases = rng.uniform(0.0, 2.0 * np.pi, N_WAVES)
    z, y, x = np.meshgrid(*[np.arange(side, dtype=float)] * 3, indexing="ij")
    places, material, stored = np.stack([x, y, z]), np.stack([x, y, z]), []
    for _ in range(STEPS):
        material = places - motion(material)
    for points in (places, material):
        texture = sum(np.cos(np.tensordot(wave, points, axes=1) + phase)
                      for wave, phase in zip(waves, phases, strict=True))
        values = 128.0 + CONTRAST_GV * np.sqrt(2.0 / N_WAVES) * texture + NOISE_GV * rng.standard_normal(x.shape)
        stored.append(np.clip(np.rint(values), 0, 255).astype(np.uint8))
    return stored[0], stored[1]


def error_of(nodes_px: np.ndarray, u_px: np.ndarray) -> float:
    """nodes_px, u_px : (n, 3)"""
    inner = ((nodes_px > nodes_px.min(axis=0) + 1.0) & (nodes_px < nodes_px.max(axis=0) - 1.0)).all(axis=1)
    gap = u_px[inner] - motion(nodes_px[inner].T).T
    return float(np.sqrt(np.nanmean(gap**2)))


def of_idic(folder: Path, side: int, length_px: float) -> tuple[float, float]:
    """CPU seconds and error."""
    n = (side - 2 * RIM_PX) // NODE_PX
    (folder / "scans").mkdir(parents=True, exist_ok=True)
    for name, scan in zip("01", scans(side), strict=True):
        np.save(folder / "scans" / f"scan_{name}.npy", scan)
    write_inp(brick((n,) * 3, n * NODE_PX * VOXEL_MM), folder / "mesh.inp", "Block")
    (folder / "loads.csv").write_text("frame,time_s,stroke_mm,force_N\n0,0,0,0\n1,60,0.02,1\n")
    text = TOML.format(voxel=VOXEL_MM, rim=RIM_PX, noise=1.0).replace("still_frames = [0, 1]\n", "")
    (folder / "experiment.toml").write_text(text.replace("[scanner]\n", f"[scanner]\nnoise_std_gv = {NOISE_GV}\n"))
    experiment = load_experiment(folder)
    seconds = []
    for _ in range(2):  # the first one compiles or loads what is compiled
        start_s = time.process_time()
        measured = volume_motion(experiment, length_px)
        seconds.append(time.process_time() - start_s)
    nodes = experiment.model.mesh.nodes / VOXEL_MM + RIM_PX
    return seconds[-1], error_of(nodes, measured.u_mm[1] / VOXEL_MM)


PYXEL = """
import json, sys, time
import numpy as np
import pyxel as px
folder, side, node, rim, length = sys.argv[1], *map(float, sys.argv[2:])
f, g = px.Volume(folder + "/scans/scan_0.npy").Load(), px.Volume(folder + "/scans/scan_1.npy").Load()
f.pix, g.pix = (np.ascontiguousarray(part.pix.transpose(2, 1, 0)).astype(float) for part in (f, g))
start = time.process_time()
n = (side - 2 * rim) // node
mesh = px.StructuredMeshHex8(np.array([[rim] * 3, [rim + n * node] * 3]), node)
camera = px.CameraVol([1, 0, 0, 0, 0, 0, 0])
mesh.Connectivity()
f.BuildInterp()
g.BuildInterp()
U, L = None, mesh.Laplacian()
for scale in (2, 1):  # as its MultiscaleInit, which in 2026.10 takes tetrahedra alone
    coarse, parts = mesh.Copy(), (f.Copy(), g.Copy())
    for part in parts:
        part.SubSample(scale)
    coarse.DVCIntegration(max(1, min(5, int(node) // 2**scale)))
    U, _ = px.Correlate(*parts, coarse, camera.SubSampleCopy(scale), l0=30.0 * 2**scale, L=L, U0=U, disp=False)
mesh.DVCIntegration(int(node))
if length:
    U, _ = px.Correlate(f, g, mesh, camera, U0=U, l0=length, L=L, direct=False, disp=False)
else:
    U, _ = px.Correlate(f, g, mesh, camera, U0=U, direct=False, disp=False)
seconds = time.process_time() - start
json.dump({"seconds": seconds, "nodes": mesh.n.tolist(), "u": U[mesh.conn].tolist()}, open(folder + "/peer.json", "w"))
"""


AL_DVC = """
import json, sys, time
import numpy as np
import al_dvc
folder, side, node, rim, subset = sys.argv[1], *map(int, sys.argv[2:])
scans = [np.load(f"{folder}/scans/scan_{k}.npy") for k in (0, 1)]
parameters = al_dvc.dvcpara_default(winsize=subset, winstepsize=node, use_global_step=False, backend="numba",
                                    n_threads=1, verbose=False)
for _ in range(2):
    start = time.process_time()
    result = al_dvc.run_aldvc(parameters, scans, compute_strain=False)
    seconds = time.process_time() - start
nodes, frame = result.dvc_mesh.coordinates, result.result_disp[0]
json.dump({"seconds": seconds, "nodes": nodes.tolist(), "u": np.asarray(frame.U).tolist()},
          open(folder + "/peer.json", "w"))
"""


PEERS = (("pyxel, length", PYXEL, (0.0, 5.0, 24.0)), ("al-dvc, subset", AL_DVC, (16, 24, 32)))


def of_peer(python: str, program: str, folder: Path, side: int, setting: float) -> tuple[float, float]:
    """CPU seconds and error; setting : of pyxel the length of its regularisation, 0: none, of al-dvc the side of a
    subset"""
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
    subprocess.run([python, "-c", program, str(folder), *map(str, (side, NODE_PX, RIM_PX, setting))], check=True,
                   stdout=subprocess.DEVNULL, env=os.environ | threads)
    result = json.loads((folder / "peer.json").read_text())
    nodes = np.array(result["nodes"])
    within = ((nodes > RIM_PX - 1.0) & (nodes < side - RIM_PX)).all(axis=1)
    return result["seconds"], error_of(nodes[within], np.array(result["u"])[within])


def main() -> None:
    python, out = sys.argv[1], Path(sys.argv[2])
    side = int(sys.argv[3]) if len(sys.argv) > 3 else 96
    for length in LENGTHS_PX:
        seconds, error = of_idic(out, side, length)
        print(f"idic, length {length:g}: {seconds:.2f} CPU s, error {error:.4f} voxels", flush=True)
    for name, program, settings in PEERS:
        for setting in settings:
            seconds, error = of_peer(python, program, out, side, setting)
            print(f"{name} {setting:g}: {seconds:.2f} CPU s, error {error:.4f} voxels", flush=True)


if __name__ == "__main__":
    main()
