"""The motion of the images of one camera without law and load, and the motion that noise alone causes.

Free FE-DIC on the mesh of the model, frame by frame, started from the simulated motion. Its noise is that of still
images: the reference image, compared with itself under noise of the size that two images differ by.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from idic.correlation import FieldReference, ReferenceImage, frame_spline
from idic.measure.dic import Regularisation, Smoother, build_smoother, dic_frame
from idic.measure.dic.field import field_frame, smoother_of
from idic.measure.dic.frame import DicFrame, Factorisation
from idic.images import Camera, prefilter
from idic.model import Experiment

MAX_FREE_DIC_NODES = 60_000  # nodes: above, a free displacement takes longer than the rest of a report
N_NOISE_SAMPLES = 8  # still images: a standard deviation of one node to a quarter, of all nodes to a percent or two
_SEED = 30  # of their noise


@dataclass(frozen=True)
class Seen:
    """What a free FE-DIC needs of a run: one camera's view, its reference image, and the smoothness it assumes."""

    experiment: Experiment
    reference: ReferenceImage
    smoother: Smoother

    def length_mm(self, camera: Camera) -> float:
        """Length of the wave that the regularisation halves, mm."""
        middle = self.experiment.model.mesh.nodes.mean(axis=0, keepdims=True)
        return float(self.smoother.length_px / np.sqrt(abs(np.linalg.det(camera.jacobian(middle)[0]))))

    def free_motion(self, frames: Sequence[int], simulated: Callable[[int], np.ndarray]) -> np.ndarray:
        """The free motion in some frames, NaN where it is lost or a node is not seen.

        simulated : frame -> (n_nodes, 2) px

        Returns
        -------
        (n_frames, n_nodes, 2) px
        """
        motion = np.full((len(frames), self.experiment.model.mesh.n_nodes, 2), np.nan)
        for k, frame in enumerate(frames):
            if frame == self.experiment.model.reference:
                motion[k] = 0.0
                continue
            dic = free_frame(self, frame, simulated(frame))
            if dic is not None:
                motion[k] = dic.u_px
        return motion

    def still_frame(self, rng: np.random.Generator, noise_gv: float,
                    factorisation: Factorisation | None = None) -> DicFrame | None:
        """The motion found in a still image with fresh noise; noise_gv : standard deviation of one image."""
        experiment, reference = self.experiment, self.reference
        if isinstance(reference, FieldReference):
            std = noise_gv * np.sqrt(1.0 + 1.0 / reference.n_images)
            return field_frame(reference, std * rng.standard_normal(reference.pixel_map.n_pixels), self.smoother)
        averaged_frames = experiment.recording.averaged or (experiment.model.reference,)
        still = np.mean([np.asarray(experiment.recording.stack.frame(k), dtype=float) for k in averaged_frames], axis=0)
        still = still + noise_gv * np.sqrt(1.0 + 1.0 / len(averaged_frames)) * rng.standard_normal(still.shape)
        spline = prefilter(still, reference.degree, experiment.options.lowpass_px)
        dic = dic_frame(reference, spline, np.zeros((experiment.model.mesh.n_nodes, 2)), self.smoother,
                        experiment.options.brightness, factorisation=factorisation)
        return dic if dic.factorisation is not None and dic.n_pixels else None

    def noise_samples(self, n: int = N_NOISE_SAMPLES) -> np.ndarray | None:
        """Motion by noise alone, in repeated still images; None where the noise is not known.

        Returns
        -------
        (n, n_nodes, 2) px
        """
        noise = self.experiment.recording.noise.in_sums_gv
        if not noise:
            return None
        rng, factorisation, samples = np.random.default_rng(_SEED), None, []
        for _ in range(n):
            still = self.still_frame(rng, noise, factorisation)
            if still is None:
                return None
            factorisation = still.factorisation
            samples.append(still.u_px)
        return np.array(samples)

    @classmethod
    def by(cls, experiment: Experiment, reference) -> Seen | None:
        """None where there is none of this kind: height images (sections have their own), meshes too large for a
        report."""
        model = experiment.model
        if isinstance(reference, FieldReference):
            return cls(experiment, reference.in_plane, smoother_of(model, reference, Regularisation.smooth()))
        if experiment.recording.quantity != "grey" or model.is_section or model.mesh.n_nodes > MAX_FREE_DIC_NODES:
            return None
        cells = model.mesh.surface_cells(model.surface)
        return cls(experiment, reference, build_smoother(reference.pixel_map.nodes_px, cells, Regularisation.smooth()))


def free_frame(view: Seen, frame: int, start: np.ndarray,
               factorisation: Factorisation | None = None) -> DicFrame | None:
    """The free motion in one frame; None where it is lost.

    start : (n_nodes, 2) px, simulated motion; factorisation : of a neighbouring frame
    """
    if isinstance(view.reference, FieldReference):
        return field_frame(view.reference, view.reference.measured(view.experiment, frame), view.smoother)
    dic = dic_frame(view.reference, frame_spline(view.experiment, frame), start, view.smoother,
                    view.experiment.options.brightness, factorisation=factorisation)
    return dic if dic.factorisation is not None and dic.n_pixels else None


def in_mm(motion: np.ndarray, nodes: np.ndarray, camera: Camera, later: Camera | None = None) -> np.ndarray:
    """Displacement in the plane of the mesh from a motion in the image.

    motion : (n_nodes, 2) px; nodes : (n_nodes, 2 or 3) mm; later : the camera of the frame, where it moves

    Returns
    -------
    (n_nodes, 2) mm
    """
    place = camera.project(nodes) + motion
    measured = np.isfinite(place).all(axis=1)
    displacement = np.full(motion.shape, np.nan)
    displacement[measured] = (later or camera).inverse(place[measured]) - nodes[measured, :2]
    return displacement
