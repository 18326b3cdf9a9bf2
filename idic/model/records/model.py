"""What is assumed of a test: body, laws, drives, loads, camera and parameters, at the times of its frames.

`idic.model.forward` simulates it; no function of the simulation needs more of an experiment.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from idic.errors import InputError
from idic.fe import ExternalSetup, Mesh, Morph, morphed, nodal_deformation
from idic.images import AnyCamera
from idic.laws import get_law
from idic.model.records.parts import (
    Channel, Column, Crack, Drive, Heterogeneity, Load, Material, Measured, Parametrised, Prescribed, Temperature,
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

    def node_set(self, name: str) -> np.ndarray:
        """Node indices of a set.

        Raises
        ------
        InputError
            If the mesh has no such node set.
        """
        sets = self.mesh.node_sets
        if name not in sets:
            raise InputError(f"no node set {name}", file="experiment.toml", key="[[boundary]] nodes",
                             expected=f"one of {', '.join(sorted(sets)) or '(the mesh has no node sets)'}", found=name,
                             remedy="correct the name, or define the set by position under [sets]")
        return np.asarray(sets[name])

    def rates_since_reference(self, rates: np.ndarray) -> np.ndarray:
        """Derivative by a time shift of the log of a motion that counts from the reference frame, mm/s  # (n_frames,)

        A later reading of the log has a later zero, too, unless the reference is the first frame, where the test
        begins.
        """
        return rates - rates[self.reference] if self.reference > 0 else rates

    @property
    def is_section(self) -> bool:
        """Whether a plane mesh is a cross-section whose edge set is seen from above."""
        return self.n_dim == 2 and self.surface is not None

    def measured_channels(self, parameters: ParameterSet) -> np.ndarray:
        """The logged channels of all frames, at the times of the images  # (n_frames, n_channels)"""
        shift = self.log_shift(parameters)
        columns = [channel.values + (shift * channel.rates if channel.rates is not None else 0.0)
                   for channel in self.channels]
        return np.stack(columns, axis=1) if columns else np.zeros((self.n_frames, 0))

    def nodal_gradient(self, u: np.ndarray) -> np.ndarray:
        """Deformation gradient at the nodes  # (n_nodes, dim, dim); of a motion with a third component (.., 3, 2)"""
        gradient = nodal_deformation(self.mesh, u)
        return np.where(np.isnan(gradient), np.eye(*gradient.shape[1:]), gradient)  # nodes of no element do not matter

    @property
    def gripped_ends(self) -> list[str]:
        """Node sets that keep their thickness: held or moved in both components, not measured."""
        components: dict[str, set[str]] = {}
        for entry in self.prescribed:
            if not isinstance(entry.drive, (Measured, Parametrised)):
                components.setdefault(entry.nodes, set()).add(entry.component)
        return [name for name, directions in components.items() if directions >= {"x", "y"}]

    def tips_at(self, parameters: ParameterSet) -> np.ndarray:
        """Lengths of the cracks in the simulated frames  # (n_simulated, n_cracks) mm"""
        lengths = [np.array([parameters[name].value for name in crack.names]) @ crack.hats for crack in self.cracks]
        return np.array(lengths).T[self.reference:]

    @property
    def rate_dependent_laws(self) -> tuple[str, ...]:
        """Laws that depend on time; none with an external solver, which takes its own increments."""
        if self.solver is not None:
            return ()
        return tuple(dict.fromkeys(m.law for m in self.materials if get_law(m.law).rate_dependent))

    @property
    def path_dependent_laws(self) -> tuple[str, ...]:
        """Laws with a memory, plasticity and damage among them: their stress depends on the increments, if less than
        that of a rate-dependent law. None with an external solver."""
        if self.solver is not None:
            return ()
        return tuple(dict.fromkeys(m.law for m in self.materials if get_law(m.law).n_state > 0))

    @property
    def curves_by_evidence(self) -> tuple[StatedCurve, ...]:
        """The free curves whose knots are still to be chosen."""
        return tuple(curve for curve in self.free_curves if curve.by_evidence)
