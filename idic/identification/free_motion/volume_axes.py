"""Axes of volumes that contradict the motion: the specimen is stretched along another axis than the model's ends move.

The motion of the elements around the middle of the mesh is measured as an affine one (`idic.measure.volume_motion`).
Between two ends it stretches the specimen by what the log says along the line between them; where it does so along
another mesh axis, two axes of the volume are swapped.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from idic.errors import InputError
from idic.fe import Block, Mesh
from idic.measure import volume_motion
from idic.model import Column, Constant, Experiment, Measured

MAX_VOXELS = 2_000_000  # of the elements that are followed: a second per scan
MAX_SCANS = 4  # that are followed up to the last one
MIN_ELONGATION_PX = 0.2  # between the ends: interpolation and rings bias an affine motion by up to 0.05
MIN_ALIGNMENT = 0.9  # of the line between the ends along the axis of their motion: less is shear or bending
MAX_OWN_RATIO = 0.3  # measured over expected strain along that axis; a machine that yields or a grip that slips leaves
# more, and under tension along another axis it is contracted
OTHER_RATIO = (0.5, 2.0)  # of the strain along the other axis over the expected one
MIN_AXES_RATIO = 2.0  # of strains where the log has no motion: a contraction is at most half of the elongation


@dataclass(frozen=True)
class Pull:
    """Two ends that move apart along a mesh axis.

    axis : 0 x, 1 y, 2 z; names : of their sets; length_mm : their distance; elongation_mm : (n_frames,) by the log,
    None: not logged
    """

    axis: int
    names: tuple[str, str]
    length_mm: float
    elongation_mm: np.ndarray | None


def check_volume_axes(experiment: Experiment) -> None:
    """InputError where the measured motion of volumes fits other axes than those of [scanner]."""
    pull = pull_of(experiment) if experiment.recording.quantity == "volume" else None
    if pull is None:
        return
    frames = _followed(experiment)
    measured = volume_motion(_around_the_middle(experiment), np.inf, frames=frames)
    frame = frames[-1]
    u, nodes = measured.u_mm[frame], experiment.model.mesh.nodes
    if not np.isfinite(u).all():
        return
    slopes = np.linalg.lstsq(np.column_stack([np.ones(len(nodes)), nodes]), u, rcond=None)[0][1:]
    strain = np.diag(slopes)
    stretched = _other_axis(experiment, pull, strain, frame)
    if stretched is None:
        return
    axes = axis_names(experiment.model.camera.matrix)
    axes[pull.axis], axes[stretched] = axes[stretched], axes[pull.axis]
    along, across = "xyz"[pull.axis], "xyz"[stretched]
    logged = "" if pull.elongation_mm is None else f" by {100 * _expected(pull, frame):.3g} % (log)"
    raise InputError("axes of the volume are swapped", file="experiment.toml", key="scanner.axes",
                     expected=f"a motion that stretches the specimen between {' and '.join(pull.names)} along mesh "
                              f"{along}{logged}",
                     found=f"{experiment.recording.labels[frame]} is stretched by {100 * strain[stretched]:.3g} % "
                           f"along mesh {across}, and by {100 * strain[pull.axis]:.3g} % along mesh {along}",
                     remedy="look at the picture of `idic init`; axes = [" + ", ".join(f'"{name}"' for name in axes)
                            + "] under [scanner] would fit the motion, with an origin_px for it")


def pull_of(experiment: Experiment) -> Pull | None:
    """The two ends farthest from each other whose motion along the line between them is known or measured."""
    model, pulls = experiment.model, []
    drives = {(entry.nodes, "xyz".index(entry.component)): entry.drive for entry in model.prescribed}
    for (first, axis), (second, other_axis) in combinations(drives, 2):
        line = _middle(model.mesh, second) - _middle(model.mesh, first)
        length = float(np.linalg.norm(line))
        if axis != other_axis or first == second or not abs(line[axis]) > MIN_ALIGNMENT * length:
            continue
        pair = [drives[first, axis], drives[second, axis]]
        sign = float(np.sign(line[axis]))
        if all(isinstance(drive, Column | Constant) for drive in pair):
            ends = [np.broadcast_to(np.asarray(drive.values if isinstance(drive, Column) else drive.value, float),
                                    model.n_frames) for drive in pair]
            elongation = sign * (ends[1] - ends[0])
            pulls.append(Pull(axis, (first, second), length, elongation - elongation[model.reference]))
        elif all(isinstance(drive, Measured) for drive in pair) and _is_pulled(experiment, (first, second), axis):
            pulls.append(Pull(axis, (first, second), length, None))
    return max(pulls, key=lambda pull: pull.length_mm, default=None)


def axis_names(matrix: np.ndarray) -> list[str]:
    """The axes of a volume along mesh x, y and z: ``["+col", "-row", "+slice"]``."""
    largest = np.argmax(np.abs(matrix), axis=0)
    return [("+" if matrix[k, axis] > 0 else "-") + ("col", "row", "slice")[k] for axis, k in enumerate(largest)]


def _middle(mesh: Mesh, name: str) -> np.ndarray:
    return mesh.nodes[mesh.node_sets[name]].mean(axis=0)


def _is_pulled(experiment: Experiment, names: tuple[str, str], axis: int) -> bool:
    """Whether a force along this axis is measured at one of the ends."""
    return any(channel.kind == "reaction" and channel.nodes in names and channel.component == "xyz"[axis]
               for channel in experiment.model.channels)


def _followed(experiment: Experiment) -> list[int]:
    """Scans that are followed, the one of the largest elongation or the last at the end."""
    model, pull = experiment.model, pull_of(experiment)
    counted = [k for k in range(model.reference + 1, model.n_frames) if k not in experiment.recording.excluded]
    if pull is not None and pull.elongation_mm is not None:
        counted = counted[:int(np.argmax(np.abs(pull.elongation_mm[counted]))) + 1]
    return [counted[k] for k in np.unique(np.linspace(0, len(counted) - 1, MAX_SCANS).astype(int))]


def _around_the_middle(experiment: Experiment) -> Experiment:
    """The experiment with the elements next to the middle of the mesh alone."""
    mesh = experiment.model.mesh
    middles = np.concatenate([mesh.nodes[block.connectivity].mean(axis=1) for block in mesh.blocks])
    extent = np.ptp(mesh.nodes, axis=0) / experiment.model.camera.pixel_size
    n_kept = max(1, int(len(middles) * min(1.0, MAX_VOXELS / float(np.prod(extent)))))
    distance = np.abs(middles - mesh.nodes.mean(axis=0)).max(axis=1)
    keep = np.zeros(len(middles), dtype=bool)
    keep[np.argsort(distance, kind="stable")[:n_kept]] = True
    blocks: list[Block] = []
    for block in mesh.blocks:
        part = keep[block.first:block.first + block.n_elements]
        if part.any():
            blocks.append(Block(block.cell, block.connectivity[part], sum(entry.n_elements for entry in blocks)))
    return replace(experiment, model=replace(experiment.model, mesh=Mesh(mesh.nodes, tuple(blocks))))


def _expected(pull: Pull, frame: int) -> float:
    assert pull.elongation_mm is not None  # of logged ends
    return float(pull.elongation_mm[frame]) / pull.length_mm


def _other_axis(experiment: Experiment, pull: Pull, strain: np.ndarray, frame: int) -> int | None:
    """The mesh axis along which the specimen is stretched in place of that of its ends; None: it is not."""
    across = [k for k in range(3) if k != pull.axis]
    if pull.elongation_mm is not None:
        expected = _expected(pull, frame)
        if abs(pull.elongation_mm[frame]) < MIN_ELONGATION_PX * experiment.model.camera.pixel_size:
            return None
        ratio = strain / expected
        best = max(across, key=lambda k: ratio[k])
        return best if ratio[pull.axis] < MAX_OWN_RATIO and OTHER_RATIO[0] < ratio[best] < OTHER_RATIO[1] else None
    best = max(across, key=lambda k: abs(strain[k]))
    size_px = abs(strain[best]) * np.ptp(experiment.model.mesh.nodes[:, best]) / experiment.model.camera.pixel_size
    clear = abs(strain[best]) > MIN_AXES_RATIO * abs(strain[pull.axis]) and size_px > MIN_ELONGATION_PX
    return best if clear else None
