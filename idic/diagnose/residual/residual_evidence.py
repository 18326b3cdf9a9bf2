"""From a finished identification to its evidence: its simulation, two passes over the images of every camera.

The second pass is what the reference image's noise costs: R = sum of all residuals must be known before the first
frame can be made white.

Cameras that see grey values are joined: every camera has image dofs of its own, numbered camera by camera, as if the
mesh had as many nodes again; frame-local unknowns of the simulation are common, gain and offset are each camera's own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import sparse

from idic.correlation import (
    CorrelationContext, FrameResponse, GreyReference, NodalEquations, View, ViewKind, VolumeReference, blur_bias,
    build_experiment_reference, camera_at, channel_equations, global_columns, turned_response, view_of,
    with_all_cameras,
)
from idic.diagnose.residual.evidence import Columns, Evidence, FrameEvidence, noise_share
from idic.diagnose.residual.grey_value_effects import (
    grey_image, joined_pixels, pixel_basis, pixel_parts, sums_against,
)
from idic.identification import Identification, Path
from idic.model import MotionError

MAX_KEPT_BYTES = 300e6  # of residual maps, at most
_NO_MATRIX = sparse.csr_array((0, 0))
MAX_LOST_SHARE = 0.5  # of the pixels: where frames lose more, each counts what it sees


@dataclass(frozen=True, eq=False)
class CameraResidual:
    """One camera: camera, reference image and parameters; shared_gv : R per pixel of the map, none of volumes; seen_u :
    (T, n_nodes, dim) mm, the motion when it takes its images, in its axes."""

    context: CorrelationContext
    view: View
    shared_gv: np.ndarray
    seen_u: np.ndarray

    @property
    def grey_values(self) -> np.ndarray:
        """Of the reference image; of a camera that compares them  # (n_pixels,)"""
        return grey_image(self.context).f

    def turned(self, field: np.ndarray) -> np.ndarray:
        """A nodal field of the simulation in the axes of this camera  # (n_nodes, dim, ...)"""
        return self.context.experiment.model.turned(field)


@dataclass(frozen=True, eq=False)
class ResidualEvidence:
    """What the tests start from.

    evidence : the white residual; null : columns of the identified parameters; u : (T, n_nodes, dim) mm; channels :
    (T, n_channels) simulated; cameras : whose images the evidence holds, the main camera first; responses : that were
    simulated, for another copy of the recording; local : (n_frames, m) mm, frame-local unknowns of all frames.
    """

    evidence: Evidence
    null: Columns
    u: np.ndarray
    channels: np.ndarray
    cameras: tuple[CameraResidual, ...]
    responses: tuple[FrameResponse, ...] = ()
    local: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def context(self) -> CorrelationContext:
        """Of the main camera."""
        return self.cameras[0].context

    @property
    def view(self) -> View:
        """Of the main camera."""
        return self.cameras[0].view

    @property
    def solved_u(self) -> np.ndarray:
        """The motion that is in equilibrium on the given mesh: u without a known error  # (T, n_nodes, dim) mm"""
        experiment = self.context.experiment
        u = self.u[..., :experiment.model.n_dim]
        return u if experiment.model.motion_error is None else u - experiment.model.motion_error.u[self.evidence.frames]

    def at_seen(self, of_camera: Callable[[CameraResidual], np.ndarray]) -> np.ndarray:
        """Image fields of all cameras at the seen dofs  # of_camera: (n_components n_nodes, ...) -> (n_seen, ...)"""
        parts = [of_camera(camera) for camera in self.cameras]
        return (parts[0] if len(parts) == 1 else np.concatenate(parts))[self.evidence.seen]


def residual_evidence(identification: Identification, light: bool = True, null: bool = True,
                      responses: Sequence[FrameResponse] | None = None) -> ResidualEvidence:
    """Bring the residual of the accepted point to the nodes; it is simulated once more where its path was not kept.

    light : False leaves out the columns of grey values (`idic.diagnose.residual.grey_value_effects`), which only a
    screening needs
    null : False leaves out the columns of the identified parameters, which a judgement of what is left does not need
    responses : of `simulated`, where the same point has been simulated for another copy of the recording
    """
    contexts = joined_cameras(context_of(identification, null))
    return _assemble(contexts, simulated(identification, null) if responses is None else responses,
                     identification.local, light)


def simulated(identification: Identification, null: bool = True) -> list[FrameResponse]:
    """The accepted point's path in the frames that are compared; null : with its derivatives by the parameters."""
    forward, experiment = identification.forward, identification.experiment.at_geometry(identification.parameters)
    compared = set(experiment.correlated_frames(range(experiment.model.n_frames)))
    if identification.path is not None:
        responses = [response for response in identification.path.frames if response.frame in compared]
        return responses if null else [replace(r, du=r.du[..., :0].copy(), dchannels=r.dchannels[:, :0])
                                       for r in responses]
    moving = tuple(name for name in experiment.model.parameters.free if null and forward.moves(name))
    states = identification.march(moving, forward.drives.n_local > 0)
    return [FrameResponse.of(at, experiment.model.reference) for at in states
            if at.frame + experiment.model.reference in compared]


def path_of(residual: ResidualEvidence, steps: np.ndarray | None) -> Path | None:
    """The simulation behind a residual with the columns of the identified parameters; None where frames are left out.

    steps : its increments, s
    """
    responses, context = residual.responses, residual.context
    first, n_frames = context.experiment.model.reference, context.experiment.model.n_frames
    if steps is None or [response.frame for response in responses] != list(range(first + 1, n_frames)):
        return None
    at_rest = FrameResponse(first, *(np.zeros_like(getattr(responses[0], name)) for name in
                                     ("u", "channels", "du", "dchannels", "local_du", "local_dchannels")))
    return Path(context.parameters.as_values(), residual.local, context.moving, (at_rest, *responses), steps)


def with_error_added(responses: Sequence[FrameResponse], error: MotionError) -> list[FrameResponse]:
    """A simulation without a known error, with it: the motion is added, derivatives are unchanged."""
    changed = []
    for response in responses:
        u, change = response.u.copy(), error.u[response.frame]
        u[:, :change.shape[1]] += change  # a rise of the seen surface has none
        changed.append(replace(response, u=u, channels=response.channels + error.channels[response.frame]))
    return changed


def context_of(identification: Identification, null: bool = True) -> CorrelationContext:
    """Camera, reference image and parameters of a record; null : as for `gather`."""
    forward, parameters = identification.forward, identification.parameters
    experiment = identification.experiment.at_geometry(parameters)
    camera = camera_at(experiment, parameters)
    names = experiment.model.parameters.free if null else ()
    moving = tuple(name for name in names if forward.moves(name))
    return CorrelationContext(experiment, parameters, names, moving, camera, build_experiment_reference(experiment,
                              camera), identification.weights, forward.drives.local_precision)


def joined_cameras(context: CorrelationContext) -> tuple[CorrelationContext, ...]:
    """The contexts of the cameras whose grey values are joined; height images and measured fields stand alone."""
    if not context.experiment.cameras or not _is_grey(context):
        return (context,)
    main, *companions = with_all_cameras(context).cameras
    return (replace(main, others=()), *(camera for camera in companions if _is_grey(camera)))


def _is_grey(context: CorrelationContext) -> bool:
    is_grey = view_of(context.experiment, context.camera).kind == ViewKind.GREY
    return is_grey and context.experiment.recording.points is None


def _at_camera_time(context: CorrelationContext, responses: Sequence[FrameResponse]) -> list[FrameResponse]:
    """The motion when this camera takes its images; the first frame follows the reference, where nothing has moved."""
    experiment, shifted = context.experiment, []
    frame, u = experiment.model.reference, np.zeros_like(responses[0].u)
    for response in responses:
        shifted.append(replace(response, u=experiment.at_camera_time(context.parameters, response.frame, response.u, u,
                                                                     frame)))
        frame, u = response.frame, response.u
    return shifted


class _SeenPart:
    """Rows and columns of the seen dofs of matrices. Frames whose matrices have one pattern share its indices: of a
    volume they are as large as the values."""

    def __init__(self, dofs: np.ndarray):
        self.dofs = dofs
        self.pattern: tuple[np.ndarray, sparse.csr_array] | None = None

    def part(self, H: sparse.csr_array, factor: float) -> sparse.csr_array:
        """Of H, times a factor."""
        pattern = self.pattern
        if pattern is None or pattern[0] is not H.indices:
            numbers = np.arange(H.nnz, dtype=np.int32 if H.nnz < np.iinfo(np.int32).max else np.int64)
            entries = sparse.csr_array((numbers, H.indices, H.indptr), shape=H.shape)
            pattern = self.pattern = H.indices, sparse.csr_array(entries[self.dofs][:, self.dofs])
        places = pattern[1]
        return sparse.csr_array((H.data[places.data] * factor, places.indices, places.indptr), shape=places.shape)


class _CameraPasses:
    """Both passes of one camera over its images: its sums in every frame, and what all frames share."""

    shared: np.ndarray  # set by `share`, as the three that follow
    chi2: float
    still_q: np.ndarray
    still_rb: np.ndarray

    def __init__(self, context: CorrelationContext, responses: Sequence[FrameResponse]):
        experiment, nodes = context.experiment, context.experiment.model.mesh.nodes
        self.context, self.view, self.unturned = context, view_of(experiment, context.camera), responses
        self.responses = [turned_response(experiment.model, response)
                          for response in _at_camera_time(context, responses)]
        self.views = [self.view.at(response.frame) for response in responses]
        motions = [view.motion(nodes, response.u) for view, response in zip(self.views, self.responses, strict=True)]
        self.maps = _ResidualMaps(context, [response.frame for response in responses], motions)
        self.sums = []
        for t in range(len(self.maps)):
            sums = self.maps.compare(t)
            if t == 0:
                self.seen = _seen_dofs(sums)
                self.at_seen = _SeenPart(self.seen)
            self.sums.append(sums if sums.matrix is None else replace(sums, H=_NO_MATRIX))
        self.back = np.array([context.reference.pull_back(equations) for equations in self.sums])
        self.inverse_variance = 1.0 / context.weights.image_noise**2
        self.local_columns = [view.columns(nodes, response.u, response.local_du)
                              for view, response in zip(self.views, self.responses, strict=True)]

    def of_lasting_pixels(self) -> _CameraPasses:
        """The passes over the pixels that all frames show; these ones where there are no others, or too few left."""
        if not any(frame_sums.n_lost for frame_sums in self.sums) or not _is_grey(self.context):
            return self
        lost = np.any([~self.maps[t][1] for t in range(len(self.maps))], axis=0)
        if lost.mean() > MAX_LOST_SHARE:
            return self
        experiment, shows = self.context.experiment, self.context.reference.pixel_map.to_image(~lost, 0.0) > 0.0
        lasting_experiment = replace(experiment, recording=replace(experiment.recording, mask=shows),
                                     options=replace(experiment.options, edge_margin_px=0))
        reference = build_experiment_reference(lasting_experiment, self.context.camera)
        lasting = replace(self.context, experiment=lasting_experiment, reference=reference)
        return _CameraPasses(lasting, self.unturned)

    @property
    def kappa(self) -> np.ndarray:
        """Of the frames  # (T,)"""
        return np.array([share.kappa for share in self.sums])

    def share(self, kappa: np.ndarray) -> None:
        """The residual that all frames have in common."""
        reference, experiment = self.context.reference, self.context.experiment
        if isinstance(reference, VolumeReference):
            chi2, still_q, still_rb = reference.lasting_residual(
                experiment.recording.volumes, self.maps.frames, [sums.motion for sums in self.sums], kappa,
                experiment.options.brightness)
            self.shared, self.chi2, self.still_q, self.still_rb = np.zeros(0), chi2, still_q, still_rb
            return
        self.shared, self.chi2 = _shared_residual(self.maps, kappa, reference.n_images)
        self.still_q, self.still_rb = sums_against(self.context, self.shared)
        if len(self.still_rb) > self._n_brightness:  # the last one is the blur's
            self.still_rb[-1] -= float(np.sum(1.0 / kappa)) * self._blur_of_noise

    @property
    def _blur_of_noise(self) -> float:
        """Expected product of the blur's column with the noise of the reference image, which every residual contains,
        and their sum once for each; it is taken off every frame that is compared (`with_blur` of
        grey images).
        """
        noise = blur_bias(self.context.experiment.recording.noise, self.context.reference)
        return noise * int((self.shared != 0.0).sum())

    @property
    def _n_brightness(self) -> int:
        """Columns of gain and offset of a frame; a blur has one more."""
        brightness = self.context.experiment.options.brightness
        if isinstance(self.context.reference, VolumeReference):
            return self.context.reference.layout(brightness).n_columns
        if not _is_grey(self.context):
            return 0
        return grey_image(self.context).layout(brightness).n_columns

    def weights(self, t: int) -> sparse.csr_array | Callable[[], sparse.csr_array]:
        """H / sigma^2 of a frame at the seen dofs, or what makes it; the sums of the frame hold it no longer."""
        sums, at_seen, inverse_variance = self.sums[t], self.at_seen, self.inverse_variance
        self.sums[t] = replace(sums, H=_NO_MATRIX, matrix=None)
        matrix = sums.matrix
        if matrix is None:
            return at_seen.part(sums.H, inverse_variance)
        return lambda: at_seen.part(matrix(), inverse_variance)

    def white(self, t: int, root: float, c: float) -> tuple[np.ndarray, np.ndarray]:
        """Right-hand sides of the nodes and of brightness in a white frame."""
        n_nodes = len(self.context.experiment.model.mesh.nodes)
        pushed = np.einsum("nij,ni->nj", self.back[t], self.still_q.reshape(n_nodes, -1)).ravel()  # B^T
        return (self.sums[t].q - c * pushed) / root, (self.sums[t].rb - c * self.still_rb) / root


def _assemble(contexts: Sequence[CorrelationContext], responses: Sequence[FrameResponse], local: np.ndarray,
              light: bool) -> ResidualEvidence:
    passes = [_CameraPasses(context, responses).of_lasting_pixels() for context in contexts]
    main, context = passes[0], passes[0].context
    # cameras differ in it by some per cent of one tenth
    kappa = main.kappa if len(passes) == 1 else np.mean([camera.kappa for camera in passes], axis=0)
    for camera in passes:
        camera.share(kappa)
    n_images = context.reference.n_images
    c = noise_share(kappa, n_images)
    first = np.cumsum([0, *(camera.sums[0].q.size for camera in passes)])
    dofs = np.concatenate([start + camera.seen for start, camera in zip(first, passes, strict=False)])
    white_local = _white_local(local[[response.frame for response in responses]], kappa, c)
    parts, fields, channels = [], [], []
    for t, response in enumerate(responses):
        rows = channel_equations(context, response)
        parts.append(_part(passes, t, np.sqrt(kappa[t]), c, rows, white_local[t]))
        fields.append(np.concatenate([global_columns(camera.context, camera.responses[t])[camera.seen]
                                      for camera in passes]))
        channels.append(rows.d_global)
    names = ()
    if light and main.view.kind == ViewKind.GREY and context.experiment.recording.points is None:
        bases = [pixel_basis(camera.context) for camera in passes]
        pixel_columns = [pixel_parts(camera.context, basis, camera.maps, kappa, camera.shared, c, camera.back,
                                     camera.seen, camera.local_columns)
                         for camera, basis in zip(passes, bases, strict=True)]
        names, pixels = joined_pixels(bases, pixel_columns, local.shape[1])
        parts = [replace(part, pixel=pixel) for part, pixel in zip(parts, pixels, strict=True)]
    evidence = Evidence(np.array(main.maps.frames), dofs, kappa,
                        np.concatenate([camera.back for camera in passes], axis=1),
                        context.weights.channel_noise**-2.0,
                        sum(camera.chi2 * camera.inverse_variance for camera in passes),
                        sum(share.n_valid for camera in passes for share in camera.sums), tuple(parts), names, n_images,
                        context.parameters, 3 if isinstance(context.reference, VolumeReference) else 2)
    return ResidualEvidence(evidence, Columns(context.names, np.array(fields), np.array(channels)),
                    np.array([r.u for r in responses]), np.array([r.channels for r in responses]),
                    tuple(CameraResidual(camera.context, camera.view, camera.shared,
                                         np.array([response.u for response in camera.responses]))
                                  for camera in passes),
                            tuple(responses), local)


def _white_local(local: np.ndarray, kappa: np.ndarray, c: float) -> np.ndarray:
    """Present values of the frames' own unknowns as white frames hold them  # (T, m)

    Like every field: a grip that is off in the same way in all frames is off by less in each white one, and so is its
    distance from the prior.
    """
    shared = (local / kappa[:, None]).sum(axis=0)
    return (local - c * shared) / np.sqrt(kappa)[:, None]


def _part(passes: Sequence[_CameraPasses], t: int, root: float, c: float, rows, local: np.ndarray) -> FrameEvidence:
    """Weights, right-hand sides and the frame's own unknowns: first the local ones, then brightness, by cameras."""
    context = passes[0].context
    weight = context.weights.channel_noise**-2.0
    m, n_light = len(local), [camera.sums[t].hb.shape[1] for camera in passes]
    sizes = [len(camera.seen) for camera in passes]
    n_seen, size = sum(sizes), m + sum(n_light)
    border, inner, q, inner_q = np.zeros((n_seen + len(weight), size)), np.zeros((size, size)), [], np.zeros(size)
    border[n_seen:, :m] = weight[:, None] * rows.d_local
    weights_of: list[sparse.csr_array | Callable[[], sparse.csr_array]] = []
    row, column, light = 0, m, 0.0
    for camera, n, nb in zip(passes, sizes, n_light, strict=True):
        share, dofs, local_columns = camera.sums[t], camera.seen, camera.local_columns[t][camera.seen]
        weights_of.append(camera.weights(t))
        at, levels = slice(row, row + n), slice(column, column + nb)
        right, bright = camera.white(t, root, c)
        if m:
            border[at, :m] = _matrix(weights_of[-1]) @ local_columns
        border[at, levels] = share.hb[dofs].toarray() * camera.inverse_variance
        q.append(right[dofs] * camera.inverse_variance)
        inner[:m, :m] += local_columns.T @ border[at, :m]
        inner[:m, levels] = local_columns.T @ border[at, levels]
        inner[levels, :m] = inner[:m, levels].T
        inner[levels, levels] = share.bb * camera.inverse_variance
        inner_q[:m] += local_columns.T @ q[-1]
        inner_q[levels] = bright * camera.inverse_variance
        light += _light(camera.context, share.bb, bright)
        row, column = row + n, column + nb
    inner[:m, :m] += rows.d_local.T @ border[n_seen:, :m]
    inner[:m, :m] += context.local_precision
    channel_q = weight * rows.residual
    inner_q[:m] += rows.d_local.T @ channel_q - context.local_precision @ local
    weights = weights_of[0]
    if len(weights_of) > 1:
        weights = sparse.csr_array(sparse.block_diag([_matrix(camera_weights) for camera_weights in weights_of],
                                                     format="csr"))
    return FrameEvidence(weights, np.concatenate(q), channel_q, border, np.linalg.pinv(inner, hermitian=True), inner_q,
                         light=light)


def _matrix(weights: sparse.csr_array | Callable[[], sparse.csr_array]) -> sparse.csr_array:
    return weights() if callable(weights) else weights


def _light(context: CorrelationContext, bb: np.ndarray, rb: np.ndarray) -> float:
    """What a white frame's light from place to place and its blur explain of its grey values beyond a gain and an
    offset of the whole frame, less their number.

    Every model has those two: what they explain of a lamp that flickers grows with the pixels that a model looks at.
    Their columns are smooth: the low-pass of the images takes nothing off the noise of these sums.
    """
    if not len(rb) or not _is_grey(context):  # of a field they are motions of the frame along the normal
        return 0.0
    layout = grey_image(context).layout(context.experiment.options.brightness)
    frame_columns, end = np.zeros((len(rb), 2)), layout.n_columns
    frame_columns[:end:2, 0], frame_columns[1:end:2] = 1.0, np.column_stack([layout.mean[:end // 2], np.ones(end // 2)])
    systems, gains = [(bb, rb), (frame_columns.T @ bb @ frame_columns, frame_columns.T @ rb)], []
    for matrix, rhs in systems:
        gains.append(float(rhs @ np.linalg.pinv(matrix, hermitian=True) @ rhs)
                     / context.experiment.recording.noise.std_gv**2
                     - np.linalg.matrix_rank(matrix, hermitian=True))
    return gains[0] - gains[1]


class _ResidualMaps:
    """Residual and validity of every pixel, frame by frame; kept for a second look where memory allows."""

    def __init__(self, context: CorrelationContext, frames: list[int], motions: list[np.ndarray]):
        self.context, self.frames, self.motions = context, frames, motions
        self.kept: dict[int, tuple[np.ndarray, np.ndarray]] = {}

    def __len__(self) -> int:
        return len(self.frames)

    def compare(self, t: int) -> NodalEquations:
        """The nodal equations of the t-th frame; its residual is kept from the same look."""
        reference, at = self.context.reference, (self.context.experiment, self.frames[t], self.motions[t])
        if not isinstance(reference, GreyReference) or len(self) * 4 * len(reference.f) >= MAX_KEPT_BYTES:
            return reference.compare(*at)
        equations, pixels = reference.compare_with_residual(*at)
        self.kept[t] = pixels.r, pixels.valid
        return equations

    def __getitem__(self, t: int) -> tuple[np.ndarray, np.ndarray]:
        """r (n_pixels,) GV and valid (n_pixels,) of the t-th frame."""
        if t in self.kept:
            return self.kept[t]
        r, valid = self._looked_at(t)
        if r.nbytes * len(self) < MAX_KEPT_BYTES:
            self.kept[t] = r, valid
        return r, valid

    def _looked_at(self, t: int) -> tuple[np.ndarray, np.ndarray]:
        pixels = self.context.reference.compare_pixels(self.context.experiment, self.frames[t], self.motions[t],
                                                       np.zeros(0))
        return pixels.r, pixels.valid


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
