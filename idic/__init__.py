"""Time-resolved integrated digital image correlation: images and forces in, constitutive parameters out.

The equation: `nodal_equations` in `idic/correlation/image_equations/frame.py` makes the residual f(x) - g(x + u) and
its normal equations M dlam = b (Neggers et al. 2015, equations 6, 7 and 10). What comes before and after is described
in `idic/correlation/__init__.py`; derivations are in docs/method.md.

`identify` finds the parameters of an experiment, in memory or into a RUN folder: of an `Experiment` of Python objects
(images, mesh, log, law), of an experiment folder, or of several. A result has tables and pictures (docs/python.md);
`load_result` reads it again.

`load_experiment` reads a folder, `build_forward` and `solve` simulate it, `write_report` makes the page of a RUN.
`write_example` writes a folder to try, `write_design` judges a test that is not made yet, `dic_stack` measures the
displacement of all frames without a model. `flow` holds the Prefect flows. Each is loaded at its first use.
"""

from __future__ import annotations

__version__ = "0.1.0"

_ROOMS = {
    "Experiment": "notebook", "identify": "notebook", "load_result": "notebook",
    "load_experiment": "experiment_file",
    "build_forward": "model", "solve": "model",
    "dic_stack": "measure",
    "write_design": "run", "write_report": "run",
    "write_example": "virtual_tests",
}

__all__ = ["__version__", "flow", *_ROOMS]  # noqa: PLE0604  (ruff does not see that the keys are strings)


def __getattr__(name: str):
    from importlib import import_module

    if name == "flow":
        return import_module("idic_flows.public")
    if name not in _ROOMS:
        raise AttributeError(f"module 'idic' has no attribute {name!r}")
    return getattr(import_module(f"idic.{_ROOMS[name]}"), name)


def __dir__():
    return sorted(__all__)
