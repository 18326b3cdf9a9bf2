"""The example `demo`: an open-hole strip of an aluminium-like metal in tension, pulled well into plasticity."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from string import Template
from typing import Any, ClassVar

import numpy as np

from idic.fe import Constraints, Mesh, Body, Reaction, Section, march
from idic.images import Camera
from idic.laws import compile as compile_law
from idic.virtual_tests.meshes import strip_with_hole
from idic.virtual_tests.virtual_test import LoggedColumn, VirtualTest, medium_speckle

FORCE_NOISE_N = 5.0  # N: 1/1000 of the largest force
GRIP_NOISE_MM = 0.0002  # mm: an LVDT

TOML = """\
# An open-hole strip in tension, as `idic example demo` writes it. The truth is in truth.json; the images come from a
# finer simulation on another mesh. Try:  idic check experiment.toml,  then  idic identify experiment.toml --out run

[experiment]
title = "Open-hole strip, tension"
images = "images/*.tif"            # sorted naturally; the first is the reference
loads = "loads.csv"                # one row per image
mesh = "mesh.inp"
mesh_unit = "mm"
kind = "plane_stress"
thickness_mm = 2.0

[camera]                           # where a point of the mesh is in the image (column, row)
pixel_size_mm = $pixel_size
origin_px = [$column, $row]        # the centre of the hole
axes = ["+col", "-row"]            # mesh x to the right, mesh y up
noise_std_gv = $noise_std_gv               # standard deviation of one image

[material.sheet]                   # the element set `sheet` of mesh.inp; `idic laws` lists the laws
law = "j2_linear"
E = { value = 55e3, unit = "MPa", identify = true, bounds = [1e3, 4e5] }
nu = { value = 0.38, identify = true, bounds = [0.0, 0.49] }
yield_stress = { value = 260, unit = "MPa", identify = true, bounds = [20, 2000] }
hardening_modulus = { value = 800, unit = "MPa", identify = true }

[[boundary]]                       # the fixed grip
nodes = "LEFT"
ux = 0.0
uy = 0.0

[[boundary]]                       # the moving grip: logged to 0.2 um, refined by the images
nodes = "RIGHT"
ux = { column = "grip_displacement_mm", noise_std = 0.0002 }
uy = 0.0

[[channel]]
column = "force_N"
simulated = { reaction = "RIGHT", component = "x" }
noise_std = 5.0

[options]
substeps = 1                       # increments per frame; without this line an error estimate chooses them
"""


@dataclass(frozen=True)
class DemoSize:
    """Pixel size (mm), image (rows, columns), frames per stage (elastic, yielding, plastic), mesh densities."""

    pixel: float
    shape: tuple[int, int]
    frames: tuple[int, int, int]
    user: tuple[int, int, int]  # around, radial, beside
    true: tuple[int, int, int]
    substeps: int

    LENGTH: ClassVar[float] = 28.0  # mm, of every strip
    WIDTH: ClassVar[float] = 16.0
    RADIUS: ClassVar[float] = 3.0
    THICKNESS: ClassVar[float] = 2.0
    TRUTH: ClassVar[dict[str, float]] = {"sheet.E": 70000.0, "sheet.nu": 0.3, "sheet.yield_stress": 200.0,
                                         "sheet.hardening_modulus": 1500.0}

    @classmethod
    def of_example(cls, reduced: bool = False) -> DemoSize:
        """That of `idic example demo`."""
        if reduced:
            return cls(0.16, (125, 190), (4, 4, 4), (3, 4, 2), (5, 7, 4), 1)
        return cls(0.1, (200, 300), (6, 6, 8), (4, 6, 3), (7, 9, 5), 2)

    @classmethod
    def mesh(cls, cell: str, densities: Sequence[int]) -> Mesh:
        """The strip; densities : as `user` and `true`."""
        return strip_with_hole(cls.LENGTH, cls.WIDTH, cls.RADIUS, cell, *densities)


@dataclass(frozen=True)
class Course:
    """What a simulation says of each frame, computed when it is first read: images of its first frames are rendered
    beside the next ones. `numpy.asarray` has it whole."""

    n_frames: int
    at: Callable[[int], Any]

    def __len__(self) -> int:
        return self.n_frames

    def __getitem__(self, k: int) -> Any:
        return self.at(range(self.n_frames)[k])

    def __array__(self, dtype=None, copy=None) -> np.ndarray:
        return np.array([self.at(k) for k in range(self.n_frames)], dtype=dtype)


def demo(reduced: bool = False) -> VirtualTest:
    """The open-hole strip: 20 frames of 300 x 200 px, 4 parameters and a force (reduced: 12 frames of 190 x 125)."""
    return strip(DemoSize.of_example(reduced))


def strip(size: DemoSize) -> VirtualTest:
    """The same test at any size."""
    grip = _grip_motion(*size.frames)
    times = np.arange(len(grip), dtype=float)
    mesh = DemoSize.mesh("quad8", size.true)
    u, force = _solve(mesh, grip, times, size.substeps)
    origin = ((size.shape[1] - 1) / 2 - 1.7, (size.shape[0] - 1) / 2 + 0.3)
    camera = Camera.from_table(pixel_size=size.pixel, origin=origin)
    toml = Template(TOML).safe_substitute(pixel_size=size.pixel, column=origin[0], row=origin[1])
    return VirtualTest(
        title="Open-hole strip, tension",
        nodes=mesh.nodes,
        cells=mesh.blocks,
        displacements=u,
        times=times,
        columns=(LoggedColumn("force_N", force, FORCE_NOISE_N),
                 LoggedColumn("grip_displacement_mm", grip, GRIP_NOISE_MM)),
        camera=camera,
        shape=size.shape,
        texture=medium_speckle(camera, size.shape),
        background=0.1,
        mesh=DemoSize.mesh("quad8", size.user),
        toml=toml,
        truth=DemoSize.TRUTH,
    )


def _grip_motion(elastic: int, yielding: int, plastic: int) -> np.ndarray:
    """Grip displacement per frame (mm): to the onset of yielding, through it, and on  # (n_frames,)"""
    return np.concatenate(
        [
            np.linspace(0.0, 0.04, elastic)[:-1],
            np.linspace(0.04, 0.10, yielding + 1)[:-1],
            np.linspace(0.10, 0.32, plastic + 1),
        ]
    )


def _solve(mesh: Mesh, grip: np.ndarray, times: np.ndarray, substeps: int) -> tuple[Course, Course]:
    """True displacements (n_frames, n_nodes, 2) mm and force (n_frames,) N, computed as they are read."""
    left_end, right_end = mesh.node_sets["LEFT"], mesh.node_sets["RIGHT"]
    dofs = np.concatenate([2 * right_end, 2 * right_end + 1, 2 * left_end, 2 * left_end + 1])
    basis = np.zeros((len(dofs), 1))
    basis[: len(right_end)] = 1.0
    law = compile_law("j2_linear", "finite")
    model = Body(
        mesh=mesh,
        kind="plane_stress",
        sections=(Section("sheet", law, mesh.element_sets["sheet"]),),
        thickness=DemoSize.THICKNESS,
        constraints=Constraints(dofs, basis, grip[:, None]),
        channels=(Reaction(2 * right_end),),
    )
    values = np.array([DemoSize.TRUTH[f"sheet.{name}"] for name in law.spec.parameter_names])
    states, solved = march(model, {"sheet": values}, times, substeps=substeps), []

    def state(k: int) -> tuple[np.ndarray, float]:
        while len(solved) <= k:
            frame = next(states)
            solved.append((frame.u.copy(), frame.channels[0]))
        return solved[k]

    return Course(len(times), lambda k: state(k)[0]), Course(len(times), lambda k: state(k)[1])
