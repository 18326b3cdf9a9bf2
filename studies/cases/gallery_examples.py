"""The six experiments of the gallery: small virtual tests and the options of their identification."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from idic_studies.cases.bulge import SKETCH_SIZE
from idic_studies.cases.polycarbonate import KNOWN, SKETCH, SPLINE_FLOOR
from idic_studies.examples.bulge import write_bulge
from idic_studies.examples.bulge_model import TRUTH as BULGE
from idic.virtual_tests import (
    empty_folder, simulate, strip_with_hole, write_example, write_images, write_inp, write_virtual_model,
)
from idic_studies.examples.polycarbonate import necking_strip
from idic_studies.examples.polycarbonate_model import TRUTH as POLYCARBONATE

PLAN, SEED = "plan", 7
PLATE = (28.0, 16.0, 3.0)  # mm: length, width, radius of the hole
DIVISIONS = (3, 4, 2)
BULGE_NOISE = 0.01  # of the roughness
STRIP_NOISE_GV = 0.3

PLAN_TOML = Template("""\
[experiment]
title = "$title"
mesh = "mesh.inp"
mesh_unit = "mm"
kind = "plane_stress"
thickness_mm = 2.0

[camera]
pixel_size_mm = 0.16
origin_px = [94.5, 62.0]

$model
[[boundary]]
nodes = "LEFT"
ux = 0.0
uy = 0.0
[[boundary]]
nodes = "RIGHT"
ux = { column = "grip_displacement_mm" }
uy = 0.0
$channel
[design]
image_px = [190, 125]
n_frames = $frames
duration_s = $seconds
noise_std_gv = 2.0
[design.program]
grip_displacement_mm = [[0, 0], [$seconds, $grip]]
""")
FORCE = """
[[channel]]
column = "force_N"
simulated = { reaction = "RIGHT", component = "x" }
noise_std = 1.0
"""
PLY = """\
[material.sheet]
law = "orthotropic"
E1 = { value = 45e3, unit = "MPa", identify = true }
E2 = { value = 12e3, unit = "MPa", identify = true }
nu12 = { value = 0.28, identify = true }
G12 = { value = 4.5e3, unit = "MPa", identify = true }
angle = 30.0
"""
POLYMER = """\
[material.sheet]
law = "viscoplastic"
E = 2000.0
nu = 0.35
yield_stress = { value = 20, unit = "MPa", identify = true }
hardening_modulus = 50.0
eta = { value = 40, unit = "MPa*s", identify = true }
m = { value = 4.0, identify = true }
"""
MEASURED = [{"nodes": name, "ux": "measured", "uy": "measured"} for name in ("LEFT", "RIGHT")]
ELASTIC = {"law": "elastic", "E": {"value": 60e3, "unit": "MPa", "identify": True},
           "nu": {"value": 0.33, "identify": True, "bounds": [0.0, 0.49]}}
LOCKED = {key: value for name in KNOWN
          for key, value in ((name, POLYCARBONATE[name]), (f"material.{name}.identify", False))}


@dataclass(frozen=True)
class GalleryExample:
    """One report of the gallery.

    write : writes the experiment folders below an empty folder and returns them; several folders share their materials
    overrides : of the identification, as ``--set`` takes them
    diagnose : `idic diagnose` follows
    """

    name: str
    title: str
    sentence: str
    write: Callable[[Path], list[Path]]
    overrides: Mapping[str, Any] = field(default_factory=dict)
    diagnose: bool = False


def gallery_examples() -> tuple[GalleryExample, ...]:
    """The gallery, in the order of its page."""
    return (
        GalleryExample("plate", "A metal that yields",
                "An open-hole strip pulled into plasticity: four parameters of a J2 law, images and force.", _plate),
        GalleryExample("bulge", "Heights instead of grey values",
                "A metal strip on rubber, inflated under a profilometer: five parameters of two materials, no force.",
                _bulge, _scaled(BULGE, 1.3)),
        GalleryExample("polycarbonate", "A polymer that necks",
                "Eight parameters of a glassy polymer from one tension test, on a mesh so coarse that its error is "
                "nearly all of the standard deviations.",
                _polycarbonate, _scaled(POLYCARBONATE, 1.1) | LOCKED),
        GalleryExample("composite", "No force, no grips",
                "A ply at 30 degrees with measured edges: images alone determine ratios of moduli.",
                _composite, {"boundary": MEASURED, "sheet.E1": 40e3, "sheet.E2": 15e3, "sheet.nu12": 0.35,
                             "sheet.G12": 6e3}),
        GalleryExample("two-speeds", "Two tests, one material",
                "A viscoplastic polymer pulled in 7000 s and in 7 s: together they separate strength and viscosity.",
                _two_speeds, {"sheet.yield_stress": 18.0, "sheet.eta": 60.0, "sheet.m": 3.0}),
        GalleryExample("wrong-model", "A wrong law",
                "The strip that yields, with an elastic law: the report shows the misfit, the diagnosis names its "
                "cause.",
                _plate, {"material.sheet": ELASTIC}, diagnose=True),
    )


def _scaled(truth: Mapping[str, float], factor: float) -> dict[str, float]:
    """Start values at `factor` times the truth."""
    return {name: float(f"{factor * value:.6g}") for name, value in truth.items()}


def _plate(folder: Path) -> list[Path]:
    write_example("demo", folder / "experiment", reduced=True, seed=SEED)
    return [folder / "experiment"]


def _bulge(folder: Path) -> list[Path]:
    write_bulge(folder / "experiment", noise=BULGE_NOISE, seed=SEED, size=SKETCH_SIZE)
    return [folder / "experiment"]


def _polycarbonate(folder: Path) -> list[Path]:
    place = empty_folder(folder / "experiment")
    total = float(np.sqrt(STRIP_NOISE_GV**2 + 1.0 / 12.0 + SPLINE_FLOOR**2))
    clean = write_virtual_model(place, necking_strip(SKETCH), SEED, total)
    rng = np.random.default_rng(SEED)
    write_images(place, (np.clip(np.rint(clean.frame(k) + STRIP_NOISE_GV * rng.standard_normal(clean.shape)), 0, 255)
                         .astype(np.uint8) for k in range(clean.n_frames)))
    return [place]


def _composite(folder: Path) -> list[Path]:
    return [_simulated(folder, "experiment", "Open-hole ply at 30 degrees, tension", PLY, "", 6, 5.0, 0.5, SEED)]


def _two_speeds(folder: Path) -> list[Path]:
    return [_simulated(folder, name, f"Viscoplastic strip, {seconds:g} s", POLYMER, FORCE, 8, seconds, 0.8, SEED + k)
            for k, (name, seconds) in enumerate((("slow", 7000.0), ("fast", 7.0)))]


def _simulated(folder: Path, name: str, title: str, model: str, channel: str, frames: int, seconds: float, grip: float,
               seed: int) -> Path:
    """A planned test of the plate, simulated on the mesh of the identification."""
    plan = folder / PLAN / name
    plan.mkdir(parents=True)
    write_inp(strip_with_hole(*PLATE, "quad8", *DIVISIONS), plan / "mesh.inp", title)
    (plan / "experiment.toml").write_text(PLAN_TOML.substitute(
        title=title, model=model, channel=channel, frames=frames, seconds=seconds, grip=grip), encoding="utf-8")
    return simulate(plan, folder / name, seed=seed).parent


