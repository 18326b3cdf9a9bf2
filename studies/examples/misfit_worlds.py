"""Recordings with a small model error: strips with a hole whose truth differs slightly from the model.

The truth of every world lies on another mesh than the user's, and is rendered by other code than that which correlates
the images. The seed draws size and sign of the error. `metal` and `polymer` differ from the model by their mesh alone.

hardening     metal that saturates (Voce) under linear hardening; E and nu have the same meaning in both
solid         bricks, 1 to 3 mm thick, under plane stress
coarse        few linear quadrilaterals around the hole, computed as given
rotation      the moving grip turns in the plane; the model holds it straight
lens          barrel or cushion; the model has none
orthotropy    Young's modulus across other than along the load, which E and nu mean; the model is isotropic
off_axis      composite with fibres at 30 degrees to the load; the rim of its hole is softer or stiffer than the model's
spot          metal with a round spot somewhere that is softer or stiffer; values mean the metal beside it
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from idic.fe import Block, Constraints, Mesh, Body, Reaction, Section, make_mesh, march
from idic.laws import CompiledLaw, compile as compile_law
from idic.virtual_tests import DemoSize, LoggedColumn, VirtualTest, medium_speckle, strip
from idic_studies.examples.open_hole_strip import HIDDEN_GRIP_MM, POLYMER, POLYMER_TABLE

METAL_SIZE = DemoSize(0.2, (100, 152), (3, 3, 4), (3, 4, 2), (5, 7, 3), 1)
POLYMER_SIZE = replace(METAL_SIZE, pixel=0.1, shape=(200, 304), user=(8, 10, 5), true=(10, 14, 6))  # the error of both
# meshes together: 0.2 standard deviations of nu by noise; 1.4 with (4, 6, 3), which the discrepancy finds
RIGHT, WRONG = ("metal", "polymer"), ("solid", "coarse", "hardening", "orthotropy", "rotation", "lens", "off_axis",
                                       "spot")
ELASTIC = ("polymer", "orthotropy", "off_axis")
MIN_SIZE = 0.25  # of the largest error: draws are uniform from there, of either sign
MAX_SATURATION_MPA, SATURATION_RATE = 25.0, 80.0  # of Voce's term
MAX_ANISOTROPY = 0.05  # of Young's modulus across over that along
COMPOSITE = {"sheet.E1": 40000.0, "sheet.E2": 9000.0, "sheet.nu12": 0.3, "sheet.G12": 4500.0}
FIBRES_DEG = 30.0
COMPOSITE_TABLE = {"law": "orthotropic", "kinematics": "finite", "angle": {"value": FIBRES_DEG, "unit": "deg"}} | {
    name.partition(".")[2]: {"value": value, "identify": True} | ({} if name == "sheet.nu12" else {"unit": "MPa"})
    for name, value in COMPOSITE.items()}  # [material.sheet]
# of the moduli at the hole's rim; where the rim ends, over the radius of the hole
MAX_RIM_CHANGE, RIM_RADIUS = 0.2, 1.4
MAX_SPOT_CHANGE, SPOT_RADIUS_MM = 0.2, 2.0  # of all stresses in a spot between the rim of the hole and the edges
MAX_ROTATION = 5e-4  # rad at the end of the test: 0.02 px at the corners of the grip
MAX_K1 = 2.5e-6  # 1/px²: a point at the edge of the image is seen 1.1 px off
THICKNESSES_MM, LAYERS, SOLID_MESH = (1.0, 1.5, 2.0, 3.0), 2, (4, 6, 3)
COARSE_MESHES = ((3, 5, 2), (4, 6, 3), (4, 8, 3), (5, 7, 4))  # around, radial, beside


@dataclass(frozen=True)
class Draw:
    """A draw of a world.

    size : the error over the largest one, of either sign; thickness_mm; coarse : mesh of the user where it is coarse;
    place : mm, of a spot
    """

    world: str
    size: float
    thickness_mm: float
    coarse: tuple[int, int, int]
    place: tuple[float, float] = (0.0, 0.0)

    @property
    def elastic(self) -> bool:
        """Whether the strip is elastic: the polymer or the composite."""
        return self.world in ELASTIC

    @property
    def overrides(self) -> dict[str, Any]:
        """Of experiment.toml."""
        table = COMPOSITE_TABLE if self.world == "off_axis" else POLYMER_TABLE
        tables: dict[str, Any] = {"material": {"sheet": table}} if self.elastic else dict(DemoSize.TRUTH)
        if self.world == "coarse":
            tables["options.element_order"] = "as_given"
        return tables | ({"experiment.thickness_mm": self.thickness_mm} if self.world == "solid" else {})


def draw(world: str, seed: int) -> Draw:
    """A draw; the same `seed` gives the same one."""
    rng = np.random.default_rng((seed, sum(world.encode())))
    size = float(rng.choice([-1.0, 1.0]) * rng.uniform(MIN_SIZE, 1.0))
    thickness = float(rng.choice(THICKNESSES_MM)) if world == "solid" else DemoSize.THICKNESS
    coarse = COARSE_MESHES[int(rng.integers(len(COARSE_MESHES)))]
    away, angle = 0.0, 0.0
    if world == "spot":
        away, angle = rng.uniform(DemoSize.RADIUS, 0.5 * DemoSize.WIDTH), rng.uniform(0.0, 2.0 * np.pi)
    return Draw(world, size, thickness, coarse, (float(away * np.cos(angle)), float(away * np.sin(angle))))


def flow_stress(drawn: Draw, plastic_strain: float) -> float:
    """True flow stress of the metal that saturates, MPa."""
    saturated = MAX_SATURATION_MPA * drawn.size * (1.0 - np.exp(-SATURATION_RATE * plastic_strain))
    truth = DemoSize.TRUTH
    return float(truth["sheet.yield_stress"] + truth["sheet.hardening_modulus"] * plastic_strain + saturated)


def virtual_test(drawn: Draw) -> VirtualTest:
    """The test of a draw: its truth, and the files of a user who does not know it."""
    pixels = POLYMER_SIZE if drawn.elastic else METAL_SIZE
    bare = strip(replace(pixels, true=(2, 2, 1)))  # its files, times and camera; the motion is replaced
    grip, user_truth, camera, mesh = bare.columns[1].values, dict(DemoSize.TRUTH), bare.camera, bare.mesh
    if drawn.elastic:
        grip = HIDDEN_GRIP_MM * bare.times / bare.times[-1]
        user_truth = dict(COMPOSITE if drawn.world == "off_axis" else POLYMER)
    if drawn.world == "hardening":
        user_truth = {key: user_truth[key] for key in ("sheet.E", "sheet.nu")}
    if drawn.world == "coarse":
        mesh = DemoSize.mesh("quad4", drawn.coarse)
    if drawn.world == "lens":
        camera = replace(camera, k1=MAX_K1 * drawn.size, centre_px=0.5 * np.array(pixels.shape[::-1]))
    truth = _truth_of(drawn)
    nodes, cells = _surface(truth.mesh)
    u, force = _solved(truth, grip, bare.times, drawn.thickness_mm)
    noises = [column.noise_std for column in bare.columns]
    return replace(bare, nodes=nodes, cells=cells, displacements=u[:, -len(nodes):, :2], camera=camera, mesh=mesh,
                   truth=user_truth, texture=medium_speckle(camera, pixels.shape),
                   columns=(LoggedColumn("force_N", force, noises[0]),
                            LoggedColumn("grip_displacement_mm", grip, noises[1])))


@dataclass(frozen=True)
class _Spot:
    """change : of some parameters in the circle, over their values elsewhere; centre and radius in mm"""

    change: float
    parameters: tuple[str, ...]
    centre: tuple[float, float]
    radius: float


@dataclass(frozen=True)
class _Truth:
    """What happens in the laboratory; spot : where the material is another."""

    mesh: Mesh
    law: str
    values: Mapping[str, float]
    kind: str = "plane_stress"
    rotation: float = 0.0
    spot: _Spot | None = None


def _truth_of(drawn: Draw) -> _Truth:
    """The law and the boundary of a draw on a fine mesh."""
    mesh = DemoSize.mesh("quad8", (POLYMER_SIZE if drawn.elastic else METAL_SIZE).true)
    metal = {key.partition(".")[2]: value for key, value in DemoSize.TRUTH.items()}
    polymer = {key.partition(".")[2]: value for key, value in POLYMER.items()}
    if drawn.world == "polymer":
        return _Truth(mesh, "elastic", polymer)
    if drawn.world == "orthotropy":
        along, across = polymer["E"], polymer["E"] * (1.0 + MAX_ANISOTROPY * drawn.size)
        shear = 0.5 * np.sqrt(along * across) / (1.0 + polymer["nu"])
        return _Truth(mesh, "orthotropic",
                      {"E1": along, "E2": across, "nu12": polymer["nu"], "G12": shear, "angle": 0.0})
    if drawn.world == "off_axis":
        stiffness = {name.partition(".")[2]: value for name, value in COMPOSITE.items()}
        rim = _Spot(MAX_RIM_CHANGE * drawn.size, ("E1", "E2", "G12"), (0.0, 0.0), RIM_RADIUS * DemoSize.RADIUS)
        return _Truth(mesh, "orthotropic", stiffness | {"angle": FIBRES_DEG}, spot=rim)
    if drawn.world == "spot":
        stresses = ("E", "yield_stress", "hardening_modulus")
        spot = _Spot(MAX_SPOT_CHANGE * drawn.size, stresses, drawn.place, SPOT_RADIUS_MM)
        return _Truth(mesh, "j2_linear", metal, spot=spot)
    if drawn.world == "hardening":
        return _Truth(mesh, "j2_voce", metal | {"Q": MAX_SATURATION_MPA * drawn.size, "b": SATURATION_RATE})
    if drawn.world == "solid":
        return _Truth(_solid(drawn.thickness_mm), "j2_linear", metal, "solid")
    return _Truth(mesh, "j2_linear", metal, rotation=MAX_ROTATION * drawn.size if drawn.world == "rotation" else 0.0)


def _solved(truth: _Truth, grip: np.ndarray, times: np.ndarray, thickness: float) -> tuple[np.ndarray, np.ndarray]:
    """True displacements (n_frames, n_nodes, d) mm and force (n_frames,) N of a strip that its right grip pulls."""
    mesh, d = truth.mesh, truth.mesh.n_dim
    left_end, right_end = mesh.node_sets["LEFT"], mesh.node_sets["RIGHT"]
    driven = [d * right_end, d * right_end + 1, *(d * left_end + axis for axis in range(d))]
    if d == 3:
        gripped = np.concatenate([3 * left_end + 2, 3 * right_end + 2])
        driven += [3 * right_end + 2, np.setdiff1d(3 * mesh.node_sets["MIDDLE"] + 2, gripped)]
    dofs, n = np.concatenate(driven), len(right_end)
    x, y = mesh.nodes[right_end, 0], mesh.nodes[right_end, 1]
    basis = np.zeros((len(dofs), 2))
    basis[:n, 0], basis[:n, 1], basis[n:2 * n, 1] = 1.0, -y, x - x.mean()
    law = compile_law(truth.law, "finite")
    sections, values = _sections(truth, law)
    model = Body(mesh=mesh, kind=truth.kind, sections=sections,
                  thickness=thickness, channels=(Reaction(d * right_end, 2.0 if d == 3 else 1.0),),
                  constraints=Constraints(dofs, basis, np.column_stack([grip, truth.rotation * grip / grip[-1]])))
    states = [(state.u.copy(), state.channels[0]) for state in march(model, values, times)]
    return np.array([u for u, _ in states]), np.array([force for _, force in states])


def _sections(truth: _Truth, law: CompiledLaw) -> tuple[tuple[Section, ...], dict[str, np.ndarray]]:
    """The strip, and the spot that differs; with the values of both."""
    sheet = truth.mesh.element_sets["sheet"]
    values = np.array([truth.values[name] for name in law.spec.parameter_names])
    if truth.spot is None:
        return (Section("sheet", law, sheet),), {"sheet": values}
    centres = np.concatenate([truth.mesh.nodes[block.connectivity].mean(axis=1) for block in truth.mesh.blocks])
    in_spot = np.hypot(*(centres[sheet] - truth.spot.centre).T) < truth.spot.radius
    changed = np.isin(law.spec.parameter_names, truth.spot.parameters)
    return ((Section("sheet", law, sheet[~in_spot]), Section("spot", law, sheet[in_spot])),
            {"sheet": values, "spot": np.where(changed, (1.0 + truth.spot.change) * values, values)})


def _solid(thickness: float) -> Mesh:
    """Half the strip's thickness in layers of bricks, thinner towards the surface; MIDDLE: the plane of symmetry."""
    plane = DemoSize.mesh("quad4", SOLID_MESH)
    levels = 0.5 * thickness * (1.0 - (1.0 - np.linspace(0.0, 1.0, LAYERS + 1)) ** 1.5)
    n, cells = len(plane.nodes), plane.blocks[0].connectivity
    nodes = np.concatenate([np.column_stack([plane.nodes, np.full(n, z)]) for z in levels])
    bricks = np.concatenate([np.hstack([cells + k * n, cells + (k + 1) * n]) for k in range(LAYERS)])
    ends = {name: np.concatenate([members + k * n for k in range(LAYERS + 1)])
            for name, members in plane.node_sets.items()}
    return make_mesh(nodes, [("hex8", bricks)], node_sets=ends | {"MIDDLE": np.arange(n)},
                     element_sets={"sheet": np.arange(len(bricks))})


def _surface(mesh: Mesh) -> tuple[np.ndarray, tuple[Block, ...]]:
    """Nodes (the last ones of the body) and cells of the surface that the camera sees."""
    plane = mesh if mesh.n_dim == 2 else DemoSize.mesh("quad4", SOLID_MESH)
    return plane.nodes, plane.blocks
