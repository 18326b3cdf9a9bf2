"""A recorded tension test as arrays, as a notebook has it: rendered from a finer simulation on another mesh."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import meshio
import numpy as np

from idic.fe import Constraints, Body, Reaction, Section, march
from idic.images import Camera, dense_speckle
from idic.laws import compile as compile_law
from idic.virtual_tests import Sensor, clean_image, painted, record, strip_with_hole

LENGTH, WIDTH, RADIUS, THICKNESS = 12.0, 8.0, 1.5, 2.0  # mm
PIXEL, SHAPE, ORIGIN = 0.1, (95, 135), (67.2, 47.1)
NOISE, FORCE_NOISE = 1.5, 5.0  # GV of 255, N: 1/1000 of the largest force
GRIP = np.array([0.0, 0.02, 0.04, 0.06])  # mm
TRUTH = {"sheet.E": 70000.0, "sheet.nu": 0.3}


@dataclass(frozen=True)
class Recorded:
    """What the laboratory hands over: images (n, ny, nx) uint8, log, the mesh of the user, and the true noise (GV)."""

    images: np.ndarray
    loads: dict[str, np.ndarray]
    mesh: meshio.Mesh
    noise_std_gv: float

    def tables(self, **changes) -> dict:
        """The arguments of `idic.Experiment`."""
        return dict(
            images=self.images, mesh=self.mesh, loads=self.loads, kind="plane_stress", thickness_mm=THICKNESS,
            title="Strip in memory",
            camera={"pixel_size_mm": PIXEL, "origin_px": ORIGIN, "noise_std_gv": self.noise_std_gv},
            materials={"sheet": {"law": "elastic", "E": {"value": 60e3, "unit": "MPa", "identify": True},
                                 "nu": {"value": 0.35, "identify": True}}},
            boundaries=[{"nodes": "LEFT", "ux": 0.0, "uy": 0.0},
                        {"nodes": "RIGHT", "ux": {"column": "grip_mm"}, "uy": 0.0}],
            channels=[{"column": "force_N", "simulated": {"reaction": "RIGHT", "component": "x"},
                       "noise_std": FORCE_NOISE}]) | changes


def users_mesh():
    """quad4, nowhere the nodes of the truth."""
    return strip_with_hole(LENGTH, WIDTH, RADIUS, "quad4", around=4, radial=6, along=3)


def as_meshio(mesh) -> meshio.Mesh:
    """A plane quad4 mesh of idic as another program would hand it over."""
    (block,) = mesh.blocks
    return meshio.Mesh(np.column_stack([mesh.nodes, np.zeros(len(mesh.nodes))]), [("quad", block.connectivity)],
                       point_sets={name: nodes for name, nodes in mesh.node_sets.items()},
                       cell_sets={"sheet": [np.arange(block.n_elements)]})


@cache
def recorded() -> Recorded:
    """The test, rendered once."""
    mesh = strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", around=5, radial=7, along=3, grading=1.5)
    left, right = mesh.node_sets["LEFT"], mesh.node_sets["RIGHT"]
    dofs = np.concatenate([2 * right, 2 * right + 1, 2 * left, 2 * left + 1])
    basis = np.zeros((len(dofs), 1))
    basis[:len(right)] = 1.0
    model = Body(mesh=mesh, kind="plane_stress", thickness=THICKNESS, channels=(Reaction(2 * right),),
                  sections=(Section("sheet", compile_law("elastic", None), mesh.element_sets["sheet"]),),
                  constraints=Constraints(dofs, basis, GRIP[:, None]))
    values = {"sheet": np.array([TRUTH["sheet.E"], TRUTH["sheet.nu"]])}
    states = [(s.u.copy(), s.channels[0]) for s in march(model, values, np.arange(len(GRIP), dtype=float))]
    camera = Camera.from_table(PIXEL, ORIGIN)
    texture = painted(dense_speckle(np.random.default_rng(5), 1.6, 20.0, 235.0, extent_px=220.0), camera)
    sensor, rng = Sensor(SHAPE, noise_std=NOISE, background=25.0), np.random.default_rng(50)
    images = [record(clean_image(u, mesh.nodes, mesh.blocks, camera, texture, sensor), sensor, rng) for u, _ in states]
    force = np.array([f for _, f in states]) + FORCE_NOISE * rng.standard_normal(len(states))
    return Recorded(np.stack(images), {"force_N": force, "grip_mm": GRIP}, as_meshio(users_mesh()),
                    sensor.total_noise_std)
