"""From a finished identification to its evidence: its simulation, two passes over the images.

The second pass is what the reference image's noise costs: R = sum of all residuals must be known before the first
frame can be made white.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from idic.correlation.channels import channel_equations
from idic.correlation.context import CorrelationContext, FrameResponse
from idic.correlation.experiment_reference import build_reference, camera_at
from idic.correlation.frame import NodalEquations
from idic.correlation.frame_equations import correlated_frames, global_columns
from idic.correlation.view import GREY, View, view_of
from idic.diagnose.residual.evidence import Columns, Evidence, FrameEvidence, noise_share
from idic.diagnose.residual.grey_value_effects import pixel_basis, pixel_parts, sums_against
from idic.identify.in_memory import Identification
from idic.identify.kept_simulation import response_of

MAX_KEPT_BYTES = 300e6  # of residual maps, at most


@dataclass(frozen=True, eq=False)
class ResidualEvidence:
    """What the tests start from.

    evidence : the white residual; null : columns of the identified parameters; u : (T, n_nodes, dim) mm; channels :
    (T, n_channels) simulated; context : camera, reference image and parameters; shared_gv : R per pixel of the map.
    """

    evidence: Evidence
    null: Columns
    u: np.ndarray
    channels: np.ndarray
    context: CorrelationContext
    view: View
    shared_gv: np.ndarray


def residual_evidence(found: Identification, light: bool = True, null: bool = True,
           responses: Sequence[FrameResponse] | None = None) -> ResidualEvidence:
    """Bring the residual of the accepted point to the nodes; it is simulated once more where its path was not kept.

    light : False leaves out the columns of grey values (`idic.diagnose.residual.grey_value_effects`), which only a
    screening needs
    null : False leaves out the columns of the identified parameters, which a judgement of what is left does not need
    responses : of `simulated`, where the same point has been simulated for another copy of the recording
    """
    context = context_of(found, null)
    view = view_of(context.experiment, context.camera)
    return _assemble(context, view, simulated(found, null) if responses is None else responses, found.local, light)


def simulated(found: Identification, null: bool = True) -> list[FrameResponse]:
    """The accepted point's path in the frames that are compared; null : with its derivatives by the parameters."""
    forward, experiment = found.forward, found.experiment.at_geometry(found.parameters)
    wanted = set(correlated_frames(experiment, range(experiment.n_frames)))
    if found.path is not None:
        kept = [response for response in found.path.frames if response.frame in wanted]
        return kept if null else [replace(r, du=r.du[..., :0].copy(), dchannels=r.dchannels[:, :0]) for r in kept]
    moving = tuple(name for name in experiment.parameters.free if null and forward.moves(name))
    states = found.march(moving, forward.drives.n_local > 0)
    return [response_of(at, experiment.reference) for at in states if at.frame + experiment.reference in wanted]


def context_of(found: Identification, null: bool = True) -> CorrelationContext:
    """Camera, reference image and parameters of a record; null : as for `gather`."""
    forward, parameters = found.forward, found.parameters
    experiment = found.experiment.at_geometry(parameters)
    camera = camera_at(experiment, parameters)
    names = experiment.parameters.free if null else ()
    moving = tuple(name for name in names if forward.moves(name))
    return CorrelationContext(experiment, parameters, names, moving, camera, build_reference(experiment, camera),
                              found.weights, forward.drives.local_precision)


def _assemble(context: CorrelationContext, view: View, responses: Sequence[FrameResponse], local: np.ndarray,
              light: bool) -> ResidualEvidence:
    experiment, nodes = context.experiment, context.experiment.mesh.nodes
    motions = [view.at(response.frame).motion(nodes, response.u) for response in responses]
    shares = [context.reference.compare(experiment, response.frame, motion)
              for response, motion in zip(responses, motions, strict=True)]
    kappa = np.array([share.kappa for share in shares])
    maps = _ResidualMaps(context, [response.frame for response in responses], motions)
    n_images = context.reference.n_images
    shared, chi2 = _shared_residual(maps, kappa, n_images)
    seen = _seen_dofs(shares[0])
    back = np.array([context.reference.pull_back(motion) for motion in motions])
    still_q, still_rb = sums_against(context, shared)
    c, inverse_variance = noise_share(kappa, n_images), 1.0 / context.weights.image_noise**2
    white_local = _white_local(local[[response.frame for response in responses]], kappa, c)
    parts, fields, channels, local_columns = [], [], [], []
    for t, (response, share) in enumerate(zip(responses, shares, strict=True)):
        root = np.sqrt(kappa[t])
        pushed = np.einsum("nij,ni->nj", back[t], still_q.reshape(len(nodes), -1)).ravel()  # B^T
        q, rb = (share.q - c * pushed) / root, (share.rb - c * still_rb) / root
        columns, rows = global_columns(context, response), channel_equations(context, response)
        local_columns.append(view.at(response.frame).columns(nodes, response.u, response.local_du))
        parts.append(_part(share, q, rb, rows, local_columns[-1], white_local[t], seen, context, inverse_variance))
        fields.append(columns[seen])
        channels.append(rows.d_global)
    names = ()
    if light and view.kind == GREY and experiment.points is None:
        basis = pixel_basis(context)
        names = basis.names
        pixels = pixel_parts(context, basis, maps, kappa, shared, c, back, seen, local_columns)
        parts = [replace(part, pixel=pixel) for part, pixel in zip(parts, pixels, strict=True)]
    evidence = Evidence(np.array(maps.frames), seen, kappa, back,
                        context.weights.channel_noise**-2.0, chi2 * inverse_variance,
                        sum(share.n_valid for share in shares), tuple(parts), names, n_images)
    return ResidualEvidence(evidence, Columns(context.names, np.array(fields), np.array(channels)),
                    np.array([r.u for r in responses]), np.array([r.channels for r in responses]), context, view,
                    shared)


def _white_local(local: np.ndarray, kappa: np.ndarray, c: float) -> np.ndarray:
    """Present values of the frames' own unknowns as white frames hold them  # (T, m)

    Like every field: a grip that is off in the same way in all frames is off by less in each white one, and so is its
    distance from the prior.
    """
    shared = (local / kappa[:, None]).sum(axis=0)
    return (local - c * shared) / np.sqrt(kappa)[:, None]


def _part(share: NodalEquations, q, rb, rows, local_columns, local, seen, context, inverse_variance) -> FrameEvidence:
    """Weights, right-hand sides and the frame's own unknowns: first the local ones, then brightness."""
    A = sparse.csr_array(share.H[seen][:, seen]) * inverse_variance
    weight = context.weights.channel_noise**-2.0
    local_columns, hb = local_columns[seen], share.hb[seen].toarray()
    m, nb, n_seen = local_columns.shape[1], hb.shape[1], len(seen)
    border = np.zeros((n_seen + len(weight), m + nb))
    border[:n_seen, :m] = A @ local_columns
    border[:n_seen, m:] = hb * inverse_variance
    border[n_seen:, :m] = weight[:, None] * rows.d_local
    inner = np.zeros((m + nb, m + nb))
    inner[:m, :m] = local_columns.T @ border[:n_seen, :m] + rows.d_local.T @ border[n_seen:, :m]
    inner[:m, :m] += context.local_precision
    inner[:m, m:] = local_columns.T @ border[:n_seen, m:]
    inner[m:, :m] = inner[:m, m:].T
    inner[m:, m:] = share.bb * inverse_variance
    q, channel_q = q[seen] * inverse_variance, weight * rows.residual
    inner_q = np.concatenate([local_columns.T @ q + rows.d_local.T @ channel_q - context.local_precision @ local,
                              rb * inverse_variance])
    light = _light(share.bb, rb, context.experiment.noise.std_gv)
    return FrameEvidence(A, q, channel_q, border, np.linalg.pinv(inner, hermitian=True), inner_q, light=light)


def _light(bb: np.ndarray, rb: np.ndarray, std_gv: float) -> float:
    """What a white frame's own gain, offset and blur explain of its grey values, less their number.

    Their columns are smooth: the low-pass of the images takes nothing off the noise of these sums.
    """
    if not len(rb):
        return 0.0
    return float(rb @ np.linalg.pinv(bb, hermitian=True) @ rb) / std_gv**2 - np.linalg.matrix_rank(bb, hermitian=True)


class _ResidualMaps:
    """Residual and validity of every pixel, frame by frame; kept for a second look where memory allows."""

    def __init__(self, context: CorrelationContext, frames: list[int], motions: list[np.ndarray]):
        self.context, self.frames, self.motions = context, frames, motions
        self.kept: dict[int, tuple[np.ndarray, np.ndarray]] = {}

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, t: int) -> tuple[np.ndarray, np.ndarray]:
        """r (n_pixels,) GV and valid (n_pixels,) of the t-th frame."""
        if t in self.kept:
            return self.kept[t]
        found = self.context.reference.compare_pixels(self.context.experiment, self.frames[t], self.motions[t],
                                                      np.zeros(0))
        if found.r.nbytes * len(self) < MAX_KEPT_BYTES:
            self.kept[t] = found.r, found.valid
        return found.r, found.valid


def _shared_residual(maps: _ResidualMaps, kappa: np.ndarray, n_images: int) -> tuple[np.ndarray, float]:
    """R per pixel (0 where a pixel was ever lost) and the white sum of squares r^T V^-1 r sigma^2."""
    total, squares, lost = None, None, None
    for t, k in enumerate(kappa):
        r, valid = maps[t]
        r = r.astype(float)
        if total is None:
            total, squares, lost = np.zeros(len(r)), np.zeros(len(r)), np.zeros(len(r), dtype=bool)
        total += r / k
        squares += r**2 / k
        lost |= ~valid
    total[lost] = 0.0
    weight = float(np.sum(1.0 / kappa))
    return total, float(squares.sum() - (total**2).sum() / (n_images + weight))


def _seen_dofs(share: NodalEquations) -> np.ndarray:
    return np.flatnonzero(share.H.diagonal() > 0.0)
