"""Local residual test: excess of the residual at the place of a fitted inclusion.

An inclusion explains most of any local compliance: 0.95 of the effect of a cut, with next to no stiffness. The excess
of a wrong inclusion lies at its place, where a local test has more power than a test of the whole specimen. Four cuts
left an excess of 8 to 74 standard deviations at the place, two of them less than 4 in the whole; of four more cuts of
1.2 mm two left 3 at the place. True inclusions, on another mesh and with sharp edges, left -3 to 2.6.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from idic.diagnose.residual.excess import seen_planes
from idic.diagnose.residual.excess_left import MAX_LOCAL_EXCESS_LEFT, ExcessLeft
from idic.diagnose.residual.heldout import Misfit, positions
from idic.diagnose.residual.margin import ASSUMED, Margin
from idic.diagnose.residual.residual_evidence import CameraResidual, ResidualEvidence
from idic.diagnose.residual.subspace import Basis, Grid, explained, hats
from idic.model import Experiment

MAX_LOCAL_SHARE = 0.6  # of all free motions: an inclusion, not the whole specimen


def local_residual_tests(base: ResidualEvidence, enriched: ResidualEvidence, grid: Grid, values: Mapping[str, float],
                         margin: Margin = ASSUMED) -> list[ExcessLeft]:
    """Excess at every new inclusion; one as large as the specimen is judged by the test of the whole.

    Parameters
    ----------
    base, enriched : the whole recording under the identified and the enriched model
    values : of the enriched model, internal units
    margin : of the recording, by region
    """
    excesses = []
    for centre, radius in new_inclusions(base.context.experiment, enriched.context.experiment, values):
        circles = _in_images(base, centre, radius)
        margin_px = float((grid.extent / grid.cells).max())
        # a camera of its own sees other nodes
        fields = [hats(residual.evidence, grid) for residual in (base, enriched)]
        basis_near, still_near = (_near(basis, circles, margin_px) for basis in fields)
        if 0 < basis_near.n < MAX_LOCAL_SHARE * fields[0].n and still_near.n:
            local = margin.local_px(_moved_nodes(base, basis_near))
            excesses.append(ExcessLeft(_fit(base, basis_near), _fit(enriched, still_near), _power(base, basis_near),
                                       MAX_LOCAL_EXCESS_LEFT, local, local if margin.camera_px else 0.0))
    return excesses


def new_inclusions(base: Experiment, enriched: Experiment,
                   values: Mapping[str, float]) -> Iterator[tuple[np.ndarray, float]]:
    """Centre (dim,) and radius, mm, of every inclusion that the identified model lacks."""
    names = {(entry.element_set, entry.name) for entry in base.model.heterogeneities}
    for entry in enriched.model.heterogeneities:
        stem = f"{entry.element_set}.{entry.name}"
        if entry.is_spot and (entry.element_set, entry.name) not in names:
            centre = np.array([values.get(f"{stem}.{axis}", 0.0) for axis in "xyz"[:enriched.model.n_dim]])
            yield centre, float(values[f"{stem}.radius"])


def _in_images(residual: ResidualEvidence, centre: np.ndarray, radius: float) -> list[tuple[np.ndarray, float]]:
    """A circle on the body as every camera sees it: centre (2,) px where `positions` has the camera, radius px."""
    rim = radius * np.eye(len(centre))[:residual.evidence.n_axes]
    points, places, circles = np.vstack([centre, centre + rim, centre - rim]), positions(residual), []
    for camera, nodes in zip(residual.cameras, np.split(places, len(residual.cameras)), strict=True):
        def seen(of_mesh: np.ndarray, camera: CameraResidual = camera) -> np.ndarray:
            return camera.context.camera.project(camera.view.points(of_mesh))

        at = seen(camera.turned(points)) + (nodes - seen(camera.context.experiment.model.mesh.nodes))[0]
        circles.append((at[0], float(np.linalg.norm(at[1:] - at[0], axis=1).max())))
    return circles


def _near(basis: Basis, circles: list[tuple[np.ndarray, float]], margin_px: float) -> Basis:
    """The fields whose hats stand within a circle, or beside one by less than the margin."""
    indices = np.flatnonzero(np.any([np.linalg.norm(basis.places - place, axis=1) < size + margin_px
                                     for place, size in circles], axis=0))
    return Basis(basis.fields[:, indices], basis.places[indices], basis.component[indices])


def _fit(residual: ResidualEvidence, basis: Basis) -> Misfit:
    """Motions alone."""
    explanation, frames = explained(residual.evidence, basis), residual.evidence.frames
    return Misfit(frames, explanation.gain, explanation.rank, np.zeros((len(frames), 0)), float("nan"))


def _moved_nodes(residual: ResidualEvidence, basis: Basis) -> np.ndarray:
    """How much these fields move every node  # (n_nodes,)"""
    evidence = residual.evidence
    moved = np.asarray(abs(basis.fields).sum(axis=1)).ravel()
    return np.bincount(evidence.seen // evidence.n_components, moved, minlength=evidence.back.shape[1])


def _power(residual: ResidualEvidence, basis: Basis) -> float:
    """Chi-square of a motion of one px (rms) of the nodes that these fields move, in all frames."""
    planes, total = seen_planes(residual.evidence), 0.0
    for k in planes:
        moved = np.asarray(basis.fields[:, basis.component == k].sum(axis=1)).ravel()  # 1 within, falling to 0 around
        total += sum(float(moved @ (part.A @ moved)) for part in residual.evidence.parts)
    return total / len(planes)
