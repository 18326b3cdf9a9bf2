"""The result of an identification for a notebook: parameters, tables, fields, pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from idic.notebook.estimates import Estimates, covariance
from idic.notebook.optional import optional
from idic.run import Fields

if TYPE_CHECKING:  # heavy, and perhaps not installed
    import arviz
    import pandas
    import xarray

    from idic.notebook.pictures import Plots

_COLUMNS = ("value", "std", "ci95_low", "ci95_high", "unit", "start", "free", "std_noise", "std_model")


class Result:
    """What an identification found.

    ``result["residual"]`` is the entry of that name in ``result.json`` (docs/quantities.md).

    Attributes
    ----------
    content : the keys of ``result.json``
    fields : displacements, residuals and channels of single frames (`idic.run.fields.Fields`)
    """

    def __init__(self, content: Mapping[str, Any], fields: Fields):
        self.content, self.fields = dict(content), fields

    def __getitem__(self, key: str) -> Any:
        return self.content[key]

    @property
    def status(self) -> str:
        """``converged``, ``stalled``, ``max_iterations``, ``at_bound``, ``forward_failed`` or ``interrupted``."""
        return self.content["status"]

    @property
    def converged(self) -> bool:
        return self.status == "converged"

    @property
    def failure(self) -> str | None:
        """Why the last simulation failed, where that ended the identification."""
        if self.status != "forward_failed":
            return None
        return next((entry["message"] for entry in reversed(self.content.get("history", ())) if entry.get("message")),
                    None)

    @property
    def parameters(self) -> Estimates:
        """Every parameter with ``value``, ``std``, ``ci95``, ``unit``, ``start`` and ``free``."""
        return Estimates(self.content["parameters"])

    @property
    def covariance(self) -> np.ndarray:
        """Of `determined`, in the units of the experiment  # (n, n)"""
        return covariance(self.content)[2]

    @property
    def determined(self) -> tuple[str, ...]:
        """The parameters that the test determines."""
        return covariance(self.content)[0]

    def to_frame(self) -> pandas.DataFrame:
        """The parameters as a pandas.DataFrame, one row per parameter; NaN where nothing is known.

        Raises
        ------
        InputError
            pandas is not installed.
        """
        rows = [(e.value, e.std, *(e.ci95 or (None, None)), e.unit, e.start, e.free, e.std_noise, e.std_model)
                for e in self.parameters.values()]
        frame = optional("pandas").DataFrame(rows, columns=list(_COLUMNS), index=list(self.parameters))
        numbers = [name for name in _COLUMNS if name not in ("unit", "free")]
        frame[numbers] = frame[numbers].astype(float)
        return frame.rename_axis("parameter")

    def strain(self, frame: int = -1, measure: str = "green_lagrange", angle_deg: float = 0.0,
               source: str = "simulated") -> np.ndarray:
        """Strain tensor at the nodes in one frame.

        Parameters
        ----------
        frame : negative ones count from the last
        measure : "green_lagrange" | "hencky" | "small"
        angle_deg : of the axes of the components, counter-clockwise about z
        source : "simulated", or "measured" by a free FE-DIC: then in the plane that the camera sees

        Returns
        -------
        (n_nodes, d, d), NaN at nodes of no element or not seen; `principal` gives values

        Raises
        ------
        InputError
            No such frame, measure or source.
        """
        from idic.notebook.dataset import strain_tensor

        return strain_tensor(self.fields, frame, measure, angle_deg, source)

    def stiffness_field(self, element_set: str, spacing_mm: float, length_mm: float, std: float = 0.3) -> Any:
        """Where a part is stiffer or softer than identified: factors on its stress, by the hundred.

        Parameters
        ----------
        element_set : of a material
        spacing_mm : of the grid of the factors
        length_mm : within which they are alike; std : of their logarithm before the test

        Returns
        -------
        ``factor`` and ``std`` at ``places`` (n, d) mm, ``element_factor`` and ``element_std`` of ``elements``
        (`idic.identification.stiffness_field.StiffnessField`)

        Raises
        ------
        InputError
            The result is not of this process, or the test is one without such a field.
        """
        return self.fields.identified_in_memory().stiffness_field(element_set, spacing_mm, length_mm, std)

    def to_xarray(self, frames: Sequence[int] | None = None, residual: bool = True,
                  measured: bool = False) -> xarray.Dataset:
        """Displacement, strain, residual and channels as an xarray.Dataset with coordinates and units.

        ``u`` (frame, node, component) mm; ``strain`` (frame, node, strain_component), Green-Lagrange; ``residual``
        (frame, row, column) grey values, NaN where nothing is compared; ``simulated`` and ``measured`` (frame, channel)
        in ``channel_units``, those of the columns.

        Parameters
        ----------
        frames : numbers, negative ones counted from the last; default: the reference and all later ones
        residual : False leaves the maps out, which are as large as the images in float32
        measured : adds ``u_measured`` and ``strain_measured`` by a free FE-DIC of every frame

        Raises
        ------
        InputError
            xarray is not installed, or a frame does not exist.
        """
        from idic.notebook.dataset import dataset

        return dataset(self.content, self.fields, frames, residual, measured)

    def to_arviz(self, draws: int = 1000, chains: int = 4, seed: int | None = 0) -> arviz.InferenceData:
        """Independent draws from the Gaussian posterior as ArviZ InferenceData, in the units of the experiment.

        From ArviZ 1.0 on it is an xarray.DataTree.

        Raises
        ------
        InputError
            arviz is not installed, or the test determines no parameter.
        """
        from idic.notebook.posterior import inference_data

        return inference_data(self.content, draws, chains, seed)

    @property
    def plot(self) -> Plots:
        """``plot.residual(frame=-1)``, ``plot.channels()``, ``plot.corner()``: matplotlib figures."""
        from idic.notebook.pictures import Plots

        return Plots(self.content, self.fields)

    def __repr__(self) -> str:
        n = self.content["iterations"]
        chi2 = self.content["residual"].get("image_chi2_dof")
        fit = "" if chi2 is None else f", chi2 per pixel {chi2:.2f}"
        lines = "".join(f"\n  {e}" for e in self.parameters.values() if e.free)
        failed = "" if self.failure is None else f"\n  {self.failure}"
        return f"Result: {self.status}, {n} iteration{'' if n == 1 else 's'}{fit}{lines}{failed}"

    def _repr_html_(self) -> str:
        from idic.notebook.html import result_html

        return result_html(self.content, self.parameters, self.failure)
