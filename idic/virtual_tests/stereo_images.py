"""The images of a mesh that moves before one camera with a lens, frame by frame."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from idic.experiment_file import DesignTable
from idic.fe import Mesh
from idic.identification import DOT_SIGMA_PER_SPECKLE
from idic.images import AnyCamera, PlacedCamera
from idic.virtual_tests.rendering.render import Sensor, record
from idic.virtual_tests.ray_tracing import Scene
from idic.virtual_tests.solid_speckle import PERIOD_CELLS, SolidSpeckle
from idic.virtual_tests.virtual_test import GREY_LEVELS, with_contrast

SPECKLE_PX = 1.6       # sigma of the dots in the middle of the image
LOW, HIGH = 0.08, 0.92  # grey values of the speckle as a part of the levels


def scene_of(mesh: Mesh, surface: str | None) -> Scene:
    """What is seen of a plane specimen (z = 0, both sides), or of a solid: the set with speckle, other faces
    without."""
    if mesh.n_dim == 2:
        nodes = np.column_stack([mesh.nodes, np.zeros(mesh.n_nodes)])
        return Scene(nodes, mesh.surface_cells(), closed=False)
    painted = {tuple(face) for face in np.asarray(mesh.edge_sets[surface]).tolist()}
    unpainted = [face for face in mesh.boundary_faces().tolist() if tuple(face) not in painted]
    bare = mesh.face_cells(np.array(unpainted, dtype=np.int64)) if unpainted else []
    return Scene(mesh.nodes, mesh.surface_cells(surface), bare)


def common_speckle(cameras: Sequence[AnyCamera], rng: np.random.Generator, levels: float,
                   planned: DesignTable | None = None) -> SolidSpeckle | None:
    """The speckle that all cameras with a lens see, of a size for the coarsest of them; None where there is none.

    planned : with its size and contrast
    """
    sizes = [camera.pixel_size for camera in cameras if isinstance(camera, PlacedCamera)]
    if not sizes:
        return None
    pixel = max(sizes)
    if planned is None:
        return SolidSpeckle.drawn(rng, SPECKLE_PX * pixel, LOW * levels, HIGH * levels)
    speckle = SolidSpeckle.drawn(rng, DOT_SIGMA_PER_SPECKLE * planned.speckle_px * pixel)
    return with_contrast(speckle, planned.contrast_gv * levels / GREY_LEVELS, 0.5 * levels, pixel,
                         np.full(3, PERIOD_CELLS * speckle.cell_mm))


def traced_images(mesh: Mesh, surface: str | None, camera: PlacedCamera, motion: Sequence[np.ndarray], sensor: Sensor,
                  camera_rng: np.random.Generator, speckle: SolidSpeckle | None = None) -> Iterator[np.ndarray]:
    """Recorded images of the nodal displacements `motion` (n_nodes, 2|3) mm, one at a time.

    speckle : None: one of a size for this camera is drawn now
    """
    drawn_speckle = common_speckle([camera], camera_rng, GREY_LEVELS) if speckle is None else speckle
    return _recorded(scene_of(mesh, surface), camera, motion, sensor, drawn_speckle, camera_rng)


def _recorded(scene: Scene, camera: PlacedCamera, motion: Sequence[np.ndarray], sensor: Sensor,
              speckle: SolidSpeckle, camera_rng: np.random.Generator) -> Iterator[np.ndarray]:
    for frame, u in enumerate(motion):
        u = u if u.shape[1] == 3 else np.column_stack([u, np.zeros(len(u))])
        exposure = scene.image(u, camera.at(frame).effective, speckle.value, sensor)
        yield record(exposure, sensor, camera_rng)
