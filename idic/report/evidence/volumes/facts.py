"""What `idic check` tells of volumes: every scan is read slab by slab; the texture is looked at in the middle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from zlib import crc32

import numpy as np

from idic.fe import cell_type
from idic.images import Scanner, picture
from idic.model import Experiment, Remedies
from idic.report.evidence.causes.lines import excluded_frames
from idic.report.evidence.volumes.shown_mesh import ShownMesh
from idic.report.figures.mesh.overlay import mesh_overlay
from idic.report.figures.picture import Picture

SLAB_BYTES = 64_000_000  # that are read at a time
TEXTURE_SIDE = 96  # voxels, of the block whose contrast is told
MIN_ELEMENT_VOXELS = 200.0  # fewer: a free displacement scatters by more than 0.05 voxels at 1 % noise
MAX_BRIGHTNESS_CHANGE = 0.2  # of the mean grey value from the reference
MIN_CONTRAST = 2.0  # standard deviation of the texture over that of the noise
MIN_SEEN_SHARE = 0.999  # of the nodes within the volume


@dataclass(frozen=True)
class VolumeFacts:
    """Facts on scans and mesh.

    n_seen : elements within the volume; element_voxels, smallest_voxels : voxels per element, mean and least;
    contrast_gv : standard deviation of the texture; warnings : sentences
    """

    dtype: str
    n_seen: int
    element_voxels: float
    smallest_voxels: float
    contrast_gv: float
    warnings: tuple[str, ...]


def volume_facts(experiment: Experiment) -> VolumeFacts:
    """Read every scan once; InputError where one is damaged."""
    model, stack = experiment.model, experiment.recording.volumes
    scanner = model.camera
    assert isinstance(scanner, Scanner)
    px, farthest = scanner.project(model.mesh.nodes), np.array(stack.shape)[::-1] - 1.0
    inside = np.all((px >= 0) & (px <= farthest), axis=1)
    n_seen = sum(int(np.count_nonzero(np.any(inside[block.connectivity], axis=1))) for block in model.mesh.blocks)
    sizes = np.concatenate([_sizes(px[block.connectivity], block.cell) for block in model.mesh.blocks])
    low = np.clip(np.floor(px.min(axis=0)), 0, farthest)[::-1].astype(int)
    high = np.clip(np.ceil(px.max(axis=0)), 0, farthest)[::-1].astype(int) + 1
    middle, half = (low + high) // 2, np.minimum((high - low) // 2, TEXTURE_SIDE // 2)
    block = (slice(int(m - h), int(m + h + 1)) for m, h in zip(middle, half, strict=True))
    texture = stack.block(model.reference, *block)
    contrast = float(np.std(texture, dtype=float))
    warnings = [*_of_mesh(sizes, inside), *_of_texture(experiment, contrast), *_of_scans(experiment)]
    return VolumeFacts(str(texture.dtype), n_seen, float(sizes.mean()), float(sizes.min()), contrast, tuple(warnings))


def volume_overlay(experiment: Experiment) -> Picture:
    """Three sections of the reference scan with the mesh that they cut."""
    model = experiment.model
    sections = ShownMesh.seen_by(experiment, model.camera)
    corners = [sections.points_px[ring] for _, cells in sections.cells for ring in cells]
    read, shape = experiment.voxel_mask, experiment.recording.volumes.shape
    mask = None if read is None else picture(read, shape, tuple(n // 2 for n in shape[::-1]), fill=1.0) > 0
    return mesh_overlay(experiment.recording.picture(model.reference), corners, np.ones(len(corners), bool), {}, mask)


def _sizes(corners: np.ndarray, cell: str) -> np.ndarray:
    """Voxels of elements  # corners (n, n_nodes, 3) -> (n,)"""
    if cell.startswith("tet"):
        edges = corners[:, 1:4] - corners[:, :1]
        return np.abs(np.linalg.det(edges)) / 6.0
    low_high = corners[:, :cell_type(cell).n_corners]
    along = [low_high[:, [1, 2, 5, 6]].mean(axis=1) - low_high[:, [0, 3, 4, 7]].mean(axis=1),
             low_high[:, [2, 3, 6, 7]].mean(axis=1) - low_high[:, [0, 1, 4, 5]].mean(axis=1),
             low_high[:, 4:8].mean(axis=1) - low_high[:, :4].mean(axis=1)]
    return np.abs(np.linalg.det(np.stack(along, axis=1)))


def _of_mesh(sizes: np.ndarray, inside: np.ndarray) -> Iterator[str]:
    if sizes.mean() < MIN_ELEMENT_VOXELS:
        yield (f"only {sizes.mean():.0f} voxels per element: enough for the identification; the mesh is finer than "
               "what the scans show of the motion")
    if inside.mean() < MIN_SEEN_SHARE:
        yield (f"{100.0 * (1.0 - inside.mean()):.0f} % of the nodes lie outside the volume: what is simulated there is "
               "not compared; look at the picture of the sections")


def _of_texture(experiment: Experiment, contrast: float) -> Iterator[str]:
    noise = experiment.recording.noise.std_gv
    if contrast == 0.0:
        yield ("the middle of the mesh has no texture, so nothing can be correlated: check the mesh and its place "
               f"({Remedies(experiment).place})")
    elif noise is not None and contrast < MIN_CONTRAST * noise:
        yield (f"the texture ({contrast:.3g}) is less than {MIN_CONTRAST:g} times the noise ({noise:.3g}): expect "
               "large error bars; more projections or a longer exposure would help")


def _of_scans(experiment: Experiment) -> Iterator[str]:
    """Equal scans, and scans of another brightness; all are decoded."""
    recording, model = experiment.recording, experiment.model
    numbers: dict[int, int] = {}
    reference = None
    for k in (model.reference, *(k for k in range(model.n_frames) if k != model.reference)):
        checksum, mean = _read_through(recording.volumes, k)
        reference = mean if reference is None else reference
        if checksum in numbers and k not in recording.excluded:
            yield (f"{recording.labels[k]} equals {recording.labels[numbers[checksum]]} voxel by voxel: a copy under "
                   "another name?"
                   + "".join(f" Write {line.text()}" for line in excluded_frames(experiment, [k])))
        numbers.setdefault(checksum, k)
        if abs(mean - reference) > MAX_BRIGHTNESS_CHANGE * abs(reference) and k not in recording.excluded:
            yield (f"{recording.labels[k]}: the mean grey value differs by more than {100 * MAX_BRIGHTNESS_CHANGE:g} % "
                   "from the reference: reconstruct all scans with one window of grey values")


def _read_through(stack, k: int) -> tuple[int, float]:
    """Checksum and mean of a scan."""
    nz, ny, nx = stack.shape
    step = max(1, SLAB_BYTES // (8 * ny * nx))
    checksum, total = 0, 0.0
    for first in range(0, nz, step):
        slab = np.ascontiguousarray(stack.block(k, slice(first, min(first + step, nz)), slice(None), slice(None)))
        checksum = crc32(slab, checksum)
        total += float(slab.sum(dtype=float))
    return checksum, total / (nz * ny * nx)
