"""Clean recordings by a foreign code: sheets as CalculiX bricks of their real thickness, in finite strains."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from idic_studies.trial.scenes.calculix import solve_with_calculix
from idic_studies.trial.scenes.recording import Paint, write_public
from idic_studies.trial.scenes.solve import campaign_mesh
from idic_studies.trial.scenes.worlds import as_solid, world_scene

SEEDS_OF_PAINT = (101, 201)  # texture, noise


def write_sheet(folder: Path, specimen: str, columns: int, noise: str) -> None:
    """Elastic, in half the usual motion; grey values with half the usual noise: a score resolves a thousandth of a
    pixel."""
    world = {"specimen": specimen, "columns": columns, "frames": 8, "programme": "unloading", "thickness": 1.0,
             "solid": True, "finite": False, "noise": noise}
    scene = as_solid(world, world_scene(world, "elastic", 1.0, {"E": 1940.0, "nu": 0.35}))
    scene = replace(scene, grip=0.5 * scene.grip)
    write_public(folder, scene, solve_with_calculix(scene, campaign_mesh(scene)), Paint(*SEEDS_OF_PAINT, noise_gv=1.0))
