"""Input that is readable but probably wrong: values far from typical ones, a scale off by ten, a ROI on the
background."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy

from idic.fe import Mesh, bodies
from idic.images import BLOCK_PX, compressed_at, edge_blur
from idic.laws import law_for
from idic.model import Experiment, Model, Remedies
from idic.windows import window_any, window_mean

MAX_FROM_TYPICAL = 200.0    # ratio of a stress-like value to the typical one of its law; GPa read as MPa is 1000
MIN_VISIBLE = 0.5           # of the elements: with fewer, scale or origin is suspect
MIN_LARGER = 1.3            # mesh over image, in both directions
MIN_EXTENT = 0.1            # of the image, in both directions
MIN_SPECKLE_PX, MAX_SPECKLE_PX = 2.0, 15.0  # width of the autocorrelation; the guide of good practice asks for 3 to 5
MAX_EDGE_BLUR_PX = 1.7      # six real and rendered recordings in focus: at most 0.9; blurred by 3 px: at least 1.88
WINDOW_PX = 15              # of a local standard deviation: three speckles, two coarse ones
MAX_WINDOW_PX = 31          # where background makes the speckle look wider than it is
MAX_PLAIN_SHARE = 0.1       # of the ROI without pattern
MIN_HOLE_SHARE = 0.02       # of the ROI, without pattern in one place: a hole that the mesh covers
MIN_HOLE_FILL = 0.6         # of its bounding box; a circle fills 0.79, a scratch or a rim less
PLAIN = 0.2                 # of the usual local standard deviation: less is no pattern
MAX_FIRST_FORCE = 0.02      # of the range of a force: a larger one at the reference frame is a load
MIN_SLENDERNESS = 1e-5      # thickness over length of a sheet: a film of 1 um over 0.1 m
SAME_PLACE = 1e-7           # of the size of a mesh: nodes that are closer were one
NO_PATTERN = np.zeros(1, dtype=bool)


def start_values(model: Model) -> tuple[str, ...]:
    """Of every free parameter ``" from 70 GPa"``: its start value in the user's unit."""
    texts = []
    for name in model.parameters.free:
        parameter = model.parameters[name]
        texts.append(f" from {parameter.value / parameter.factor:.6g} {parameter.unit}".rstrip())
    return tuple(texts)


def implausible_values(model: Model) -> Iterator[str]:
    """Moduli and strengths that differ from the typical ones of their law by orders of magnitude.

    The laws of an external solver are its own: nothing is known of them.
    """
    for material in model.materials if model.solver is None else ():
        parameters = {name.removeprefix(f"{material.element_set}."): p for name, p in model.parameters.items()
               if name.startswith(f"{material.element_set}.")}
        for declared in law_for(material.law, parameters).parameters:
            parameter = parameters.get(declared.name)
            if parameter is None or declared.unit != "MPa" or not declared.default or not parameter.value > 0.0:
                continue
            ratio = parameter.value / declared.default
            if not 1.0 / MAX_FROM_TYPICAL < ratio < MAX_FROM_TYPICAL:
                large = declared.default >= 1.0
                typical = f"{declared.default:,.0f}".replace(",", " ") if large else f"{declared.default:g}"
                yield (f"{parameter.name} = {parameter.value:.6g} MPa; typical of {material.law}: {typical} MPa. "
                       "Check its unit; if the value is intended, do nothing")




def sums_of_all_reactions(model: Model) -> Iterator[str]:
    """Forces of node sets that hold every driven node: in equilibrium all reactions together are zero."""
    if model.loads or model.solver is not None:
        return
    sets = model.mesh.node_sets
    for channel in model.channels:
        driven = [sets[condition.nodes] for condition in model.prescribed
                  if condition.component == channel.component]
        if channel.kind == "reaction" and driven and np.isin(np.concatenate(driven), sets[channel.nodes]).all():
            yield (f"{channel.column}: {channel.nodes} holds every node that is moved or held along "
                   f"{channel.component}, and all reactions together are zero: name the set at one end, as reaction = "
                   '"RIGHT"')


def loaded_reference(experiment: Experiment) -> Iterator[str]:
    """Forces at the reference frame, where the simulation has none, unless their offset is identified."""
    model = experiment.model
    for channel in model.channels if not model.loads else ():
        counted = [k for k in range(model.n_frames) if k not in experiment.recording.excluded]
        force, start = channel.values[counted], float(channel.values[model.reference])
        offset = f"channel.{channel.column}.offset"
        offset_parameter = model.parameters.get(offset)
        corrected = offset_parameter is not None and (offset_parameter.free or offset_parameter.value != 0.0)
        least = max(MAX_FIRST_FORCE * float(np.ptp(force)), 5.0 * (channel.noise_std or 0.0))
        if channel.kind == "reaction" and not corrected and abs(start) > least:
            factor = channel.shown_factor
            yield (f"{channel.column} is {start / factor:.4g} {channel.shown_unit} at the reference frame, where the "
                   "simulation has no load. A pre-load: take an image before it as the reference. A load cell that was "
                   f"not set to zero: {offset} under [[dof]]")


def separate_pieces(mesh: Mesh, unit: str) -> Iterator[str]:
    """Bodies of a mesh that share no node although nodes of theirs lie at the same place."""
    n_pieces, piece = bodies(mesh)
    if n_pieces < 2:
        return
    size = np.ptp(mesh.nodes, axis=0).max()
    _, place = np.unique(np.round((mesh.nodes - mesh.nodes.min(axis=0)) / (SAME_PLACE * size)), axis=0,
                         return_inverse=True)
    order = np.lexsort((piece, place.ravel()))
    double = np.flatnonzero((np.diff(place.ravel()[order]) == 0) & (np.diff(piece[order]) != 0))
    if len(double):
        coordinates = ", ".join(f"{axis} {x:.4g}" for axis, x in zip("xyz", mesh.nodes[order[double[0]]], strict=False))
        yield (f"the mesh has {n_pieces} pieces that share no node, with {len(double)} pairs of nodes at the same "
               f"place (the first at {coordinates} {unit}): no force passes between them. Merge these nodes in the "
               "mesh generator")


def implausible_scale(experiment: Experiment, extent_px: np.ndarray, visible: float,
                      part: bool = False) -> Iterator[str]:
    """A mesh much larger or smaller than the image.

    Parameters
    ----------
    experiment : Experiment
        The view of the camera.
    extent_px : array (2,)
        Columns and rows that the mesh spans.
    visible : float
        Share of the elements that lie in the image.
    part : bool
        Whether the camera sees a part of the specimen on purpose: an end in view is measured.
    """
    image = np.array(experiment.recording.image_shape[::-1], dtype=float)
    size = f"the mesh spans {extent_px[0]:.0f} x {extent_px[1]:.0f} px, the image {image[0]:.0f} x {image[1]:.0f} px"
    larger = float((extent_px / image).max())
    remedies = Remedies(experiment)
    scale, place, unit = remedies.scale, remedies.place, remedies.possible(", or mesh_unit is wrong")
    mirrored = ", or an axis is mirrored" if remedies.can_have("axes") else ""
    fits_turned = bool((extent_px > image).any() and (extent_px[::-1] <= image).all())
    is_turned = remedies.can_have("axes") and fits_turned
    if visible < MIN_VISIBLE and is_turned:
        yield (f"{size}; {100.0 * visible:.0f} % of its elements are seen, turned by 90 degrees it would fit: the two "
               "entries of axes may be exchanged")
    elif visible < MIN_VISIBLE:
        yield (f"{size}; {100.0 * visible:.0f} % of its elements are seen: " + (
            f"{scale} may be {larger:.1f} times too small{unit}" if larger > 1.5 else
            f"{place} may place it outside the image{mirrored}"))
    elif not part and (extent_px > MIN_LARGER * image).all():
        yield (f"{size}; {100.0 * visible:.0f} % of its elements are seen: {scale} may be too small{unit}. "
               "If the camera sees only a part on purpose, do nothing")
    elif (extent_px < MIN_EXTENT * image).all():
        yield f"{size}: {scale} may be too large (by ten?){unit}"


def pattern_warnings(experiment: Experiment, image: np.ndarray, roi: np.ndarray, pixels_per_element: float,
                     width: float | None, plain: np.ndarray) -> Iterator[str]:
    """A ROI that covers background or grips, and speckle too fine or too coarse for the pixels and elements.

    experiment : the view of the camera; width : of the speckle, px; plain : of `without_pattern`
    """
    noise_gv = experiment.recording.noise.std_gv
    if plain is NO_PATTERN:
        return  # told elsewhere
    if plain.mean() > MAX_PLAIN_SHARE:
        rows, columns = (at[plain] for at in np.nonzero(roi))
        yield (f"{100.0 * plain.mean():.0f} % of the ROI has no pattern (around column {np.median(columns):.0f}, row "
               f"{np.median(rows):.0f}): background or grips? Then the mesh is larger than the specimen or misplaced "
               f"({Remedies(experiment).place}): look at the picture"
               + Remedies(experiment).possible("; a mask leaves out what cannot be compared"))
    else:
        yield from covered_holes(experiment, roi, plain)
    yield from compression_warning(image)
    if width is not None and width < MIN_SPECKLE_PX:
        yield (f"the speckle is {width:.1f} px wide, too fine for the pixels: interpolation errors bias the result. "
               "Coarser speckle or a closer camera next time"
               + Remedies(experiment).possible("; now lowpass_px = 1 under [options]"))
        return
    blur = edge_blur(image, roi, noise_gv or 0.0)
    if blur is not None and blur > MAX_EDGE_BLUR_PX:
        yield (f"the edges of the speckle are blurred over {blur:.1f} px (standard deviation; in focus at most 0.9): "
               "the image is out of focus, or the pattern is soft. Error bars are large; focus next time, now larger "
               "elements")
    elif width is not None and width > min(MAX_SPECKLE_PX, np.sqrt(pixels_per_element)):
        yield (f"the speckle is {width:.0f} px wide, an element {np.sqrt(pixels_per_element):.0f} px: few edges carry "
               "the motion, so error bars are large. Finer speckle next time; now larger elements")


def compression_warning(image: np.ndarray) -> Iterator[str]:
    """A reference image that JPEG has compressed, whatever file holds it now."""
    if (at := compressed_at(image)) is not None:
        yield (f"the images were compressed as JPEG (blocks of {BLOCK_PX} px from column {at[1]}, row {at[0]} of the "
               "reference on): fine grey values are lost, and the images blur as the pattern moves. Take the TIFF or "
               "PNG of the camera")


def covered_holes(experiment: Experiment, roi: np.ndarray, plain: np.ndarray) -> Iterator[str]:
    """Round or square places without pattern inside the ROI.

    Parameters
    ----------
    roi : (ny, nx) bool
    plain : (n_roi,) bool, its pixels without pattern
    """
    plain_pixels = np.zeros(roi.shape, dtype=bool)
    plain_pixels[roi] = plain
    if plain.sum() <= MIN_HOLE_SHARE * roi.sum():  # no part of them is a hole
        return
    places, _ = scipy.ndimage.label(plain_pixels)
    for number, box in enumerate(scipy.ndimage.find_objects(places), start=1):
        inside = places[box] == number
        rows, columns = box
        around = roi[max(rows.start - 1, 0):rows.stop + 1, max(columns.start - 1, 0):columns.stop + 1]
        if inside.sum() > MIN_HOLE_SHARE * roi.sum() and inside.mean() > MIN_HOLE_FILL and around.all():
            yield (f"the mesh covers a place of {columns.stop - columns.start} x {rows.stop - rows.start} px without "
                   f"pattern (around column {(columns.start + columns.stop) // 2}, row "
                   f"{(rows.start + rows.stop) // 2}): a hole? The simulation has material there. Give the mesh the "
                   f"hole{Remedies(experiment).possible(' (holes_px)', ' (holes_mm)')}"
                   + Remedies(experiment).possible("; if there is none, a mask leaves the place out"))


def without_pattern(image: np.ndarray, roi: np.ndarray, noise_gv: float | None, width: float | None) -> np.ndarray:
    """Pixels of the ROI in a window in which the grey value hardly changes; `NO_PATTERN` where it nowhere does

    width : of the speckle, px

    Returns
    -------
    (n_roi,) bool
    """
    values = np.asarray(image, dtype=float)
    window = int(np.clip(2.0 * (width or 0.0), WINDOW_PX, MAX_WINDOW_PX))
    mean, square = window_mean(values, window), window_mean(values**2, window)
    local = np.sqrt(np.maximum(square - mean**2, 0.0))[roi]
    usual = float(np.percentile(local, 75)) if len(local) else 0.0
    if not usual > 3.0 * (noise_gv or 0.0) or usual == 0.0:
        return NO_PATTERN
    middle = np.zeros(values.shape, dtype=bool)
    middle[roi] = local < max(PLAIN * usual, 1.5 * (noise_gv or 0.0))
    return window_any(middle, window)[roi]


def implausible_thickness(model: Model) -> Iterator[str]:
    """A plane body as thick as it is long, or far thinner than any foil, has its thickness in another unit."""
    if model.kind != "plane_stress" or model.thickness is None or model.length_unit == "px":
        return
    length = float(np.ptp(model.mesh.nodes, axis=0).max())
    if not MIN_SLENDERNESS * length <= model.thickness <= length:
        yield (f"the thickness is {model.thickness:g} mm, and the mesh is {length:.3g} mm long: a sheet in plane "
               "stress is thinner than long, and a film of 1 um over 0.1 m is thicker. Forces, and so moduli, are off "
               "by the factor of a wrong unit")
