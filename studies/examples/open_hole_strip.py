"""The small open-hole strips of the studies: the metal one of `idic example demo`, and the same one of a polymer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from string import Template

import numpy as np

from idic.fe import Constraints, Body, Reaction, Section, march
from idic.images import ArrayStack
from idic.laws import compile as compile_law
from idic.virtual_tests import (
    DemoSize, LoggedColumn, Sensor, VirtualTest, clean_image, strip, write_inp, write_loads, write_truth,
)

POLYMER = {"sheet.E": 2000.0, "sheet.nu": 0.35}
POLYMER_TABLE = {"law": "elastic", "kinematics": "finite", "E": {"value": 2000.0, "unit": "MPa", "identify": True},
              "nu": {"value": 0.35, "identify": True, "bounds": [0.0, 0.49]}}  # [material.sheet]
HIDDEN_GRIP_MM = 1.0  # 5 px
NOISE_GV, BITS, TEXTURE_SEED = 2.0, 8, 20260


def metal(size: DemoSize) -> VirtualTest:
    """The strip of metal, pulled into plasticity: E, nu, yield stress, hardening modulus."""
    return strip(size)


def polymer(size: DemoSize, grip_mm: float = HIDDEN_GRIP_MM) -> VirtualTest:
    """The strip of a polymer, elastic at finite strain, pulled in equal steps by `grip_mm`: E, nu (`POLYMER_TABLE`)."""
    bare = strip(size)
    times = bare.times
    grip = grip_mm * times / times[-1]
    mesh = DemoSize.mesh("quad8", size.true)
    left_end, right_end = mesh.node_sets["LEFT"], mesh.node_sets["RIGHT"]
    dofs = np.concatenate([2 * right_end, 2 * right_end + 1, 2 * left_end, 2 * left_end + 1])
    basis = np.zeros((len(dofs), 1))
    basis[:len(right_end)] = 1.0
    law = compile_law("elastic", "finite")
    model = Body(mesh=mesh, kind="plane_stress", sections=(Section("sheet", law, mesh.element_sets["sheet"]),),
                  thickness=DemoSize.THICKNESS, constraints=Constraints(dofs, basis, grip[:, None]),
                  channels=(Reaction(2 * right_end),))
    values = np.array([POLYMER[f"sheet.{name}"] for name in law.spec.parameter_names])
    states = [(state.u.copy(), state.channels[0]) for state in march(model, {"sheet": values}, times)]
    force, logged = (column.noise_std for column in bare.columns)
    return replace(bare, displacements=np.array([u for u, _ in states]), truth=POLYMER, columns=(
        LoggedColumn("force_N", np.array([f for _, f in states]), force),
        LoggedColumn("grip_displacement_mm", grip, logged)))


def write_clean(folder: Path, test: VirtualTest) -> ArrayStack:
    """Write the folder of a virtual test, its log without noise, no images; returns the noise-free images, float32."""
    levels = 2.0**BITS
    texture = test.texture(np.random.default_rng(TEXTURE_SEED), levels)
    sensor = Sensor(test.shape, bits=BITS, background=test.background * levels, supersampling=test.supersampling)
    write_inp(test.mesh, folder / "mesh.inp", test.title)
    write_loads(folder, test.times, {c.column: c.values for c in test.columns})
    (folder / "experiment.toml").write_text(Template(test.toml).substitute(noise_std_gv="0.0001"), encoding="utf-8")
    write_truth(folder, test.truth, NOISE_GV)
    return ArrayStack(np.array([clean_image(u, test.nodes, test.cells, test.camera, texture, sensor)
                                for u in test.displacements], dtype=np.float32))
