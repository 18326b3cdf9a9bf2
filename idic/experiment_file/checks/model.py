"""Checks before the simulation: every element has a law, every body is supported, the camera sees the mesh."""

from __future__ import annotations

import numpy as np

from idic.errors import InputError
from idic.fe import EXTERNAL, FreePart, Mesh, PerMesh, bodies, dofs_of, free_parts
from idic.images import AnyCamera, LensCamera, PlacedCamera, gap_mark
from idic.laws import LawSpec, get_law
from idic.model import Experiment, Material, Prescribed
from idic.readers import parse_unit

_MIN_FACE_ON = 1e-6  # of the mean area of a face: less is seen edge-on
_FRAMES_LOOKED_AT = 5
_MIN_LARGER = 2.0  # mesh over image, in both directions: the scale is wrong, whatever the place


def check_materials(mesh: Mesh, element_sets: list[str], file) -> None:
    """InputError unless every element belongs to exactly one of the sets."""
    count = np.zeros(mesh.n_elements, dtype=int)
    for name in element_sets:
        count[mesh.element_sets[name]] += 1
    several = "let one material fill several: sets = [...], or [material.ALL]"
    for bad, fault, remedy in ((count == 0, "elements without a material",
                                f"add a [material.SET] table for their set, or {several}"),
                               (count > 1, "elements with two materials", "give each element set one material")):
        if bad.any():
            labels = mesh.element_labels[bad]
            raise InputError(fault, file=file, key="material",
                             expected="every element in one of " + ", ".join(element_sets),
                             found=f"{bad.sum()} elements: {_first_labels(labels)}", remedy=remedy)


def check_supported(mesh: Mesh, prescribed: list[Prescribed], file) -> None:
    """InputError if a piece of the mesh can still move as a rigid body.

    The rigid motions of every part are excluded by its prescribed degrees of freedom, and by the nodes that it shares
    with other parts.
    """
    dim = mesh.n_dim
    dofs = np.concatenate([dofs_of(mesh.node_sets[entry.nodes], entry.component, dim) for entry in prescribed]
                          + [np.zeros(0, dtype=np.int64)])
    for part in free_parts(mesh, np.unique(dofs)):
        label, n_pieces = mesh.node_labels[part.nodes[0]], bodies(mesh)[0]
        piece = (f"the piece around node {label} ({len(part.nodes)} nodes)" if n_pieces > 1 or part.hangs
                 else "the body")
        pieces = f"; the mesh is in {n_pieces} pieces" if n_pieces > 1 else ""
        joint = "; it hangs on the rest by single nodes, not by whole faces of elements" if part.hangs else ""
        double = " (nodes that should be shared may be double)" if n_pieces > 1 or part.hangs else ""
        raise InputError("an unconstrained body", file=file, key="boundary",
                         found=f"{piece} can {_motion(part, dim)}{pieces}{joint}",
                         expected="prescribed displacements that exclude every rigid motion",
                         remedy='support it by a [[boundary]], e.g. nodes = "BOTTOM" with ux = 0.0 and uy = 0.0, '
                         f'or u = "measured"{double}')


def _motion(part: FreePart, dim: int) -> str:
    """A free rigid motion in words."""
    if np.linalg.matrix_rank(part.motions) == len(part.motions):
        return "move freely"
    k = int(np.argmax(np.abs(part.motions[:, -1])))
    return f"move along {'xyz'[k]}" if k < dim else "turn as a rigid body"


def seen_nodes(mesh: Mesh, kind: str, surface: str | None) -> tuple[np.ndarray, list[np.ndarray]]:
    """Points seen by the camera as coordinates (n_nodes, 2|3) for the projection, and node lists of the seen cells."""
    if kind == "solid":
        cells = [row for block in mesh.surface_cells(surface) for row in block.connectivity]
        return mesh.nodes, cells
    if surface is not None:  # a cross-section seen from above: the camera shows x; y is the height
        faces = [mesh.face_nodes(face) for face in mesh.edge_sets[surface]]
        points = mesh.nodes.copy()
        points[:, 1] = 0.0
        return points, faces
    return mesh.nodes, [row for block in mesh.blocks for row in block.connectivity]


def visible_cells(mesh: Mesh, kind: str, surface: str | None, camera: AnyCamera, shape: tuple[int, int]) -> np.ndarray:
    """True for each seen cell that reaches into the image  # (n_cells,) bool"""
    points, padded = _SEEN.once(mesh, (kind, surface), lambda: _padded(*seen_nodes(mesh, kind, surface)))
    px = camera.project(points)
    at_nodes = px[padded.T]  # (widest, n_cells, 2): minima of whole rows
    low, high = at_nodes.min(axis=0), at_nodes.max(axis=0)
    inside = (high[:, 0] >= 0) & (low[:, 0] <= shape[1] - 1)
    if surface is not None and kind != "solid":
        return inside
    return inside & (high[:, 1] >= 0) & (low[:, 1] <= shape[0] - 1)


_SEEN = PerMesh()  # points and cells in view of a camera


def _padded(points: np.ndarray, cells: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Points, and the nodes of all cells in one array; smaller cells repeat their first node  # (n_cells, widest)"""
    widths = {len(cell) for cell in cells}
    widest = max(widths)
    if len(widths) == 1:
        return points, np.array(cells)
    return points, np.array([[*cell, *[cell[0]] * (widest - len(cell))] for cell in cells])


def corners_px(points: np.ndarray, cells: list[np.ndarray], kind: str, surface: str | None,
               camera: AnyCamera) -> list[np.ndarray]:
    """Corners of the seen cells (mid-side nodes left out)  # list of (n_corners, 2) px"""
    px = camera.project(points)
    section = surface is not None and kind != "solid"
    n_corners = {2: 2, 3: 2} if section else {3: 3, 4: 4, 6: 3, 8: 4}
    return [px[np.asarray(cell)[:n_corners[len(cell)]]] for cell in cells]


def seen_region(corners: list[np.ndarray], visible: np.ndarray, shape, mask: np.ndarray | None) -> np.ndarray:
    """The approximate ROI: bounding boxes of the visible cells, within the mask  # (ny, nx) bool"""
    roi = np.zeros(shape, dtype=bool)
    for cell, is_visible in zip(corners, visible, strict=True):
        if is_visible:
            low, high = np.floor(cell.min(axis=0)).astype(int), np.ceil(cell.max(axis=0)).astype(int)
            rows = slice(None) if len(cell) == 2 else slice(max(low[1], 0), max(high[1] + 1, 0))
            roi[rows, max(low[0], 0):max(high[0] + 1, 0)] = True
    roi = roi if mask is None else roi & mask
    return roi if roi.any() else np.ones(shape, dtype=bool)


def check_visible(mesh: Mesh, kind: str, surface: str | None, camera: AnyCamera, shape: tuple[int, int],
                  mask: np.ndarray | None, file, keys: tuple[str, str] = ("camera", "experiment.mask"),
                  fields: bool = False) -> None:
    """InputError if no cell reaches into the image (or its mask), of measured fields onto the grid of the points.

    keys : of camera and mask in the file
    """
    visible = visible_cells(mesh, kind, surface, camera, shape)
    points, padded = _SEEN.once(mesh, (kind, surface), lambda: _padded(*seen_nodes(mesh, kind, surface)))
    px = camera.project(points)[_SEEN.once(mesh, (kind, surface, "nodes"), lambda: np.unique(padded))]
    span = f"columns {px[:, 0].min():.0f} … {px[:, 0].max():.0f}, rows {px[:, 1].min():.0f} … {px[:, 1].max():.0f}"
    if not visible.any():
        sizes = np.ptp(px, axis=0) / shape[::-1]
        raise InputError(f"the mesh lies outside the {'measured points' if fields else 'image'}", file=file,
                         key=keys[0],
                         expected=f"columns 0 … {shape[1] - 1}, rows 0 … {shape[0] - 1} (a part is enough)",
                         found=span, remedy=_off_the_points(sizes) if fields else _out_of_sight(sizes, camera))
    if kind == "solid":
        _check_face_on(points, padded, px, camera, file, surface)
    if mask is not None and not (surface is not None and kind != "solid"):
        rows, columns = np.nonzero(mask)
        low, high = px.min(axis=0), px.max(axis=0)
        if columns.max() < low[0] or columns.min() > high[0] or rows.max() < low[1] or rows.min() > high[1]:
            white = f"columns {columns.min()} … {columns.max()}, rows {rows.min()} … {rows.max()}"
            raise InputError("the mask excludes the whole mesh", file=file, key=keys[1],
                             expected=f"white pixels within {span}", found=f"white pixels in {white}",
                             remedy="correct the mask: white pixels are correlated")


def _check_face_on(points: np.ndarray, padded: np.ndarray, px: np.ndarray, camera: AnyCamera, file, surface) -> None:
    """InputError where every face of the surface is a line in the image."""
    at = camera.project(points)[padded]  # (n_cells, n, 2)
    side = at[:, 1:] - at[:, :1]
    areas = np.abs(side[:, :-1, 0] * side[:, 1:, 1] - side[:, :-1, 1] * side[:, 1:, 0]).max(axis=1)
    if areas.max() < _MIN_FACE_ON * np.sum(np.ptp(px, axis=0)) ** 2 / len(padded):
        corners = points[np.unique(padded)]
        size = ", ".join(f"{axis} {a:g} … {b:g}" for axis, a, b in zip("xyz", corners.min(axis=0), corners.max(axis=0),
                                                                       strict=True))
        raise InputError("the camera sees the surface edge-on: no pixel lies on it", file=file,
                         key="experiment.surface", expected="a face set that the camera sees; without a pose it looks "
                         "along z, at the plane of mesh x and y", found=f"{surface}: {size}",
                         remedy="turn the mesh so that this face lies in the plane of x and y, or name the face set "
                                "that the camera sees")


def _out_of_sight(sizes: np.ndarray, camera: AnyCamera) -> str:
    """What to do about a mesh that is not seen; sizes : columns and rows that it spans, over those of the image."""
    if isinstance(camera, (LensCamera, PlacedCamera)):  # it has no scale and no origin of its own
        return ("check rotation and translation_mm or the alignment of the cameras, mesh_unit, calibration_camera, and "
                "the spacing of the target in the calibration: a wrong one puts the other camera elsewhere. Points "
                "clicked in both cameras (alignment.points_px) measure it")
    if sizes.min() > _MIN_LARGER:
        return f"check pixel_size_mm, which may be {sizes.max():.1f} times too small, and mesh_unit"
    return "check origin_px, axes, pixel_size_mm and mesh_unit"


def _off_the_points(sizes: np.ndarray) -> str:
    """The same of a mesh that no measured point lies on."""
    if sizes.min() > _MIN_LARGER:
        return (f"give the mesh in mm: it is {sizes.max():.1f} times as large as the field (of a mesh in px multiply "
                "every length by pixel_size_mm), or correct mesh_unit or fields_unit")
    if sizes.max() < 1.0 / _MIN_LARGER:
        return (f"check the scale of the field, which is {1.0 / sizes.min():.1f} times as large as the mesh: "
                "pixel_size_mm of fields in px, fields_unit, or mesh_unit")
    return "check origin_mm, axes, mesh_unit, and pixel_size_mm of fields in px"


def checked_heights(experiment: Experiment, file) -> Experiment:
    """The experiment, if its height images mark pixels without a value by NaN: some of them are looked at.

    Raises
    ------
    InputError
        Pixels on the specimen hold a number that is no height.
    """
    model, recording = experiment.model, experiment.recording
    if recording.quantity != "height" or recording.stack is None:
        return experiment
    points, cells = seen_nodes(model.mesh, model.kind, model.surface)
    region = seen_region(corners_px(points, cells, model.kind, model.surface, model.camera),
                         visible_cells(model.mesh, model.kind, model.surface, model.camera,
                                       recording.image_shape), recording.image_shape, recording.mask)
    compared = [k for k in range(model.reference, model.n_frames) if k not in recording.excluded]
    looked_at = np.unique(np.linspace(0, len(compared) - 1, _FRAMES_LOOKED_AT).round().astype(int))
    for k in (compared[place] for place in looked_at):
        if (mark := gap_mark(recording.stack.frame(k), region)) is not None:
            value, n = mark
            raise InputError("a number in the place of missing heights", file=file, key="experiment.images",
                             expected="NaN where a pixel has no height", found=f"{recording.labels[k]}: {n} pixels of "
                             f"{value:g} {recording.value_unit}, far from all others",
                             remedy=f"write NaN in the place of {value:g} (numpy: image[image == {value:g}] = nan, as "
                                    "32-bit float), or leave these pixels out by a mask")
    return experiment


def check_times(materials: tuple[Material, ...], times: np.ndarray | None, file) -> None:
    """InputError if a rate-dependent law has no frame times; an external law is not checked."""
    for record in materials:
        if times is None and record.law != EXTERNAL and is_rate_dependent(get_law(record.law)):
            raise InputError(f"{record.law} is rate-dependent, but the frames have no times", file=file,
                             key=f"material.{record.element_set}.law",
                             expected="a column time_s in the log, or frame_interval_s in [experiment]",
                             found="no times", remedy="add the column or the key")


def is_rate_dependent(law: LawSpec) -> bool:
    """Whether a parameter of the law has a unit with time: the frames then need times."""
    return any((unit := parse_unit(p.unit)) is not None and unit.powers[1] != 0 for p in law.parameters)


def check_surface(mesh: Mesh, kind: str, surface: str | None, file, key: str = "experiment.surface") -> None:
    """InputError unless a solid has a surface for the camera, and a plane-stress mesh has none."""
    if kind == "solid" and surface is None:
        raise InputError("a solid needs the face set that the camera sees", file=file, key=key,
                         expected=f"one of {', '.join(mesh.edge_sets) or 'the face sets'}",
                         found="no surface", remedy='give surface = "FRONT", a face set of the mesh or of [sets]')
    if kind == "plane_stress" and surface is not None:
        raise InputError("a plane-stress specimen has no surface key", file=file, key=key,
                         expected="no surface", found=repr(surface),
                         remedy="leave surface out")
    if kind == "solid" and len(mesh.face_set_nodes(mesh.edge_sets[surface])) == 0:
        raise InputError("an empty set", file=file, key=key, expected="a set with faces", found="none",
                         remedy="choose another set")


def _first_labels(labels: np.ndarray) -> str:
    return ", ".join(map(str, labels[:10])) + (" …" if len(labels) > 10 else "")
