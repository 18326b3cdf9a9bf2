"""Axes, signs and scales of the file that contradict the measured motion.

    u(G p) along G d  ~  m        G : a turn by right angles or a mirror image about the mesh origin
    u ~ -m                        another sign of the logged column
    u ~ s m                       another scale
"""

from __future__ import annotations

from itertools import product

import numpy as np

from idic.images import Camera
from idic.model import Remedies
from idic.report.evidence.causes.evidence import MIN_SHARE, MIN_SHARE_WITHOUT_UNKNOWNS, Cause, Evidence
from idic.report.evidence.causes.force_sign import slope_of
from idic.report.evidence.causes.lines import camera_scale, logged_motions, other_axes

MIN_STRETCH, MAX_STRETCH = 0.3, 2.5  # seen over logged motion; between them a machine yields or a grip slips
TURNS = [np.array([[a, 0], [0, b]]) for a, b in ((-1, 1), (1, -1), (-1, -1))]
TURNS += [np.array([[0, a], [b, 0]]) for a, b in product((-1, 1), repeat=2)]
NAMES = ("mirrored along the columns", "mirrored along the rows", "turned by 180 degrees",
         "turned by 90 degrees and mirrored", "turned by 90 degrees", "turned by 90 degrees",
         "turned by 90 degrees and mirrored")
MIN_MOTION_RATIO = 5.0  # of the expected motion, rms, over the noise: with less nothing is compared


def other_sign(evidence: Evidence) -> Cause | None:
    """A logged motion whose sign is that of another convention."""
    columns = logged_motions(evidence.experiment)
    share = evidence.explained(evidence.measured + evidence.expected)
    if not columns or share < MIN_SHARE_WITHOUT_UNKNOWNS or not moves(evidence):
        return None
    names = ", ".join(dict.fromkeys(column.column for column in columns))
    compressed = "".join(f". {channel.column} then has the other sign, too: factor = {-channel.factor:g} in simulated"
                         for channel in evidence.experiment.model.channels
                         if (slope := slope_of(evidence.experiment, channel)) is not None and slope.is_with_it)
    return Cause("sign", share, f"{evidence.source} show a motion against {names}: {evidence.of(share)}; the sign of "
                                f"{names}{Remedies(evidence.experiment).possible(' or of an entry of axes')} is wrong"
                                f"{compressed}")


def exchanged_ends(evidence: Evidence) -> Cause | None:
    """A logged end that stands still while the held one moves, the other way (the strain is right) or the same way."""
    columns = {column.column for column in logged_motions(evidence.experiment)}
    driven = np.abs(evidence.expected_px).max(axis=0) > 0.0
    if len(columns) != 1 or not evidence.sets or not driven.any() or not moves(evidence):
        return None
    along = evidence.directions[driven].mean(axis=0)
    moved = np.outer(evidence.expected[:, driven].mean(axis=1), evidence.directions @ along)
    shares = {text: evidence.explained(misfit) for text, misfit in (
        (f"the ends are exchanged, or an axis is mirrored: look at the sets in the picture"
         f"{Remedies(evidence.experiment).possible(' and at axes')}", evidence.misfit + moved),
        ("the ends are exchanged: the grip that moved is not the one in the model",
         evidence.misfit + 2.0 * evidence.expected - moved))}
    text = max(shares, key=lambda name: shares[name])
    if shares[text] < MIN_SHARE_WITHOUT_UNKNOWNS:
        return None
    return Cause("ends", shares[text], f"the end that {columns.pop()} moves stands still in {evidence.source} and the "
                                       f"held end moves: {evidence.of(shares[text])}; {text}")


def other_axes_of(evidence: Evidence) -> Cause | None:
    """Axes with which the measured motion would be the expected one."""
    camera = evidence.experiment.model.camera
    if not isinstance(camera, Camera) or not moves(evidence):
        return None
    origin = camera.project(np.zeros((1, evidence.experiment.model.mesh.n_dim)))[0]
    best = MIN_SHARE_WITHOUT_UNKNOWNS, -1
    for number, turn in enumerate(TURNS):
        places = origin + (evidence.places_px - origin) @ turn.T
        measured = evidence.measured_at(places, evidence.directions @ turn.T)
        best = max(best, (evidence.explained(measured - evidence.expected), number))
    share, number = best
    if number < 0:
        return None
    return Cause("axes", share, f"the mesh lies {NAMES[number]} on the specimen: {evidence.of(share)}. Look at the "
                                "sets in the picture. Write", other_axes(evidence.experiment, TURNS[number]))


def other_scale(evidence: Evidence) -> Cause | None:
    """A logged motion far larger or smaller than the measured one."""
    size = float((evidence.expected**2).sum())
    columns = logged_motions(evidence.experiment)
    if not size or not columns:
        return None
    relative = evidence.misfit + evidence.expected
    scale = float((relative * evidence.expected).sum()) / size
    share = evidence.explained(relative - scale * evidence.expected)
    if not moves(evidence, max(scale, 1.0)) or share < MIN_SHARE or MIN_STRETCH < scale < MAX_STRETCH or scale <= 0.0:
        return None
    names, camera = ", ".join(dict.fromkeys(column.column for column in columns)), evidence.experiment.model.camera
    pixel = "".join(f"{key}, " for key in ("pixel_size_mm", "mesh_unit") if Remedies(evidence.experiment).possible(key))
    pixel, fitting = pixel.removesuffix(", ") + " or " if pixel else "", ""
    if isinstance(camera, Camera) and Remedies(evidence.experiment).possible("pixel_size_mm"):
        fitting = f" (a pixel of {1.0 / camera_scale(camera) / scale:.4g} mm would fit)"
    return Cause("scale", share, f"the measured motion is {scale:.2g} times that of {names}: {evidence.of(share)}. "
                                 f"{pixel}the unit of {names} may be wrong{', or the grip slips' * (scale < 1.0)}"
                                 f"{fitting}")


def moves(evidence: Evidence, factor: float = 1.0) -> bool:
    """Whether so many times the expected motion is large enough to be compared."""
    return factor * float(np.sqrt((evidence.expected**2).mean())) > MIN_MOTION_RATIO * evidence.noise_px
