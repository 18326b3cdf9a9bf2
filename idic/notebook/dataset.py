"""The fields of a result as an xarray.Dataset: displacement, strain, residual and channels with coordinates and
units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from idic.errors import InputError
from idic.fe import Mesh, green_strain, nodal_deformation
from idic.measure import rotated, strain, surface_of
from idic.run import Fields, checked_frame
from idic.notebook.optional import optional

if TYPE_CHECKING:
    import xarray

PAIRS = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))}  # of a strain tensor


def dataset(content: Mapping, fields: Fields, frames: Sequence[int] | None, residual: bool,
            measured: bool = False) -> xarray.Dataset:
    """See `idic.notebook.result.Result.to_xarray`."""
    xarray = optional("xarray")
    experiment = fields.experiment
    requested = range(experiment.model.reference, experiment.model.n_frames) if frames is None else frames
    if isinstance(requested, str) or not hasattr(requested, "__len__") or not len(requested):
        raise InputError("no frames to give", key="frames", expected="a list of numbers, as [0, -1]",
                         found=repr(frames), remedy="write a list, or leave frames out for all of them")
    numbers = [checked_frame(experiment.model, frame) for frame in requested]
    u = np.array([fields.u(frame)[:, :experiment.model.n_dim] for frame in numbers])
    pairs = PAIRS[experiment.model.n_dim]
    factors = np.array([channel.shown_factor
                        for channel in experiment.model.channels])  # (n_channels,) of their columns
    variables: dict[str, Any] = {
        "u": (("frame", "node", "component"), u,
              {"long_name": "simulated displacement", "units": experiment.model.length_unit}),
        "strain": (("frame", "node", "strain_component"), strains(experiment.model.mesh, u),
                   {"long_name": "Green-Lagrange strain of the simulation at the nodes", "units": "1"}),
        "simulated": (("frame", "channel"), fields.simulated[numbers] / factors, {"long_name": "simulated channels"}),
        "measured": (("frame", "channel"), fields.measured[numbers] / factors, {"long_name": "measured channels"}),
    }
    if measured:
        variables |= _measured(fields, numbers)
    if residual:
        variables["residual"] = (("frame", "row", "column"), _residuals(fields, numbers),
                                 {"long_name": "f(x) - g(x + u) in the reference image"
                                  if experiment.recording.points is None
                                  else "displacement measured minus simulated, rms of the components of a point",
                                  "units": experiment.recording.value_unit})
    coordinates: dict[str, Any] = {
        "frame": numbers, "label": ("frame", [experiment.recording.labels[frame] for frame in numbers]),
        "time": ("frame", experiment.model.times[numbers],
                 {"units": "s" if experiment.model.has_times else "1"}),
        "node": ("node", np.asarray(experiment.model.mesh.node_labels),
                 {"long_name": "number of the node in the mesh"}),
        "component": list("xyz"[:experiment.model.n_dim]),
        "strain_component": ["xyz"[i] + "xyz"[j] for i, j in pairs],
        "channel": [channel.column for channel in experiment.model.channels],
        "channel_units": ("channel", np.array([channel.shown_unit for channel in experiment.model.channels],
                                              dtype=str)),
    }
    for axis in range(experiment.model.n_dim):
        coordinates["xyz"[axis]] = ("node", experiment.model.mesh.nodes[:, axis],
                                    {"units": experiment.model.length_unit})
    if residual:
        unit = "px" if experiment.recording.points is None else "1"  # rows of images, or of the grid of points
        for name, size in zip(("row", "column"), experiment.recording.image_shape, strict=True):
            coordinates[name] = (name, np.arange(size), {"units": unit})
    return xarray.Dataset(variables, coordinates, {"title": experiment.title, "status": content["status"],
                                                   "kind": experiment.model.kind,
                                                   "reference_frame": experiment.model.reference})


def strains(mesh: Mesh, u: np.ndarray) -> np.ndarray:
    """Green-Lagrange strain at the nodes, NaN at nodes of no element  # (n, n_nodes, dim) mm -> (n, n_nodes, 3 or 6)"""
    pairs = PAIRS[mesh.n_dim]
    tensors = [green_strain(nodal_deformation(mesh, motion)) for motion in u]
    return np.array([[tensor[:, i, j] for i, j in pairs] for tensor in tensors]).transpose(0, 2, 1).reshape(
        len(u), -1, len(pairs))


def strain_tensor(fields: Fields, frame: int, measure: str, angle_deg: float, source: str) -> np.ndarray:
    """See `idic.notebook.result.Result.strain`."""
    mesh = fields.experiment.model.mesh
    if source == "simulated":
        return rotated(strain(nodal_deformation(mesh, fields.u(frame)[:, :mesh.n_dim]), measure), angle_deg)
    if source != "measured":
        raise InputError("no such field", key="source", expected="simulated, measured", found=source,
                         remedy="write one of these names")
    surface = surface_of(mesh, fields.experiment.model.surface)
    tensor = np.full((mesh.n_nodes, 2, 2), np.nan)
    tensor[surface.index] = rotated(strain(surface.deformation(fields.u_measured(frame)[surface.index]), measure),
                                   angle_deg)
    return tensor


def _measured(fields: Fields, frames: Sequence[int]) -> dict[str, Any]:
    """Displacement and Green-Lagrange strain by a free FE-DIC; NaN along z."""
    experiment, d = fields.experiment, fields.experiment.model.n_dim
    surface, pairs = surface_of(experiment.model.mesh, experiment.model.surface), PAIRS[experiment.model.n_dim]
    u = np.full((len(frames), experiment.model.mesh.n_nodes, d), np.nan)
    E = np.full((len(frames), experiment.model.mesh.n_nodes, len(pairs)), np.nan)
    for k, frame in enumerate(frames):
        u[k, :, :2] = fields.u_measured(frame)
        tensor = strain(surface.deformation(u[k, surface.index, :2]))
        for number, (i, j) in enumerate(pairs):
            if i < 2 and j < 2:
                E[k, surface.index, number] = tensor[:, i, j]
    return {"u_measured": (("frame", "node", "component"), u,
                           {"long_name": "displacement measured by a free FE-DIC",
                            "units": experiment.model.length_unit}),
            "strain_measured": (("frame", "node", "strain_component"), E,
                                {"long_name": "Green-Lagrange strain of the measured displacement", "units": "1"})}


def _residuals(fields: Fields, frames: Sequence[int]) -> np.ndarray:
    """NaN in the reference frame, which is compared with nothing  # (n, ny, nx) float32"""
    maps = np.full((len(frames), *fields.experiment.recording.image_shape), np.nan, np.float32)
    for k, frame in enumerate(frames):
        if frame != fields.experiment.model.reference:
            maps[k] = fields.residual(frame)
    return maps
