"""Degrees of freedom of a camera with a lens, and of the place of the mesh before it."""

from __future__ import annotations

import numpy as np

from idic.experiment_file.tables.camera_motion import rigid_parameters
from idic.images import PLACED_TURNS, PLACEMENT_STEM, PlacedCamera, RIGID, RigidMotion
from idic.parameters import Parameter

MOVED_PX = 3.0  # by a unit of the scale, at most, over the image
MAX_STEP = 3.5  # units of the scale, as of other cameras: 10 px


def lens_dofs(name: str, camera: PlacedCamera, image_shape: tuple[int, int]) -> dict[str, Parameter]:
    """The values of a calibration and a turn of the camera as degrees of freedom, none of them free."""
    every = (*camera.lens.parameters, *PLACED_TURNS)
    scales, values = _scales(camera, image_shape, every), camera.values()
    dofs = {}
    for parameter in every:
        unit = camera.lens.units.get(parameter, "deg")
        bounds = (1e-3 * values[parameter], 1e3 * values[parameter]) if parameter in ("fx", "fy") else (-np.inf, np.inf)
        dofs[f"{name}.{parameter}"] = Parameter(f"{name}.{parameter}", values[parameter], "" if unit == "1" else unit,
                                                bounds=bounds, scale=scales[parameter], max_step=MAX_STEP)
    return dofs


def placement_dofs(camera: PlacedCamera, image_shape: tuple[int, int]) -> tuple[dict[str, Parameter], list[Parameter]]:
    """The place of the mesh, and the amplitudes of its rigid motion; scales as the main camera sees them."""
    names = [f"{PLACEMENT_STEM}.{name}" for name in RIGID]
    scales = _scales(camera, image_shape, names)
    dofs = {name: Parameter(name, 0.0, RigidMotion.units[kind], scale=scales[name], max_step=MAX_STEP)
            for kind, name in zip(RIGID, names, strict=True)}
    return dofs, rigid_parameters(camera, {kind: scales[name] for kind, name in zip(RIGID, names, strict=True)})


def _scales(camera: PlacedCamera, image_shape, names) -> dict[str, float]:
    """The change of each parameter that moves some point by `MOVED_PX`: points seen at the edges of the image, as far
    away as the middle of the mesh."""
    ny, nx = image_shape
    edge = np.array([[x, y] for x in (0.0, 0.5 * nx, nx - 1.0) for y in (0.0, 0.5 * ny, ny - 1.0)])
    effective = camera.effective
    depth = float(camera.depths(camera.pivot_mm[None])[0])
    ideal = effective.normalised(edge)
    ideal = ideal[np.isfinite(ideal).all(axis=1)]
    points = (depth * np.column_stack([ideal, np.ones(len(ideal))]) - effective.translation_mm) @ effective.rotation
    reach = {name: np.linalg.norm(camera.parameter_jacobian(points, name), axis=1).max(initial=0.0) for name in names}
    return {name: MOVED_PX / float(moved) if moved > 0.0 else 1.0 for name, moved in reach.items()}
