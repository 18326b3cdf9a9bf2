"""Notes on a calibration: coverage of the image, tilts, values below their standard deviation, shape of the target."""

from __future__ import annotations

import numpy as np

from idic.calibrate.projection import in_camera_0
from idic.calibrate.records import Calibration, Shape

MIN_COVERAGE = 0.6          # of the image inside the hull of all points: distortion outside is extrapolated
MIN_TILT_DEG = 15.0         # largest angle of the target to the line of sight: focal length from perspective
FEW_VIEWS = 8
UNDETERMINED = 2.0          # standard deviations of a coefficient from zero
MAX_RMS_RATIO = 2.0         # of an image against the median of all
MIN_SHAPE_RATIO = 2.0       # of `shape_error`: 100 points with noise alone stay within 1 +- 0.1
MAX_CONDITION = 1e4         # of the equations of a point: seen from several sides


def shape_error(result: Calibration) -> tuple[float, float]:
    """Mean square of the displacements of target points that minimise the residuals, over that by noise alone, and
    their rms.

    Each point is displaced in space by least squares over all views; with noise alone the ratio is 1.

    Returns
    -------
    ratio : float
    rms_mm : float
    """
    n = len(result.points_mm)
    normal, right = np.zeros((n, 3, 3)), np.zeros((n, 3))
    for pose, views, errors in zip(result.poses, result.views, result.residuals_px, strict=True):
        for c, (view, error) in enumerate(zip(views, errors, strict=True)):
            if view is not None:
                chosen = view.index[:, 0]
                slopes = result.rig.cameras[c].jacobian(in_camera_0(pose, result.points_mm[chosen])) @ pose.rotation
                np.add.at(normal, chosen, np.einsum("nki,nkj->nij", slopes, slopes))
                np.add.at(right, chosen, np.einsum("nki,nk->ni", slopes, error))
    often = np.linalg.cond(normal) < MAX_CONDITION
    if not often.any():
        return 1.0, 0.0
    shift = np.linalg.solve(normal[often], right[often][..., None])[..., 0]
    ratio = np.einsum("ni,ni->n", shift, right[often]).mean() / (3.0 * result.noise_px**2)
    return float(ratio), float(np.sqrt((shift**2).sum(axis=1).mean()))


def notes_on(result: Calibration, target_std_mm: float | None) -> tuple[str, ...]:
    """Sentences with the remedy."""
    notes, rig = [], result.rig
    for camera in range(len(rig.cameras)):
        share = result.coverage(camera)
        if share < MIN_COVERAGE:
            notes.append(f"camera {camera}: the target covers {share:.0%} of the image; distortion and centre outside "
                         f"are "
                         "extrapolated. Show the target in the corners as well, or crop the images to the part in use")
    largest = np.nanmax(result.tilts_deg)
    if largest < MIN_TILT_DEG:
        notes.append(f"the target is tilted by {largest:.0f}° at most: focal length and distance are hardly separated. "
                     "Tilt it by 20 to 40° about both axes")
    n_views = sum(pose is not None for pose in result.poses)
    if n_views < FEW_VIEWS:
        notes.append(f"{n_views} images only: a single bad image would falsify the result, and the scatter between "
                     "views is hardly known. Take 15 to 30")
    stds = rig.std
    for camera, values in enumerate(rig.cameras):
        weak = [name for name in ("k1", "k2", "k3", "p1", "p2") if f"{camera}.{name}" in rig.names
                and abs(getattr(values, name)) < UNDETERMINED * stds[camera].of(name)]
        if weak:
            notes.append(f"camera {camera}: {', '.join(weak)} not different from zero within {UNDETERMINED:g} std; "
                         "without it (--free) the other values are more precise")
    notes += _scatter_notes(result) + _odd_images(result)
    notes += _shape_notes(result, target_std_mm)
    if result.n_left_out:
        notes.append(f"{result.n_left_out} points left out: their residual is beyond six standard deviations")
    return tuple(notes)


def _shape_notes(result: Calibration, target_std_mm: float | None) -> list[str]:
    """How the target differs from what is stated, and what the adjustment makes of it."""
    notes, shape = [], result.shape
    if shape.is_bent:
        z = shape.displacement_mm[:, 2]
        notes.append(f"the target is bent: {_normal_place(shape, int(np.argmax(z)))} and "
                     f"{_normal_place(shape, int(np.argmin(z)))} its mean plane. This shape is identified with the "
                     "cameras, and their standard deviations hold it. Nothing is to be done as long as the bend is the "
                     "same in all images: hold the target without load, or glue it to a stiff plate")
    if shape.is_distorted:
        notes.append(_print_note(result))
    if target_std_mm:
        return notes
    ratio, size_mm = shape_error(result)
    if ratio > MIN_SHAPE_RATIO:
        cause, remedy = "that --target-std 0 states", "leave out --target-std: a bend is then identified"
        if target_std_mm is None:
            each_mm = float(f"{size_mm / np.sqrt(3.0):.1g}")  # in every direction
            cause, remedy = "of a smooth sheet", f"--target-std {each_mm:g} identifies every point"
        notes.append(f"the residuals repeat on the points of the target, as if these lay {size_mm:.2g} mm (rms) off "
                     f"the places {cause}: the standard deviations of the cameras are too small. {remedy}")
    return notes


def _normal_place(shape: Shape, point: int) -> str:
    """How far a point of the target is out of its mean plane, and which it is."""
    (column, row), z, std = shape.index[point], shape.displacement_mm[point, 2], shape.std_mm[point, 2]
    digits = max(0, 1 - int(np.ceil(np.log10(max(std, 1e-9)))))
    return f"column {column}, row {row} is {abs(z):.{digits}f} ± {std:.{digits}f} mm {'behind' if z > 0 else 'before'}"


def _print_note(result: Calibration) -> str:
    """By how much the spacings along both axes differ, and the angle between these."""
    shape = result.shape
    plane = np.column_stack([np.ones(len(shape.index)), result.points_mm[:, :2] - result.points_mm[:, :2].mean(axis=0)])
    slopes = np.linalg.lstsq(plane, shape.displacement_mm[:, :2], rcond=None)[0][1:]
    longer, turn_deg = float(slopes[0, 0] - slopes[1, 1]), float(np.degrees(slopes[0, 1] + slopes[1, 0]))
    direction = "farther apart" if longer > 0.0 else "closer together"
    return (f"the print is distorted: within a row the points are {abs(longer):.2%} {direction} than within a column, "
            f"and rows and columns meet at {90.0 - turn_deg:.3f}°. This is identified with the cameras, and their "
            "standard deviations hold it. --spacing must be the mean of both directions: measure them over the whole "
            "target")


def _scatter_notes(result: Calibration) -> list[str]:
    """What the residual goes with, where it is larger than the scatter of the points within a view."""
    between = result.between
    if not between.all_views.is_significant:
        return []
    sizes = (f"{between.within_px:.2g} px about the best camera for each image alone, {result.noise_px:.2g} px about "
             "one for all")
    ending = "the standard deviations hold this scatter"
    cameras = [c for c, scatter in enumerate(between.by_camera) if scatter.is_significant]
    several = len(between.by_camera) > 1
    if not cameras and between.pairs is not None and between.pairs.is_significant:
        return [f"the residual goes with the pairs alone: each camera by itself fits all its images, both together do "
                f"not ({sizes}). The cameras were not triggered at the same instant, or one of them moved; {ending}. "
                "Trigger them together, hold the target still, and calibrate again"]
    if several and len(cameras) == 1:
        return [f"the residual goes with camera {cameras[0]}: {sizes}; the other camera fits all its images. Its "
                f"focus, aperture or mount changed between the images; {ending}. Lock its lens and calibrate again"]
    return [f"the residual goes with the view: {sizes}. Focus or aperture were touched between the images, the target "
            f"was bent differently, or it moved during the exposure; {ending}. Lock the "
            f"{'lenses' if several else 'lens'}, hold the target still, and calibrate again"]


def _odd_images(result):
    """Images whose rms is far above the usual one."""
    rms = {(v, c): float(np.sqrt((error**2).sum(axis=1).mean())) for v, row in enumerate(result.residuals_px)
           for c, error in enumerate(row) if error is not None}
    usual = float(np.median(list(rms.values())))
    odd = [f"{v} ({f'camera {c}, ' if len(result.rig.cameras) > 1 else ''}{value:.3f} px)"
           for (v, c), value in rms.items()
           if value > MAX_RMS_RATIO * usual]
    return [f"image {', '.join(odd[:6])}: more than twice the usual {usual:.3f} px (counted from 0). Look for blur "
            f"and reflections; leave out bad images"] if odd else []
