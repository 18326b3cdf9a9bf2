"""What is assumed of a test: body, laws, drives, loads, camera and parameters, at the times of its frames.

`idic.model.forward` simulates it; no function of the simulation needs more of an experiment.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from idic.errors import InputError
from idic.fe import ExternalSetup, Mesh, Morph, morphed
from idic.images import AnyCamera
from idic.model.records.parts import (
    Channel, Column, Crack, Drive, Heterogeneity, Load, Material, Prescribed, Temperature,
)
from idic.model.records.stated_curve import StatedCurve
from idic.parameters import ParameterSet

if TYPE_CHECKING:  # it knows the frames of a simulation, which know no model
    from idic.model.records.motion_error import MotionError


@dataclass(frozen=True)
class Model:
    """A body that moves, and how its motion is read; every array is in internal units (mm, s, MPa, N)."""

    kind: str  # plane_stress | plane_strain | solid
    mesh: Mesh
    thickness: float | None  # mm
    materials: tuple[Material, ...]
    parameters: ParameterSet
    prescribed: tuple[Prescribed, ...]
    loads: tuple[Load, ...]
    channels: tuple[Channel, ...]
    camera: AnyCamera
    times: np.ndarray  # (n_frames,) s; frame numbers where no time is known
    reference: int = 0  # frame of the undeformed state
    has_times: bool = True  # False: `times` are frame numbers
    surface: str | None = None
    symmetry: str | None = None  # "x": the mesh is the half x >= 0 of a cross-section, the images show both halves
    length_unit: str = "mm"  # "px" where no scale is known: then mm in every docstring reads px
    temperatures: tuple[Temperature, ...] = ()
    heterogeneities: tuple[Heterogeneity, ...] = ()
    cracks: tuple[Crack, ...] = ()
    solver: ExternalSetup | None = None  # a program that simulates in place of the built-in one
    morphs: tuple[Morph, ...] = ()  # geometric degrees of freedom of the mesh: `at_geometry`
    motion_error: MotionError | None = None  # what the simulation is known to lack, added to it
    log_offset: float = 0.0  # s, `time.offset` at which the columns of the log were read; linear from there
    axis_order: tuple[int, ...] = ()  # of the view of a further camera: its mesh axes in terms of the simulation's
    sees_back: bool = False  # of the view of a further camera: it sees the side of a sheet that the main one does not
    stated_values: tuple[str, ...] = ()  # names of the degrees of freedom whose start the user stated
    free_curves: tuple[StatedCurve, ...] = ()
    outline_share: float | None = None  # distance of the outline of the mesh from that in the image, of its width

    @property
    def n_dim(self) -> int:
        """Components of a displacement."""
        return 3 if self.kind == "solid" else 2

    @property
    def n_frames(self) -> int:
        """How many frames the test has."""
        return len(self.times)

    @property
    def drives(self) -> tuple[Drive, ...]:
        """Of the prescribed motions, then of the loads."""
        return (*(entry.drive for entry in self.prescribed), *(entry.drive for entry in self.loads))

    @property
    def logged_drives(self) -> tuple[Column, ...]:
        """The drives that follow a column of the log."""
        return tuple(drive for drive in self.drives if isinstance(drive, Column))

    def material_of(self, element_set: str) -> Material:
        """The material of an element set; InputError if it has none."""
        for material in self.materials:
            if material.element_set == element_set:
                return material
        raise InputError(f"no material for element set {element_set}", key="material",
                         expected=", ".join(material.element_set for material in self.materials), found=element_set,
                         remedy=f"add a table [material.{element_set}], or use one of these sets")

    def log_shift(self, parameters: ParameterSet) -> float:
        """How much later than they were read the columns of the log count at these parameters (s)."""
        return parameters["time.offset"].value - self.log_offset if "time.offset" in parameters else 0.0

    def at_geometry(self, parameters: ParameterSet) -> Model:
        """The model with the mesh morphed to these parameters; itself where the geometry is that of the mesh.

        Raises
        ------
        NotConverged
            If an element would be flattened.
        """
        values = {morph.name: parameters[morph.name].value for morph in self.morphs if morph.name in parameters}
        mesh = morphed(self.mesh, self.morphs, values)
        return self if mesh is self.mesh else replace(self, mesh=mesh)

    def turned(self, field: np.ndarray) -> np.ndarray:
        """A nodal vector field of the simulation in the axes of this view  # (n_nodes, dim, ...)

        A sheet that becomes thinner recedes from the cameras on both of its sides.
        """
        if self.axis_order:
            return field[:, list(self.axis_order)]
        if not self.sees_back or field.shape[1] == self.n_dim:
            return field
        field = field.copy()
        field[:, 2] *= -1.0
        return field
