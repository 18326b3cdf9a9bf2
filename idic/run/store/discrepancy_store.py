"""The normal equations of a discrepancy on disk, one group per evaluated point."""

from __future__ import annotations

import numpy as np

from idic.identification import Component, DiscrepancySystem
from idic.run.store.arrays import read_array, write_array
from idic.run.store.layout import group_name
from idic.run.store.run_store import RunStore
from idic.run.store.schemas.groups import StoredDiscrepancy

LABEL = "discrepancy"
SYMMETRIC = ("M", "noise")  # stored as their upper triangles


def save_discrepancy(store: RunStore, number: int, system: DiscrepancySystem | str) -> None:
    """Store the normal equations of the evaluated point `number`, or why they were not made."""
    has_system = not isinstance(system, str)
    ident = ({"reason": "", "names": list(system.names), "components": [c.name for c in system.components],
              "motion_px": dict(system.motion_px), "may_be_rough": system.may_be_rough,
              "mesh_size_only": system.mesh_size_only}
             if has_system else {"reason": system})
    with store.building(group_name(number, LABEL), ident) as folder:
        if has_system:
            for name in SYMMETRIC:
                matrix = getattr(system, name)
                write_array(folder, name, np.triu(0.5 * (matrix + matrix.T)))
            for name in ("b", "channel_rows"):
                write_array(folder, name, getattr(system, name))
            if system.mesh_error is not None:
                write_array(folder, "mesh_column", system.mesh_error)
            if system.strain_error is not None:
                write_array(folder, "strain_column", system.strain_error)
            for component in system.components:
                write_array(folder, f"root_{component.name}", component.root)


def load_discrepancy(store: RunStore, number: int) -> DiscrepancySystem | str:
    """The stored normal equations, or why there are none."""
    folder = store.finished(group_name(number, LABEL))
    if folder is None:
        return "it was not computed"
    kind = store.ident(folder, StoredDiscrepancy)
    if kind["reason"]:
        return str(kind["reason"])
    mesh_error, strain_error = (read_array(folder, name) if (folder / name).exists() else None
                                for name in ("mesh_column", "strain_column"))
    components = tuple(Component(name, read_array(folder, f"root_{name}")) for name in kind["components"])
    M, noise = (upper + np.triu(upper, 1).T for upper in (read_array(folder, name) for name in SYMMETRIC))
    return DiscrepancySystem(tuple(kind["names"]), M, read_array(folder, "b"), noise, components,
                             dict(kind["motion_px"]), read_array(folder, "channel_rows"), mesh_error,
                             bool(kind["may_be_rough"]), strain_error, bool(kind["mesh_size_only"]))
