"""Worlds: specimen, size of the images, frames, programme, thickness, noise and mechanics of a test, drawn.

A world is plain values, so that it can be sealed with the truth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from idic_studies.trial.scenes.photographs import Photograph, drawn_photograph
from idic_studies.trial.scenes.recording import NOISES
from idic_studies.trial.scenes.scene import (IMAGE_SHAPE_PX, NULLS, PIXEL_MM, REVERSED, TIMES, UP, Geometry, Scene,
                                                View, plain_scene)
from idic_studies.trial.scenes.specimens import SPECIMENS

COLUMNS_PX = ((130, 220, 0.6), (220, 400, 0.3), (400, 700, 0.1))  # from, to, share of the worlds
PHOTOGRAPHED_COLUMNS_PX = (130, 300)
FRAMES = (16, 40)
DURATION_S = 23.0
THICKNESS_MM = (1.0, 3.0)
SOLID_SHARE, FINITE_SHARE = 0.4, 0.5  # of the worlds whose law CalculiX knows; of the users of a solid one
SOLID_LAWS = ("elastic", "orthotropic", "j2_linear", "j2_voce", "j2_kinematic")
PROGRAMMES = {  # course of the grip over the share of the time
    "monotonic": (np.array([0.0, 1.0]), np.array([0.0, 1.0])),
    "hold": (np.array([0.0, 0.35, 1.0]), np.array([0.0, 1.0, 1.0])),
    "unloading": (TIMES / TIMES[-1], UP),
    "reversed": (TIMES / TIMES[-1], REVERSED),
}
ALLOWED = {"damage": ("unloading",), "kinematic_hardening": ("reversed",), "creep": ("hold", "unloading"),
           "viscoelasticity": ("hold", "unloading"), "hardening_curvature": ("reversed",),
           "friction": ("unloading",), "nonlinear_elasticity": ("unloading",), "frame_time_offset": ("unloading",),
           "machine_compliance": ("hold", "unloading"), "grip_slip": ("hold", "unloading")}  # others cannot tell it
NEEDS_HOLE = ("slit",)
MARGIN_MM = 0.4  # that the strip's view leaves the motion of an end


def drawn_world(rng: np.random.Generator, kinds: Sequence[str], null: str) -> dict[str, Any]:
    """A world in which effects of these kinds can be separated from others."""
    low, high, _ = COLUMNS_PX[rng.choice(len(COLUMNS_PX), p=[share for *_, share in COLUMNS_PX])]
    programmes = set(PROGRAMMES) - ({"reversed"} if null != "plastic" else {"hold"})
    for kind in kinds:
        programmes &= set(ALLOWED.get(kind, PROGRAMMES))
    specimen = "hole" if any(kind in NEEDS_HOLE for kind in kinds) else str(rng.choice(sorted(SPECIMENS)))
    solid = bool(rng.uniform() < SOLID_SHARE)
    return {"specimen": specimen, "columns": int(rng.integers(low, high)),
            "frames": int(rng.integers(*FRAMES, endpoint=True)),
            "programme": str(rng.choice(sorted(programmes or {"unloading"}))),
            "thickness": float(np.round(rng.uniform(*THICKNESS_MM), 2)), "solid": solid,
            "finite": bool(solid and rng.uniform() < FINITE_SHARE), "noise": str(rng.choice(sorted(NOISES)))}


def photographed_world(rng: np.random.Generator, folder: str) -> dict[str, Any]:
    """What a photographed surface changes of a world: bricks, images no larger than the photographs, real noise."""
    columns = int(rng.integers(*PHOTOGRAPHED_COLUMNS_PX))
    return {"photograph": drawn_photograph(rng, folder, columns).content, "solid": True, "noise": "white",
            "columns": columns}


def photograph_of(world: Mapping[str, Any]) -> Photograph | None:
    """The photographed surface of a world, None: painted dots."""
    return Photograph(**world["photograph"]) if world.get("photograph") else None


def world_geometry(world: Mapping[str, Any], radius: float) -> Geometry:
    """Its specimen; radius : of its hole or notch, over the usual one."""
    specimen = SPECIMENS[world["specimen"]]
    return Geometry(specimen.length, specimen.width, radius, world["specimen"], specimen.concentration)


def world_scene(world: Mapping[str, Any], null: str, radius: float, values: Mapping[str, float]) -> Scene:
    """The test without effects."""
    specimen, geometry = SPECIMENS[world["specimen"]], world_geometry(world, radius)
    scene = plain_scene(null, geometry, values)
    times = np.linspace(0.0, DURATION_S, world["frames"])
    grip = specimen.grip * NULLS[null].grip * np.interp(times / DURATION_S, *PROGRAMMES[world["programme"]])
    moved = float(np.abs(grip).max())
    return replace(scene, times=times, grip=grip, view=view_of(geometry, world["columns"], moved), along=specimen.along,
                   thickness=world["thickness"], noise=world["noise"], finite=world["finite"] and null == "elastic")


def view_of(geometry: Geometry, columns: int, moved: float = 0.0) -> View:
    """The whole specimen with a margin, as the strip has it, and all of it at the end of a motion of `moved` (mm)."""
    room = 2.0 * max(moved - MARGIN_MM, 0.0)
    reach = PIXEL_MM * IMAGE_SHAPE_PX[1] / 10.0 * geometry.length + room
    pixel = reach / columns
    return View((int(np.ceil((geometry.width + 1.05 + room) / pixel)), columns), pixel)


def as_solid(world: Mapping[str, Any], scene: Scene) -> Scene:
    """The scene in bricks where its world has them and CalculiX knows its law."""
    return replace(scene, solid=bool(world["solid"]) and scene.law in SOLID_LAWS and scene.null != "rubber"
                   and not scene.slit)
