"""The blur that a frame seems to have because its pattern lies between the pixels: known columns beside a defocus.

Its course over the frames follows the identified motion, its size is that of `idic.images.quality.subpixel_blur` times
an amplitude of 1 +- `RELATIVE_STD`: one column per camera and direction, among the blurs of
`idic.diagnose.residual.grey_value_effects`. A loss of focus counts by what exceeds them.
"""

from __future__ import annotations

import numpy as np

from idic.diagnose.residual.evidence import Columns, of_grey_values
from idic.diagnose.residual.grey_value_effects import BLUR, columns_of_kind, grey_image
from idic.diagnose.residual.residual_evidence import CameraResidual, ResidualEvidence
from idic.images import subpixel_blur

# of a size: surfaces of three recordings, sampled 1.3 to 1.8 times coarser and moved by half a pixel, have 0.76 to 1.58
# of it
RELATIVE_STD = 0.5


def subpixel_columns(residual: ResidualEvidence) -> Columns | None:
    """The known columns of all cameras, amplitude 1 as predicted; None where grey values take no part."""
    evidence = residual.evidence
    if not evidence.pixel_names:
        return None
    ways = columns_of_kind(evidence.pixel_names, BLUR, 0.0)  # (k, n_cameras)
    pixels = np.concatenate([np.einsum("k,td->tkd", way, _blur_of(camera, residual))
                             for way, camera in zip(ways.T, residual.cameras, strict=True)], axis=2)
    names = tuple(f"sub-pixel blur {i + 1}" for i in range(pixels.shape[2]))
    return of_grey_values(names, len(evidence.seen), residual.channels.shape[1], pixels)


def _blur_of(camera: CameraResidual, residual: ResidualEvidence) -> np.ndarray:
    """Of one camera by the motion along the columns and along the rows of its images, in every frame  # (T, 2) px²"""
    experiment, reference = camera.context.experiment, grey_image(camera.context)
    weight = reference.blur_column.astype(float) ** 2
    shapes, share = reference.pixel_map.shape_matrix(), []
    for frame, u in zip(residual.evidence.frames, residual.u, strict=True):
        motion = camera.view.at(int(frame)).motion(experiment.model.mesh.nodes, camera.turned(u))
        share.append(weight @ np.sin(np.pi * (shapes @ motion)) ** 2 / weight.sum())
    return _size(camera) * np.array(share)


def _size(camera: CameraResidual) -> np.ndarray:
    """A of the reference image  # (2,) px²"""
    experiment, reference = camera.context.experiment, grey_image(camera.context)
    frames = experiment.recording.averaged or (experiment.model.reference,)
    image = np.mean([np.asarray(experiment.recording.stack.frame(k), dtype=float) for k in frames], axis=0)
    region = reference.pixel_map.to_image(np.ones(len(reference.f)), 0.0) > 0.0
    noise, correlated = experiment.recording.noise.std_gv or 0.0, experiment.recording.noise.correlated
    noise = noise if correlated is None else correlated.recorded_gv
    correlation = None if correlated is None else np.array(correlated.correlation)
    return subpixel_blur(image, region, reference.degree, reference.lowpass_px,
                         noise**2 / len(frames), correlation)
