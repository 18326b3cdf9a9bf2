"""Layers: a stiffness that alternates with a period, as in laminates and prints.

Layers of the same stiffness have no period and no direction. The search looks at all plane waves of stiffness that
images and mesh resolve and that have several periods on the specimen: by the Fourier transform of the scores of all
elements. The strongest ones become variants; every wave that was looked at counts as a test.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from idic.diagnose.locate.place import element_centres
from idic.diagnose.locate.stiffness_score import wave_scores
from idic.diagnose.physics.candidate import MESH_TOO_COARSE, Candidate, Situation, Variant, register
from idic.model import nodes_of

MAX_LINES = 3  # waves that become variants, per element set
MIN_PERIODS = 3.0  # on the specimen
MIN_PERIOD_PX = 6.0
MIN_ELEMENTS = 4.0  # per period, of the mesh
RESOLVED_ELEMENTS = 2.5  # per period: the search sees waves as short as this
TURN_DEG = 5.0  # between directions along which elements are measured
STEPS_PER_CELL = 2  # of the search, of a wave that fits once more on the specimen
PHASES = 8  # a wave is looked at with every offset: as many tests as this
PROBE_RATIO = 1.2
# of the evidence of layers: broad stripes explain 15 % more than the direction of stiffness of a real composite
MIN_SHARE_OVER_LIMIT = 0.25
SHARE_STD = 0.15  # of the share of the stiff layers about a half, as it is supposed


@dataclass(frozen=True)
class Line:
    """A wave of stiffness: wave vector (2,) periods per mm, offset of the stiffest place from the middle of the set,
    mm, and elements per period."""

    wave: np.ndarray
    offset: float
    elements: float

    @property
    def period(self) -> float:
        return float(1.0 / np.linalg.norm(self.wave))

    @property
    def direction(self) -> float:
        """Degrees from x to y, -90 < … <= 90."""
        return float(np.degrees(np.arctan2(self.wave[1], self.wave[0])))


def variants(situation: Situation) -> tuple[Variant, ...]:
    proposals = []
    for name in _sets(situation):
        lines, searched = search(situation, name)
        proposals += [_variant(situation, name, line, searched) for line in lines]
    return tuple(proposals)


def _sets(situation: Situation) -> Iterator[str]:
    forms = {(entry["set"], entry["form"]) for entry in situation.document.get("heterogeneity", ())}
    for material in situation.experiment.model.materials:
        if (material.element_set, "layers") not in forms:
            yield material.element_set


def search(situation: Situation, name: str) -> tuple[list[Line], int]:
    """The strongest waves of stiffness of an element set, strongest first, and how many variants were looked at."""
    score, mesh = situation.stiffness_score(), situation.experiment.model.mesh
    if score is None:
        return [], 1
    elements = np.asarray(mesh.element_sets[name])
    nodes, centres = mesh.nodes[nodes_of(mesh, name), :2], element_centres(mesh)[elements, :2]
    extent = np.ptp(nodes, axis=0)
    waves = _waves(situation, name, extent)
    if not len(waves):
        return [], 1
    middle = 0.5 * (nodes.min(axis=0) + nodes.max(axis=0))
    shift = middle - 0.5 * (centres.min(axis=0) + centres.max(axis=0))  # of the middle of the set
    size = np.abs(wave_scores(score[elements], centres, waves))
    lines, remaining = [], np.ones(len(waves), dtype=bool)
    while remaining.any() and len(lines) < MAX_LINES:
        best = waves[int(np.argmax(np.where(remaining, size, -1.0)))]
        remaining &= (np.abs((waves - best) * extent) > 1.5).any(axis=1)
        wave = _refined(score[elements], centres, best, extent)
        value = wave_scores(score[elements], centres, wave[None])[0]
        period = 1.0 / np.linalg.norm(wave)
        offset = (np.angle(value) / (2.0 * np.pi) - wave @ shift) * period
        lines.append(Line(wave, float(offset - period * np.round(offset / period)),
                          float(period / _element_sizes(situation, name, wave[None])[0])))
    return lines, PHASES * len(waves)


def _waves(situation: Situation, name: str, extent: np.ndarray) -> np.ndarray:
    """Wave vectors of the search: several periods on the specimen, resolved by images and mesh  # (n, 2)"""
    cells, every = STEPS_PER_CELL * extent, np.radians(np.arange(0.0, 180.0, TURN_DEG))
    smallest = RESOLVED_ELEMENTS * _element_sizes(situation, name, np.column_stack([np.cos(every),
                                                                                    np.sin(every)])).min()
    counts = np.ceil(cells / smallest).astype(int)
    x, y = np.meshgrid(np.arange(0, counts[0] + 1), np.arange(-counts[1], counts[1] + 1), indexing="ij")
    waves = np.column_stack([x.ravel(), y.ravel()]) / cells
    waves = waves[(x.ravel() > 0) | (y.ravel() > 0)]  # a wave and its reverse are one
    period = 1.0 / np.linalg.norm(waves, axis=1)
    across = np.abs(waves) @ extent * period  # of the box of the specimen along the wave
    least = np.maximum(RESOLVED_ELEMENTS * _element_sizes(situation, name, waves), MIN_PERIOD_PX * _pixel(situation))
    return waves[(period >= least) & (across >= MIN_PERIODS * period)]


def _element_sizes(situation: Situation, name: str, waves: np.ndarray) -> np.ndarray:
    """Length of an element along every wave, mm, of the edge that is longest there: median over the area  # (n,)"""
    mesh, elements = situation.experiment.model.mesh, np.asarray(situation.experiment.model.mesh.element_sets[name])
    turns = np.radians(np.arange(0.0, 180.0, TURN_DEG))
    ways = np.array([np.cos(turns), np.sin(turns)])
    lengths, areas = [], []
    for block in mesh.blocks:
        corners = mesh.nodes[block.connectivity[:, :block.kind.n_corners], :2]
        lengths.append(np.abs((corners - np.roll(corners, 1, axis=1)) @ ways).max(axis=1))
        areas.append(np.prod(np.ptp(corners, axis=1), axis=1))
    length, area = np.concatenate(lengths)[elements], np.concatenate(areas)[elements]
    order = np.argsort(length, axis=0)
    middle = (np.cumsum(area[order], axis=0) >= 0.5 * area.sum()).argmax(axis=0)
    table = np.take_along_axis(length, order, axis=0)[middle, np.arange(len(turns))]
    angle = np.degrees(np.arctan2(waves[:, 1], waves[:, 0]))
    return table[np.rint(angle / TURN_DEG).astype(int) % len(turns)]


def _pixel(situation: Situation) -> float:
    """Size of a pixel on the specimen, mm; 0 where there are none."""
    experiment = situation.experiment
    if experiment.recording.quantity != "grey" or experiment.recording.points is not None:
        return 0.0
    extent_px = np.ptp(experiment.model.camera.project(experiment.model.mesh.nodes), axis=0)
    return float(np.linalg.norm(np.ptp(experiment.model.mesh.nodes, axis=0)) / np.linalg.norm(extent_px))


def _refined(score: np.ndarray, centres: np.ndarray, wave: np.ndarray, extent: np.ndarray) -> np.ndarray:
    """The strongest wave within a step of the search around one  # (2,)"""
    steps = np.stack(np.meshgrid(*2 * [np.linspace(-1.0, 1.0, 9)], indexing="ij"), axis=-1).reshape(-1, 2)
    neighbours = wave + steps / (STEPS_PER_CELL * extent)
    neighbours = neighbours[np.linalg.norm(neighbours, axis=1) > 0.0]
    return neighbours[int(np.argmax(np.abs(wave_scores(score, centres, neighbours))))]


def _variant(situation: Situation, name: str, line: Line, searched: int) -> Variant:
    ratio = f"{name}.layers.stiffness_ratio"
    table = {"set": name, "form": "layers", "period_mm": {"value": line.period},
             "direction_deg": {"value": line.direction}, "offset_mm": {"value": line.offset},
             "stiffness_ratio": {"value": 1.0, "identify": True}}
    refit = table | {key: table[key] | {"identify": True} for key in ("period_mm", "direction_deg", "offset_mm")}
    refit["share"] = {"value": 0.5, "identify": True, "prior": {"mean": 0.5, "std": SHARE_STD}}
    return Variant(f"{name} has stiff and soft layers, a period of {line.period:.3g} "
                   f"{situation.experiment.model.length_unit} at {line.direction:.0f} degrees",
                   _added(situation, table),
                   (ratio,), {ratio: 1.0}, {ratio: PROBE_RATIO}, sign=1, exact=True, refit=_added(situation, refit),
                   searched=searched, unresolved=_unresolved(situation, name, line))


def _unresolved(situation: Situation, name: str, line: Line) -> str:
    """What a mesh with too few elements per period says; "" of a finer one."""
    unit = situation.experiment.model.length_unit
    return "" if line.elements >= MIN_ELEMENTS else (
        f"{MESH_TOO_COARSE} for layers: the residual has a period of about {line.period:.2g} {unit} at "
        f"{line.direction:.0f} degrees, {line.elements:.1f} elements. Refine the mesh of {name} to "
        f"{line.period / MIN_ELEMENTS:.2g} {unit} or less, identify and diagnose again")


def _added(situation: Situation, table: dict) -> dict:
    return {"heterogeneity": [*situation.document.get("heterogeneity", ()), table]}


register(Candidate(
    "layers", "heterogeneity", "layers of two stiffnesses", "the same stiffness in all layers",
    rivals={"heterogeneity": "both are soft in some places: layers repeat",
            "orthotropy": "layers too thin to be seen are a stiffness that depends on direction"},
    separating_tests=("look at a polished section, or at the print plan", "load a second specimen along the layers"),
    variants=variants, everywhere=True, limits=("orthotropy",), share_over_limit=MIN_SHARE_OVER_LIMIT,
    paraphrase="stiff and soft layers that alternate with a period, as in laminates and prints"))
