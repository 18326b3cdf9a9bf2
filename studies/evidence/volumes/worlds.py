"""Diagnoses of drawn tests in a scanner whose truth is known.

python studies/evidence/volumes/worlds.py OUT [SEED ...]

Seed k is a world of kind k modulo the number of kinds. All are the bar of tests/volumes/tomograms.py (56 voxels cubed,
six scans, blobs carried by another mesh), identified with a linear elastic law. Prints verdict, side, names and whether
they are right: of a clean test no name; else the effect among the names or those that it cannot be told from, and no
formal fit.

Seeds 7742 to 7788 and every seventh up to 7875, drawn after the rules were frozen (commit b874bc05): 40 of 40 effects
right, no alarm in 20 clean tests, 13 to 53 CPU s each. The side is right in 36: in four of six tests with a curved load
cell a material (nonlinear elasticity, viscoelasticity) leads the set that the load cell is in.
"""

from __future__ import annotations

import csv
import shutil
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[3] / "tests"))

from volumes.tomograms import FINE, Tomograms

from idic.run import diagnose_run, identify_run

TRUE_MESH, N_SCANS = (12, 20), 6


@dataclass(frozen=True)
class World:
    """kind : in words; test : that is rendered; names : candidates of which any is right, none of a clean test;
    spoil : changes the folder after rendering"""

    kind: str
    test: Tomograms
    names: tuple[str, ...] = ()
    spoil: Callable[[Path], None] = field(default=lambda folder: None)


def base(seed: int, **changes) -> Tomograms:
    return Tomograms(side=56, n_scans=N_SCANS, strain=0.04, mesh=FINE, true_mesh=TRUE_MESH, seed=seed, **changes)


def clean(seed: int, rng: np.random.Generator) -> World:
    return World("clean", base(seed))


def inclusion(seed: int, rng: np.random.Generator) -> World:
    size = base(seed).size_mm
    centre, radius = size * rng.uniform(0.25, 0.75, 3), rng.uniform(0.15, 0.22)
    stiffness = rng.choice([rng.uniform(0.3, 0.6), rng.uniform(2.0, 3.5)])
    hidden = (f'\n[[heterogeneity]]\nset = "BODY"\nform = "inclusion"\ncentre_mm = {centre.round(3).tolist()}\n'
              f"radius_mm = {radius:.3f}\nstiffness = {stiffness:.3f}\n")
    return World(f"inclusion at {centre.round(2).tolist()}, radius {radius:.2f}, {stiffness:.2f} x",
                 base(seed, hidden=hidden), ("heterogeneity",))


def gradient(seed: int, rng: np.random.Generator) -> World:
    axis, slope = rng.choice(list("xyz")), rng.choice([-1.0, 1.0]) * rng.uniform(0.4, 0.7)
    hidden = f'\n[[heterogeneity]]\nset = "BODY"\nform = "gradient"\nalong_{axis} = {slope:.3f}\n'
    return World(f"gradient along {axis}, {slope:+.2f}", base(seed, hidden=hidden), ("heterogeneity",))


def plasticity(seed: int, rng: np.random.Generator) -> World:
    stress = rng.uniform(700.0, 1400.0)
    law = f'law = "j2_linear"\nyield_stress = {stress}\nhardening_modulus = {rng.uniform(1000.0, 6000.0)}'
    return World(f"plasticity from {stress:.0f} MPa", base(seed, law=law),
                 ("plasticity", "free_hardening", "hardening_curvature"))


def scanner_motion(seed: int, rng: np.random.Generator) -> World:
    drift = np.vstack([np.zeros((2, 3)), 0.25 * rng.normal(size=(N_SCANS - 2, 3))])
    return World("scanner motion, 0.25 voxels", base(seed, drift=drift), ("scanner_motion",))


def magnification(seed: int, rng: np.random.Generator) -> World:
    growth = np.concatenate([np.zeros(2), rng.choice([-1.0, 1.0]) * np.sort(rng.uniform(1e-3, 5e-3, N_SCANS - 2))])
    return World(f"scanner magnification to {growth[-1]:+.4f}", base(seed, growth=growth), ("scanner_magnification",))


def load_cell(seed: int, rng: np.random.Generator) -> World:
    curvature = rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 0.1)

    def spoil(folder: Path) -> None:
        with open(folder / "loads.csv", newline="") as file:
            header, *rows = csv.reader(file)
        column, forces = header.index("force_N"), [float(row[header.index("force_N")]) for row in rows]
        for row, force in zip(rows, forces, strict=True):
            row[column] = f"{force * (1.0 + curvature * force / max(forces)):.9g}"
        with open(folder / "loads.csv", "w", newline="") as file:
            csv.writer(file).writerows([header, *rows])

    return World(f"curved load cell, {curvature:+.2f}", base(seed), ("load_cell_curvature",), spoil)


KINDS = (clean, inclusion, gradient, plasticity, scanner_motion, magnification, load_cell)


def main() -> None:
    out = Path(sys.argv[1])
    for seed in map(int, sys.argv[2:] or map(str, range(2 * len(KINDS)))):
        rng, folder, start_s = np.random.default_rng(seed), out / f"world_{seed}", time.process_time()
        shutil.rmtree(folder, ignore_errors=True)
        world = KINDS[seed % len(KINDS)](seed, rng)
        experiment = replace(world.test).write(folder / "experiment")
        world.spoil(experiment)
        identify_run(experiment, folder / "run")
        verdict = diagnose_run(folder / "run")
        names = {*verdict["named"], *(name for group in verdict["indistinguishable"] for name in group)}
        is_formal = verdict["verdict"] == "outside_library"
        is_right = verdict["verdict"] == "none" if not world.names else not is_formal and bool(names & {*world.names})
        print(f"{seed:3d} {'right' if is_right else 'WRONG'}  {world.kind}: {verdict['verdict']}, "
              f"{verdict['mismatch'].get('side')}, {', '.join(verdict['named']) or 'no name'}"
              f"{' or ' + ', '.join(sorted(names - {*verdict['named']})) if names - {*verdict['named']} else ''}; "
              f"{time.process_time() - start_s:.0f} CPU s", flush=True)


if __name__ == "__main__":
    main()
