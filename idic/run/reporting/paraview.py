"""The fields of a run for ParaView: one VTU file per frame, and a PVD file that lists them with their times."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from xml.sax.saxutils import quoteattr

import meshio
import numpy as np

from idic.fe import Mesh
from idic.inside import folder_inside, free_inside, write_inside
from idic.measure import field_columns
from idic.model import Model
from idic.report import RunRecord
from idic.run.prepared.context import RunContext
from idic.run.store.arrays import FrameArrays
from idic.run.store.layout import BASE, group_name

VTK_NAMES = {"tri3": "triangle", "tri6": "triangle6", "quad4": "quad", "quad8": "quad8", "tet4": "tetra",
             "tet10": "tetra10", "hex8": "hexahedron", "hex20": "hexahedron20"}
COLLECTION = "fields.pvd"
N_DIGITS = 17  # binary ones of a strain or stress in a file to look at


def write_paraview(context: RunContext, model: Model, record: RunRecord, folder: Path) -> None:
    """Write ``fields.pvd`` and its frames on the simulated mesh (mm or px); nothing where no point was accepted.

    experiment : at the geometry that was identified
    """
    accepted = [entry["evaluation"] for entry in record.result.get("history", ()) if entry["accepted"]]
    if not accepted:
        return
    u = FrameArrays.open(context.store.group(group_name(accepted[-1], BASE)), "u")
    write_collection(folder, model.mesh, _frames(model, u, record))


def write_collection(folder: Path, mesh: Mesh, frames: Iterable[tuple[float, Mapping[str, np.ndarray]]]) -> Path:
    """Write nodal fields of all frames.

    Parameters
    ----------
    mesh : Mesh
        In mm; flat meshes get z = 0.
    frames : iterable of (time, {name: (n_nodes,) or (n_nodes, k) array})
        Vectors of two components get a third that is zero, as ParaView wants them.

    Returns
    -------
    Path
        The PVD file to open.
    """
    folder_inside(folder.parent, folder.name)
    points = three_columns(mesh.nodes).astype(np.float32)
    cells = [(VTK_NAMES[block.cell], np.asarray(block.connectivity, dtype=np.int32)) for block in mesh.blocks]
    entries = []
    for k, (time, fields) in enumerate(frames):
        name = f"frame_{k:04d}.vtu"
        data = {key: three_columns(value) for key, value in fields.items()}
        meshio.write(free_inside(folder, name), meshio.Mesh(points, cells, point_data=data), file_format="vtu")
        entries.append(f'    <DataSet timestep={quoteattr(f"{time:.9g}")} part="0" file={quoteattr(name)}/>')
    return write_inside(
        folder, COLLECTION,
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
        + "\n".join(entries)
        + "\n  </Collection>\n</VTKFile>\n")


def three_columns(values: np.ndarray) -> np.ndarray:
    """(n, 2) with a third column of zeros; anything else as it is."""
    values = np.asarray(values)
    if values.ndim == 2 and values.shape[1] == 2:
        return np.hstack([values, np.zeros((len(values), 1), dtype=values.dtype)])
    return values


def _shortened(values: np.ndarray) -> np.ndarray:
    """Values with 17 binary digits, 4e-6 of a value: a quarter less; ``run.zarr`` has all digits."""
    scale, exponent = np.frexp(values)
    return np.ldexp(np.round(np.ldexp(scale, N_DIGITS)), exponent - N_DIGITS).astype(np.float32)


def _frames(model: Model, u: FrameArrays,
            record: RunRecord) -> Iterator[tuple[float, Mapping[str, np.ndarray]]]:
    data, start = record.sensitivities, model.reference
    for k in range(u.n_frames):
        fields = {f"displacement_{model.length_unit}": u.read(k, k + 1)[0].astype(np.float32)}
        if data is not None and data.frame == start + k:
            fields |= {f"sensitivity_px_per_{step.replace(' ', '')}_{name}": _shortened(data.phi_px[i])
                       for i, (name, step) in enumerate(zip(data.names, data.steps, strict=True))}
        fields |= _measured_and_derived(record, start + k, len(model.mesh.nodes))
        yield model.times[start + k], fields


def _measured_and_derived(record: RunRecord, frame: int, n_nodes: int) -> dict[str, np.ndarray]:
    """Measured displacement, strain, stress and state on the seen surface, NaN elsewhere; {} for other frames."""
    series = record.series
    if series is None or frame not in series.frames:
        return {}
    columns = field_columns(series, series.frames.index(frame), noise=False)
    arrays: dict[str, np.ndarray] = {}
    for name, values in columns.items():
        if name.startswith("u_") or name.split("_")[1:2] in (["1"], ["2"]):
            continue
        arrays[name] = np.full(n_nodes, np.nan, dtype=np.float32)
        arrays[name][series.surface.index] = _shortened(values)
    if series.measured is not None:
        k, depth = series.frames.index(frame), series.measured_depth.get("u_z")
        measured = series.measured[k] if depth is None else np.column_stack([series.measured[k], depth[k]])
        motion = np.full((n_nodes, measured.shape[1]), np.nan, dtype=np.float32)
        motion[series.surface.index] = _shortened(measured)
        arrays[f"displacement_measured_{series.unit}"] = motion
    return arrays
