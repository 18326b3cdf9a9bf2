"""hex20 of idic and C3D20R of CalculiX are one element: a skewed block of them, stretched between clamps, moves
alike."""

from __future__ import annotations

import subprocess
from dataclasses import replace

import numpy as np
import pytest
from fe.fe_bodies import body, dofs_of, grid, held, last, where

from idic.fe import Reaction, inp_text
from idic.fe import read_calculix_dat

DECK = """*MATERIAL, NAME=M
*ELASTIC
70000, 0.3
*SOLID SECTION, ELSET=BODY, MATERIAL=M
*BOUNDARY
LEFT, 1, 3
RIGHT, 2, 3
*STEP
*STATIC
*BOUNDARY
RIGHT, 1, 1, 0.01
*NODE PRINT, NSET=ALL
U
*NODE PRINT, NSET=RIGHT, TOTALS=ONLY
RF
*END STEP
"""


def wavy(x):
    return np.column_stack([4.0 * x[:, 0], x[:, 1] * (1.0 + 0.3 * np.sin(2.0 * x[:, 0])), x[:, 2]])


def test_a_block_of_quadratic_bricks_moves_as_in_calculix(ccx, tmp_path):
    mesh = grid("hex20", (3, 2, 1), mapping=wavy)
    left, right = (where(mesh, lambda x, *_, at=at: np.abs(x - at) < 1e-9) for at in (0.0, 4.0))
    parts = [(left, axis, 0.0) for axis in "xyz"] + [(right, "x", [0.0, 0.01]), (right, "y", 0.0), (right, "z", 0.0)]
    ours = last(body(mesh, "solid", "elastic", "small", held(mesh, parts),
                     channels=(Reaction(dofs_of(right, "x", 3)),)),
                [70000.0, 0.3])
    named = replace(mesh, node_sets={"LEFT": left, "RIGHT": right}, element_sets={"BODY": np.arange(mesh.n_elements)})
    (tmp_path / "block.inp").write_text(inp_text(named, "block") + DECK)
    subprocess.run([ccx, "-i", "block"], cwd=tmp_path, check=True, stdout=subprocess.DEVNULL)
    records = read_calculix_dat(tmp_path, "block")
    (labels, theirs), = records.motions.values()
    assert np.abs(theirs[np.argsort(labels)] - ours.u).max() < 1e-6 * 0.01  # seven digits in the file
    (forces,) = records.forces.values()
    assert forces["RIGHT.x"] == pytest.approx(ours.channels[0], rel=1e-5)
