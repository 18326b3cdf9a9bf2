"""The example `stereo`: a thick plate with a hole in tension, elastoplastic, seen by two cameras at an angle."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from string import Template
from typing import ClassVar

import numpy as np

from idic.fe import Constraints, Mesh, Body, Reaction, Section, march
from idic.images import PinholeCamera
from idic.laws import compile as compile_law
from idic.virtual_tests.experiment_files import empty_folder, write_images, write_loads, write_truth
from idic.virtual_tests.meshes import layered, strip_with_hole, write_inp
from idic.virtual_tests.rendering.render import Sensor, noisy_channel, record
from idic.virtual_tests.ray_tracing import Scene
from idic.virtual_tests.stereo_rig import Rig
from idic.virtual_tests.solid_speckle import SolidSpeckle
from idic.virtual_tests.virtual_test import DEFAULT_NOISE_SHARE, GREY_LEVELS

LENGTH, WIDTH, RADIUS, THICKNESS = 28.0, 16.0, 3.0, 4.0  # mm
SPECKLE_PX = 1.6  # sigma of the dots
CALIBRATION = "calibration.json"

TOML = """\
# A thick open-hole plate in tension before two cameras at an angle, as `idic example stereo` writes it. The truth is in
# truth.json; images by ray tracing of a finer simulation. Try:  idic check experiment.toml,  then  idic identify

[experiment]
title = "Open-hole plate, stereo"
images = "images/*.tif"            # of the first camera
loads = "loads.csv"
mesh = "mesh.inp"
kind = "solid"
surface = "FRONT"                  # the faces that the cameras see

[[camera]]
name = "left"
model = "pinhole"
calibration = "calibration.json"   # both cameras, relative to the first; any known format
$alignment
noise_std_gv = $noise_std_gv

[[camera]]
name = "right"
images = "right/*.tif"             # one per image of the first camera
model = "pinhole"
calibration = "calibration.json"
calibration_camera = 1
noise_std_gv = $noise_std_gv

[material.BODY]
law = "j2_linear"
E = { value = 60e3, unit = "MPa", identify = true, bounds = [1e3, 4e5] }
nu = { value = 0.35, identify = true, bounds = [0.0, 0.49] }
yield_stress = { value = 240, unit = "MPa", identify = true, bounds = [20, 2000] }
hardening_modulus = { value = 1000, unit = "MPa", identify = true }

[[boundary]]
nodes = "LEFT"
ux = 0.0
uy = 0.0
uz = 0.0

[[boundary]]
nodes = "RIGHT"
ux = { column = "grip_displacement_mm", noise_std = 0.0002 }
uy = 0.0
uz = 0.0

[[channel]]
column = "force_N"
simulated = { reaction = "RIGHT", component = "x" }
noise_std = 10.0
"""


@dataclass(frozen=True)
class PlateSize:
    """Pixel size in the middle (mm), image (rows, columns), frames of three stages, mesh densities (around the eighth
    of the hole, radial, beside, through the thickness), distance of the cameras (mm) and their angles (deg)."""

    pixel: float
    shape: tuple[int, int]
    frames: tuple[int, int, int]
    user: tuple[int, int, int, int]
    true: tuple[int, int, int, int]
    distance: float = 300.0
    angles: tuple[float, ...] = (-12.0, 12.0)

    @classmethod
    def of_example(cls, reduced: bool = False) -> PlateSize:
        """That of the example."""
        if reduced:
            return cls(0.16, (125, 195), (3, 3, 4), (2, 3, 2, 1), (3, 4, 3, 2))
        return cls(0.08, (250, 390), (4, 4, 6), (3, 5, 3, 1), (4, 6, 4, 2))

    @property
    def user_mesh(self) -> Mesh:
        """The plate of hex20, its front at z = 0, the hole round; sets LEFT, RIGHT, BODY, faces FRONT, REST."""
        return _plate(*self.user)

    @property
    def true_mesh(self) -> Mesh:
        """The same plate, finer."""
        return _plate(*self.true)

    def speckle(self, rng: np.random.Generator) -> SolidSpeckle:
        """The speckle on the plate: dots of `SPECKLE_PX` in the middle of the images."""
        return SolidSpeckle.drawn(rng, SPECKLE_PX * self.pixel, 0.08 * GREY_LEVELS, 0.92 * GREY_LEVELS)


@dataclass(frozen=True, eq=False)
class PlateTest:
    """The test before noise: true scene and motion (n_frames, n_nodes, 3) mm, force (n_frames,) N, rig, user's mesh."""

    scene: Scene
    displacements: np.ndarray
    grip: np.ndarray
    force: np.ndarray
    rig: Rig
    mesh: Mesh
    size: PlateSize

    TRUTH: ClassVar[dict[str, float]] = {"BODY.E": 70000.0, "BODY.nu": 0.3, "BODY.yield_stress": 200.0,
                                         "BODY.hardening_modulus": 1500.0}
    FORCE_NOISE_N: ClassVar[float] = 10.0
    GRIP_NOISE_MM: ClassVar[float] = 0.0002
    INCREMENTS: ClassVar[int] = 4  # of the true simulation per frame

    @classmethod
    def simulated(cls, size: PlateSize, increments: int = INCREMENTS) -> PlateTest:
        """Simulate the truth, on a finer mesh than the user's; increments : per frame."""
        true, grip = size.true_mesh, _grip_motion(*size.frames)
        u, force = _solve(true, grip, increments)
        front, bare = true.edge_sets["FRONT"], true.edge_sets["REST"]
        return cls(Scene(true.nodes, true.face_cells(front), true.face_cells(bare)), u, grip, force,
                   Rig.around(size.shape, size.pixel, size.distance, size.angles), size.user_mesh, size)

    def write(self, folder: Path, noise: float | None = None, seed: int = 0,
              believed: Rig | None = None, deviations: dict[str, float] | None = None) -> Path:
        """Write the folder of a plate before cameras; believed : what the calibration file says, default the truth."""
        speckle_rng, camera_rng, channel_rng = np.random.default_rng(seed).spawn(3)
        texture = self.size.speckle(speckle_rng)
        bare = Sensor(self.size.shape, background=0.1 * GREY_LEVELS)
        still = self.scene.image(0.0 * self.displacements[0], self.rig.cameras[0], texture.value,
                                 replace(bare, background=np.nan))
        std = (DEFAULT_NOISE_SHARE if noise is None else noise) * float(np.nanstd(still))
        sensor = replace(bare, noise_std=std)
        for number, camera in enumerate(self.rig.cameras):
            place = "images" if number == 0 else "right"
            (folder / place).mkdir(exist_ok=True)
            write_images(folder, (record(self.scene.image(u, camera, texture.value, sensor), sensor, camera_rng)
                                  for u in self.displacements), place)
        stated_rig = self.rig if believed is None else believed
        stated_rig.write_calibration(folder / CALIBRATION, deviations)
        columns = {"force_N": (self.force, self.FORCE_NOISE_N), "grip_displacement_mm": (self.grip, self.GRIP_NOISE_MM)}
        write_loads(folder, np.arange(len(self.grip), dtype=float),
                    {name: noisy_channel(values, noise_std if std else 0.0, channel_rng)
                     for name, (values, noise_std) in columns.items()})
        write_inp(self.mesh, folder / "mesh.inp", "Open-hole plate, stereo")
        text = Template(TOML).substitute(noise_std_gv=f"{sensor.total_noise_std:.4g}",
                                         alignment=pose_lines(stated_rig.cameras[0]))
        (folder / "experiment.toml").write_text(text, encoding="utf-8")
        write_truth(folder, self.TRUTH, sensor.total_noise_std, added_noise_std_gv=std, seed=seed)
        return folder / "experiment.toml"


def _plate(around: int, radial: int, along: int, layers: int) -> Mesh:
    """The plate of hex20, its front at z = 0, the hole round; sets LEFT, RIGHT, BODY, faces FRONT, REST."""
    flat = strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", around, radial, along)
    mesh = layered(flat, np.linspace(-THICKNESS, 0.0, layers + 1))
    faces = mesh.boundary_faces()
    on_front = np.array([np.abs(mesh.nodes[mesh.face_nodes(face), 2]).max() < 1e-9 for face in faces])
    return replace(mesh, edge_sets={"FRONT": faces[on_front], "REST": faces[~on_front]})


def write_stereo(out: Path | str, reduced: bool = False, noise: float | None = None, seed: int = 0,
                 foreign: bool = False) -> Path:
    """Write the folder of the example; the truth is always foreign. Arguments as in `write_example`."""
    folder = empty_folder(out)
    return PlateTest.simulated(PlateSize.of_example(reduced)).write(folder, noise, seed)


def pose_lines(camera: PinholeCamera) -> str:
    """The pose of the mesh before a camera, as lines of its table."""
    rows = ", ".join("[" + ", ".join(f"{value:.12g}" for value in row) + "]" for row in camera.rotation)
    return (f"rotation = [{rows}]   # from the mesh frame to the camera's\n"
            f"translation_mm = [{', '.join(f'{value:.12g}' for value in camera.translation_mm)}]")


def _grip_motion(elastic: int, yielding: int, plastic: int) -> np.ndarray:
    """Grip displacement per frame, mm  # (n_frames,)"""
    return np.concatenate([np.linspace(0.0, 0.04, elastic)[:-1], np.linspace(0.04, 0.10, yielding + 1)[:-1],
                           np.linspace(0.10, 0.32, plastic + 1)])


def _solve(mesh: Mesh, grip: np.ndarray, increments: int) -> tuple[np.ndarray, np.ndarray]:
    """True displacements (n_frames, n_nodes, 3) mm and force (n_frames,) N."""
    times = np.linspace(0.0, len(grip) - 1.0, increments * (len(grip) - 1) + 1)
    fine = np.interp(times, np.arange(len(grip)), grip)
    left_end, right_end = mesh.node_sets["LEFT"], mesh.node_sets["RIGHT"]
    dofs = np.concatenate([3 * right_end, *(3 * right_end + k for k in (1, 2)), *(3 * left_end + k for k in (0, 1, 2))])
    basis = np.zeros((len(dofs), 1))
    basis[:len(right_end)] = 1.0
    law = compile_law("j2_linear", "finite")
    model = Body(mesh=mesh, kind="solid", sections=(Section("BODY", law, mesh.element_sets["BODY"]),),
                  constraints=Constraints(dofs, basis, fine[:, None]), channels=(Reaction(3 * right_end),))
    values = np.array([PlateTest.TRUTH[f"BODY.{name}"] for name in law.spec.parameter_names])
    frames = range(0, len(fine), increments)
    states = [(state.u.copy(), state.channels[0]) for k, state in enumerate(march(model, {"BODY": values}, times))
              if k in frames]
    return np.array([u for u, _ in states]), np.array([force for _, force in states])
