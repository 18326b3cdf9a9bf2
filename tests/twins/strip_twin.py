"""A strip that is clamped and pulled, as a user has it: what virtual tests of a strip share.

Speckle, sensor and files of the experiment, the text of experiment.toml, and the motion of the true mesh; the
material and what is special to a test are its own.
"""

from __future__ import annotations

import numpy as np

from idic.fe import Constraints, Body, Reaction, Section, march
from idic.images import Camera, dense_speckle
from idic.virtual_tests import Sensor, clean_image, painted, record, write_images, write_inp, write_loads


def strip_toml(pixel: float, origin: tuple[float, float], thickness: float, force_noise: float,
               camera: str = "") -> str:
    """experiment.toml without its materials; NOISE is the noise of the images; camera : more lines of [camera]."""
    return f"""
[experiment]
images = "images/*.tif"
loads = "loads.csv"
mesh = "mesh.inp"
mesh_unit = "mm"
kind = "plane_stress"
thickness_mm = {thickness}
[camera]
pixel_size_mm = {pixel}
origin_px = [{origin[0]}, {origin[1]}]
{camera}noise_std_gv = NOISE
[[boundary]]
nodes = "LEFT"
ux = 0.0
uy = 0.0
[[boundary]]
nodes = "RIGHT"
ux = {{ column = "grip_mm" }}
uy = 0.0
[[channel]]
column = "force_N"
simulated = {{ reaction = "RIGHT", component = "x" }}
noise_std = {force_noise}
"""


def pulled(mesh, element_set: str, law, grip: np.ndarray, thickness: float) -> Body:
    """The strip with its left end held and its right end moved along x by `grip` (n_frames,) mm."""
    left, right = mesh.node_sets["LEFT"], mesh.node_sets["RIGHT"]
    dofs = np.concatenate([2 * right, 2 * right + 1, 2 * left, 2 * left + 1])
    shape = np.zeros((len(dofs), 1))
    shape[:len(right)] = 1.0
    return Body(mesh=mesh, kind="plane_stress", thickness=thickness, channels=(Reaction(2 * right),),
                 sections=(Section(element_set, law, mesh.element_sets[element_set]),),
                 constraints=Constraints(dofs, shape, np.asarray(grip)[:, None]))


def marched(model: Body, values: dict, times: np.ndarray, substeps: int):
    """Displacements (n_frames, n_nodes, 2) mm, force (n_frames,) N, and the last state of the march."""
    u, force, state = [], [], None
    for state in march(model, values, times, substeps=substeps):
        u.append(state.u.copy())
        force.append(state.channels[0])
    return np.array(u), np.array(force), state


def write_recording(folder, mesh, u: np.ndarray, camera: Camera, shape: tuple[int, int], noise: float,
                    rng: np.random.Generator, texture_px: float, speckle=(5, 20.0, 235.0),
                    background: float = 25.0) -> float:
    """Images of the true motion with noise; returns its standard deviation, quantisation included.

    texture_px : extent of the pattern; speckle : its seed, darkest and brightest grey value
    """
    seed, dark, bright = speckle
    pattern = dense_speckle(np.random.default_rng(seed), 1.6, dark, bright, extent_px=texture_px)
    texture, sensor = painted(pattern, camera), Sensor(shape, noise_std=noise, background=background)
    (folder / "images").mkdir(parents=True)
    write_images(folder, (record(clean_image(x, mesh.nodes, mesh.blocks, camera, texture, sensor), sensor, rng)
                          for x in u))
    return float(sensor.total_noise_std)


def write_rest(folder, user_mesh, toml: str, times: np.ndarray, columns: dict):
    """Log, mesh and experiment.toml of the user; the path of the latter."""
    write_loads(folder, times, columns)
    write_inp(user_mesh, folder / "mesh.inp", "strip")
    (folder / "experiment.toml").write_text(toml)
    return folder / "experiment.toml"
