"""The Gaussian posterior of a result: values and covariance of what the test determines, and draws from it.

The posterior of the parameters is Gaussian where the model is linear within a few standard deviations; values, standard
deviations and correlations are those of ``result.json`` (docs/error-bars.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from idic.errors import InputError
from idic.notebook.estimates import covariance
from idic.notebook.optional import optional

if TYPE_CHECKING:
    import arviz

LIBRARY = "idic"


@dataclass(frozen=True, eq=False)
class Posterior:
    """A Gaussian in the units of the experiment; names (n), mean (n,), covariance (n, n), units (n)."""

    names: tuple[str, ...]
    mean: np.ndarray
    covariance: np.ndarray
    units: tuple[str, ...]

    @property
    def std(self) -> np.ndarray:
        """(n,)"""
        return np.sqrt(np.diagonal(self.covariance))

    @property
    def correlation(self) -> np.ndarray:
        """(n, n)"""
        return self.covariance / np.outer(self.std, self.std)

    def draws(self, n: int, seed: int | None = 0) -> np.ndarray:
        """Independent draws  # (n, n_parameters)"""
        scaled = np.random.default_rng(seed).multivariate_normal(np.zeros(len(self.names)), self.correlation, n,
                                                                 method="eigh")
        return self.mean + self.std * scaled


def posterior_of(content: Mapping, names: tuple[str, ...] | None = None) -> Posterior:
    """The posterior of a result, of all that it determines or of these parameters.

    Raises
    ------
    InputError
        A parameter that the test does not determine, or none at all.
    """
    determined, mean, matrix = covariance(content)
    selected = determined if names is None else names
    unknown = [name for name in selected if name not in determined]
    if unknown or not selected:
        raise InputError("a parameter that the test does not determine", key="parameters",
                         expected=f"one of {', '.join(determined) or '(none is determined)'}",
                         found=unknown[0] if unknown else "none", remedy="look at result.parameters, and at the status")
    at = [determined.index(name) for name in selected]
    return Posterior(tuple(selected), mean[at], matrix[np.ix_(at, at)],
                     tuple(content["parameters"][name]["unit"] for name in selected))


def inference_data(content: Mapping, draws: int, chains: int, seed: int | None) -> arviz.InferenceData:
    """See `idic.notebook.result.Result.to_arviz`."""
    library, posterior = optional("arviz"), posterior_of(content)
    drawn = posterior.draws(draws * chains, seed).reshape(chains, draws, -1)
    return _packed(library, {name: drawn[..., i] for i, name in enumerate(posterior.names)},
                   dict(zip(posterior.names, posterior.units, strict=True)), content.get("title", ""))


def _packed(library: ModuleType, drawn: Mapping[str, np.ndarray], units: Mapping[str, str], title: str):
    """Draws (chains, draws) by name as ArviZ of this version holds them."""
    words = {"inference_library": LIBRARY, "title": title,
             "posterior": "Gaussian: independent draws, not a Markov chain"}
    if hasattr(library, "InferenceData"):
        data = library.from_dict(dict(drawn), attrs=words)
    else:  # from 1.0 on an xarray.DataTree
        data = library.from_dict({"posterior": dict(drawn)}, attrs={"posterior": words})
    for name, unit in units.items():
        data["posterior"][name].attrs["units"] = unit
    return data
