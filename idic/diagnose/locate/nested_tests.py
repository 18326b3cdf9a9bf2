"""Which side is wrong, before any physics is named: how much nested freedoms explain, each with its exact rank.

    level      freed besides the identified parameters, in every frame (or over windows of frames)
    force      nothing but the channels: they no longer count
    camera     what the camera can do by itself
    boundary   smooth motion of the driven edges, the law kept
    bulk       any smooth motion (hats of the image)
    light      gain and offset of every patch of the image

With freed fields P and identified columns J in one white frame-by-frame problem, the drop of chi-square is

    sum_w rhs_w^T M_w^+ rhs_w + b'^T G'^+ b' - b^T G^+ b,    G' = G - sum_w C_w^T M_w^+ C_w,  C = P^T J

and under mere noise it is chi-square distributed with as many degrees of freedom as fields that pixels can see, less
those that the identified parameters had already. Kinematic levels exclude the channels: a free motion has no force.

Any compatible motion could come from an eigenstrain in the bulk. Only the level of the boundary, whose motion obeys the
law, separates the two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse, stats

from idic.diagnose.locate.freedoms import boundary_fields, boundary_patterns, camera_fields
from idic.diagnose.locate.tangents import tangents
from idic.diagnose.residual.evidence import Evidence, FrameEvidence
from idic.diagnose.residual.excess import p_beyond_margin, margin_chi2
from idic.diagnose.residual.heldout import grid_of
from idic.diagnose.residual.margin import ASSUMED, Margin
from idic.diagnose.residual.residual_evidence import ResidualEvidence, residual_evidence
from idic.diagnose.residual.score import NullModel, null_model
from idic.diagnose.residual.subspace import MIN_EIGENVALUE_SHARE, gram_of_fields, hats
from idic.identification import Identification

HAT_SPACING_ELEMENTS = 4.0  # element sizes between the grid points of the free motion
N_WINDOWS = 6  # of frames, for lasting effects
MIN_RESPONSIBLE_SHARE = 0.75  # of the explainable excess that makes a side responsible
MAX_LEVEL_P = 1e-3
KINEMATIC_LEVELS = ("camera", "boundary", "camera+boundary", "bulk")
MIN_IMAGE_INFORMATION = 1e-8  # of its information with channels: less is a parameter that images alone do not show


@dataclass(frozen=True)
class Level:
    """A freedom: drop of chi-square against the identified model, degrees of freedom, and the drop per frame.

    gain, rank : totals, exact; frame_gain : (T,) of each frame alone (identified parameters kept);
    margin : chi-square of a motion that is too small to matter, 0 of what is no motion.
    """

    name: str
    gain: float
    rank: int
    frame_gain: np.ndarray
    margin: float = 0.0

    @property
    def excess(self) -> float:
        """Drop beyond its expectation under noise."""
        return self.gain - self.rank

    @property
    def z(self) -> float:
        return self.excess / np.sqrt(2.0 * max(self.rank, 1))

    @property
    def p(self) -> float:
        """Of noise alone."""
        return float(stats.chi2.sf(self.gain, self.rank)) if self.rank else 1.0

    @property
    def p_margin(self) -> float:
        """Of noise and a motion at the practical margin."""
        return float(p_beyond_margin(self.gain, max(self.rank, 1), self.margin))


@dataclass(frozen=True)
class NestedTests:
    """All levels by name, and the side that they decide.

    levels : camera, boundary, camera+boundary, bulk (these and all hats), force and, where images are grey, light;
    windows : the same for freedoms that stay the same over a window of frames; side : "" where nothing is significant;
    reason : in words.
    """

    levels: dict[str, Level]
    windows: dict[str, Level]
    side: str
    reason: str

    @property
    def p_value(self) -> float:
        """Of noise and a motion at the practical margin doing as much on any level, Bonferroni over the levels."""
        tried = [level.p_margin for levels in (self.levels, self.windows) for level in levels.values()]
        return min(1.0, len(tried) * min(tried)) if tried else 1.0

    def share(self, name: str) -> float:
        """Part of the explainable kinematic excess that a level recovers; nan where there is none."""
        return _share(_kinematic(self.levels, self.windows), name)


def run_nested_tests(identification: Identification, residual: ResidualEvidence, null: NullModel,
                     practical: Margin = ASSUMED) -> NestedTests:
    """Measure every level and decide the side.

    practical : the margin of the recording

    Raises
    ------
    NotConverged
        If a law finds no answer along the path of the identified model.
    """
    evidence = without_channels(residual.evidence)
    parameters = [i for i in range(null.white.n)
                  if null.precision[i, i] > 0.0 or _seen_by_images(residual.evidence, evidence, null, i)]
    images = null_model(evidence, residual.null.pick(parameters))
    fields = _fields(identification, residual)
    sizes = np.cumsum([0, *(f.shape[1] for f in fields[0])])
    sets = {"camera": [0], "boundary": [1], "camera+boundary": [0, 1], "bulk": [0, 1, 2]}
    chosen = {name: np.concatenate([np.arange(sizes[k], sizes[k + 1]) for k in kinds]) for name, kinds in sets.items()}
    joined = [sparse.hstack(f, format="csr") for f in fields]
    normals = [normal(evidence, part, field, images, t)
               for t, (part, field) in enumerate(zip(evidence.parts, joined, strict=True))]
    every = [np.array([t]) for t in range(len(normals))]
    windows = np.array_split(np.arange(len(normals)), min(N_WINDOWS, len(normals)))
    margin = float(margin_chi2(residual.evidence, practical).sum())
    per_frame, per_window = ({name: replace(level(name, normals, groups, members, images), margin=margin)
                              for name, members in chosen.items()} for groups in (every, windows))
    if len(residual.evidence.channel_weight):
        per_frame["force"] = force_level(residual.evidence, null, images, parameters)
    if residual.context.experiment.options.brightness == "frame" and residual.evidence.n_components == 2:
        per_frame["brightness"] = replace(brightness_level(identification, residual), margin=margin)
    experiment = residual.context.experiment
    side, reason = decide(per_frame, per_window,
                          bool(experiment.model.loads) or any(channel.is_load for channel in experiment.model.channels))
    return NestedTests(per_frame, per_window, side, reason)


def _fields(identification: Identification, residual: ResidualEvidence) -> list[tuple]:
    """Camera, boundary and hats of every frame  # T tuples of (n_seen, p_k), sparse"""
    basis = hats(residual.evidence, grid_of(residual, HAT_SPACING_ELEMENTS)).fields
    fields, patterns = [], None
    for tangent in tangents(identification, residual):
        if patterns is None:
            patterns = boundary_patterns(residual.context.experiment.model, tangent.held)
        fields.append((sparse.csr_array(camera_fields(residual, tangent.index)),
                       sparse.csr_array(boundary_fields(residual, tangent, patterns)), basis))
    return fields


@dataclass(frozen=True, eq=False)
class Normal:
    """Normal equations of freed fields in one frame: matrix (p, p), rhs (p,), cross (p, n) with identified columns."""

    matrix: np.ndarray
    rhs: np.ndarray
    cross: np.ndarray


def normal(evidence: Evidence, part: FrameEvidence, fields, null: NullModel, t: int) -> Normal:
    """Of image motions (n_seen, p) in frame t, its frame-local unknowns projected out."""
    n = len(part.q)
    border = np.asarray(fields.T @ part.border[:n])
    matrix = gram_of_fields(part.A, fields) - border @ part.inner @ border.T
    q, _ = evidence.residual(part)
    return Normal(0.5 * (matrix + matrix.T), np.asarray(fields.T @ q), np.asarray(fields.T @ null.weighed.fields[t]))


def level(name: str, normals: Sequence[Normal], groups: Sequence[np.ndarray], members: np.ndarray,
          null: NullModel) -> Level:
    """Free some fields, with one amplitude per group of frames."""
    block = np.ix_(members, members)
    gain, rank, cross_gram, cross_b, gains, ranks = 0.0, 0, 0.0, 0.0, [], []
    for group in groups:
        matrix = sum(normals[t].matrix[block] for t in group)
        rhs = sum(normals[t].rhs[members] for t in group)
        cross = sum(normals[t].cross[members] for t in group)
        root = half_inverse(matrix)  # (p, r)
        y, c = root.T @ rhs, root.T @ cross
        gains.append(float(y @ y))
        ranks.append(root.shape[1])
        cross_gram, cross_b = cross_gram + c.T @ c, cross_b + c.T @ y
    extra, lost = _rest(null, cross_gram, cross_b)
    gain, rank = sum(gains) + extra, sum(ranks) - lost
    return Level(name, gain, rank, np.array(gains))


def _rest(null: NullModel, cross_gram, cross_b) -> tuple[float, int]:
    """Gain of the identified parameters next to freed fields, less their gain alone; ranks that they lose."""
    if not null.white.n:
        return 0.0, 0
    gram = null.gram
    scale = np.sqrt(np.where(np.diagonal(gram) > 0.0, np.diagonal(gram), np.inf))
    values, vectors = np.linalg.eigh((gram - cross_gram) / np.outer(scale, scale))
    good = values > MIN_IMAGE_INFORMATION
    was_good = np.linalg.eigvalsh(gram / np.outer(scale, scale)) > MIN_IMAGE_INFORMATION
    y = vectors[:, good].T @ ((null.b - cross_b) / scale)
    return float((y**2 / values[good]).sum() - null.b @ null.covariance @ null.b), int(was_good.sum() - good.sum())


def half_inverse(matrix: np.ndarray) -> np.ndarray:
    """W with W W^T the inverse of a positive semi-definite matrix over what is seen of it  # (p, rank)"""
    diagonal = np.diagonal(matrix)
    is_seen = diagonal > 1e-9 * max(diagonal.max(initial=0.0), 1e-300)
    scale = np.where(is_seen, 1.0 / np.sqrt(np.where(is_seen, diagonal, 1.0)), 0.0)
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    good = values > MIN_EIGENVALUE_SHARE * max(values.max(initial=0.0), 1e-300)
    return scale[:, None] * vectors[:, good] / np.sqrt(values[good])


def without_channels(evidence: Evidence) -> Evidence:
    """The same with images only: channels weigh nothing, and the frames' own unknowns do not feel them."""
    weight, parts = evidence.channel_weight, []
    for part in evidence.parts:
        n = len(part.q)
        heavy = part.border[n:]  # (n_channels, m) weight times derivative
        matrix = np.linalg.pinv(part.inner, hermitian=True) - heavy.T @ (heavy / weight[:, None])
        border = part.border.copy()
        border[n:] = 0.0
        parts.append(replace(part, border=border, channel_q=np.zeros_like(part.channel_q),
                             inner=np.linalg.pinv(matrix, hermitian=True),
                             inner_q=part.inner_q - heavy.T @ (part.channel_q / weight)))
    return replace(evidence, channel_weight=np.zeros_like(weight), parts=tuple(parts))


def _seen_by_images(evidence: Evidence, images: Evidence, null: NullModel, i: int) -> bool:
    column = null.white.pick([i])
    information = images.products(column, images.weighed(column))[0, 0]
    return information > MIN_IMAGE_INFORMATION * max(evidence.products(column, null.weighed.pick([i]))[0, 0], 1e-300)


def force_level(evidence: Evidence, null: NullModel, images: NullModel, parameters: Sequence[int]) -> Level:
    """Let the channels be free: their contribution beyond that of the identified parameters."""
    channel_residual = np.array([evidence.residual(part)[1] for part in evidence.parts])  # (T, n_channels)
    information = np.array([np.diagonal(_channel_information(evidence, part)) for part in evidence.parts])
    gain = total_chi2(evidence) - total_chi2(without_channels(evidence))
    gain += float(images.b @ images.covariance @ images.b - null.b @ null.covariance @ null.b)
    rank = channel_residual.size - (_rank(null.gram) - _rank(images.gram))
    frame_gain = (channel_residual**2 / np.maximum(information, 1e-300)).sum(axis=1)
    return Level("force", gain, int(rank), frame_gain)


def total_chi2(evidence: Evidence) -> float:
    """Chi-square left by the frames' own unknowns, up to the constant of the images."""
    weight = np.where(evidence.channel_weight > 0.0, evidence.channel_weight, np.inf)
    return float(sum((part.channel_q**2 / weight).sum() - part.inner_q @ part.inner @ part.inner_q
                     for part in evidence.parts))


def _channel_information(evidence: Evidence, part: FrameEvidence) -> np.ndarray:
    heavy = part.border[len(part.q):]
    return np.diag(evidence.channel_weight) - heavy @ part.inner @ heavy.T


def _rank(gram: np.ndarray) -> int:
    if not len(gram):
        return 0
    scale = np.sqrt(np.where(np.diagonal(gram) > 0.0, np.diagonal(gram), np.inf))
    return int((np.linalg.eigvalsh(gram / np.outer(scale, scale)) > MIN_IMAGE_INFORMATION).sum())


def brightness_level(identification: Identification, residual: ResidualEvidence) -> Level:
    """Gain and offset of every patch instead of the whole frame: one more pass over the images, of the same motion."""
    options = replace(identification.experiment.options, brightness="patch")
    patched = residual_evidence(replace(identification, experiment=replace(identification.experiment, options=options)),
                                light=False, responses=residual.responses).evidence
    gains, ranks = [], []
    for fine, coarse in zip(patched.parts, residual.evidence.parts, strict=True):
        gains.append(float(fine.inner_q @ fine.inner @ fine.inner_q - coarse.inner_q @ coarse.inner @ coarse.inner_q))
        ranks.append(np.linalg.matrix_rank(fine.inner, hermitian=True)
                     - np.linalg.matrix_rank(coarse.inner, hermitian=True))
    frame_gain = np.array(gains)
    return Level("brightness", float(frame_gain.sum()), int(np.sum(ranks)), frame_gain)


def _share(levels: dict[str, Level], name: str) -> float:
    room = levels["bulk"].excess
    return levels[name].excess / room if room > 0.0 and name in levels else float("nan")


def _percent(levels: dict[str, Level], name: str) -> str:
    return f"{100.0 * _share(levels, name):.0f} %"


def _kinematic(per_frame: dict[str, Level], per_window: dict[str, Level]) -> dict[str, Level]:
    """The freedoms that see more: new in every frame, or lasting."""
    return max((per_frame, per_window), key=lambda levels: levels["bulk"].z)


def decide(per_frame: dict[str, Level], per_window: dict[str, Level], has_force: bool) -> tuple[str, str]:
    """The side and why, in words.

    A side is responsible if its own freedoms recover most of what any motion could, or leave nothing significant; of
    two such sides the one that does so with fewer degrees of freedom.
    """
    kinematic = _kinematic(per_frame, per_window)
    brightness, force, bulk = per_frame.get("brightness"), per_frame.get("force"), kinematic["bulk"]
    if brightness is not None and brightness.p_margin < MAX_LEVEL_P and brightness.excess > max(bulk.excess, 0.0):
        return "camera", "smooth changes of brightness explain more of the residual than any smooth motion"
    if min(kinematic[name].p_margin for name in KINEMATIC_LEVELS) > MAX_LEVEL_P:
        if force is not None and force.p < MAX_LEVEL_P:
            return "force", ("motions agree within the practical margin, the force does not: force scale, offset or "
                             "drift, the thickness, or a law whose error does not change the motion" if has_force else
                             "motions agree within the practical margin, the readings of the extensometer do not: "
                             "their scale, offset or drift")
        return "", "no level explains more than noise"
    responsible = [name for name in ("camera", "boundary") if _responsible(kinematic, name)]
    if responsible:
        best = max(responsible,
                   key=lambda name: (kinematic[name].excess > 0.9 * max(kinematic[n].excess for n in responsible),
                                             kinematic[name].excess / max(kinematic[name].rank, 1)))
        words = {"camera": "camera motion and distortion recover",
                 "boundary": "free motion of the driven edges recovers"}[best]
        text = f"{words} {_percent(kinematic, best)} of what any smooth motion explains"
        comparisons = [f"; the {name} level recovers {_percent(kinematic, name)} with "
                f"{'more' if kinematic[name].rank > kinematic[best].rank else 'as many or fewer'} degrees of freedom"
                       for name in responsible if name != best]
        return best, text + "".join(comparisons)
    text = ("smooth motion inside the specimen is needed: the driven edges recover "
            f"{_percent(kinematic, 'boundary')}, the camera {_percent(kinematic, 'camera')}")
    return "bulk", text + ("" if has_force else "; no force is logged, so that bulk and boundary are separated by the "
                           "motion of the edges alone")


def _responsible(levels: dict[str, Level], name: str) -> bool:
    if levels[name].p_margin > MAX_LEVEL_P:
        return False
    remainder, rank = levels["bulk"].gain - levels[name].gain, levels["bulk"].rank - levels[name].rank
    return _share(levels,
                  name) > MIN_RESPONSIBLE_SHARE or float(p_beyond_margin(remainder, max(rank, 1),
                                                                         levels["bulk"].margin)) > MAX_LEVEL_P
