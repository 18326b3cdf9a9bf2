"""The motion of the images alone, without law and drive: a free FE-DIC as displacement and strain of the nodes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from idic.correlation import ViewKind, view_of
from idic.errors import InputError
from idic.fe import Mesh
from idic.images import Camera
from idic.measure import DicStack, Regularisation, dic_stack, in_mm, rotated, strain, surface_of
from idic.model import Experiment


@dataclass(frozen=True, eq=False)
class FreeMotion:
    """The measured motion of every frame.

    Attributes
    ----------
    experiment : Experiment
        The recording on its mesh, with the order of elements that was computed.
    stack : DicStack
        The free FE-DIC: ``rms_gv``, ``noise_gv``, ``mismatched``, ``length_px`` and more.
    """

    experiment: Experiment
    stack: DicStack

    @property
    def mesh(self) -> Mesh:
        """Its nodes in mm; in px where no scale is given."""
        return self.experiment.model.mesh

    @property
    def u_px(self) -> np.ndarray:
        """Displacement in the image, NaN where a node is not seen  # (n_frames, n_nodes, 2) px: column, row"""
        return self.stack.u_px

    @property
    def status(self) -> list[str]:
        """Of every frame: "ok", "lost", "unexplained" or "excluded"."""
        return self.stack.status

    @cached_property
    def u(self) -> np.ndarray:
        """Displacement in the plane of the mesh  # (n_frames, n_nodes, 2) mm; px where no scale is given"""
        camera = self.experiment.model.camera
        return np.array([in_mm(motion, self.mesh.nodes, camera) for motion in self.u_px])

    def strain(self, frame: int = -1, measure: str = "green_lagrange", angle_deg: float = 0.0) -> np.ndarray:
        """Strain tensor at the nodes in one frame, NaN where it is not measured  # (n_nodes, 2, 2)

        Parameters
        ----------
        frame : negative ones count from the last
        measure : "green_lagrange" | "hencky" | "small"
        angle_deg : of the axes of the components, counter-clockwise about z

        Raises
        ------
        InputError
            No such frame or measure.
        """
        n = len(self.u_px)
        if isinstance(frame, bool) or not isinstance(frame, (int, np.integer)) or not -n <= frame < n:
            raise InputError("no such frame", key="frame", expected=f"0 to {n - 1}, or -1 for the last",
                             found=repr(frame), remedy="correct the number: frames count from 0")
        surface = surface_of(self.mesh, self.experiment.model.surface)
        tensor = np.full((self.mesh.n_nodes, 2, 2), np.nan)
        tensor[surface.index] = rotated(strain(surface.deformation(self.u[frame][surface.index]), measure), angle_deg)
        return tensor

    def __repr__(self) -> str:
        explained = self.status.count("ok")
        return f"FreeMotion({self.mesh.n_nodes} nodes, {explained} of {len(self.status)} frames ok)"


def measured_motion(experiment: Experiment, regularisation: Regularisation) -> FreeMotion:
    """The free motion of the images of one camera; see `idic.notebook.experiment.Experiment.free_motion`."""
    camera = experiment.model.camera
    is_measurable = isinstance(camera, Camera) and experiment.recording.stack is not None
    if not is_measurable or view_of(experiment, camera).kind != ViewKind.GREY:
        raise InputError("no free FE-DIC of these images", key="images",
                         expected="grey images of a surface by a telecentric camera",
                         found=f"{experiment.recording.quantity} images, {type(camera).__name__}",
                         remedy="identify, and use the simulated fields")
    return FreeMotion(experiment, dic_stack(experiment, regularisation))
