"""Time-resolved Integrated Digital Image Correlation: images and force in, constitutive parameters out.

The functions below are loaded when they are first used; ``import idic`` alone costs nothing.
"""

from __future__ import annotations

__version__ = "0.1.0"

_LAZY = {
    "identify_experiment": "idic.run.plain",
    "load_experiment": "idic.experiment_file.load",
    "write_example": "idic.virtual_tests.examples",
    "write_design": "idic.run.design.write",
    "write_report": "idic.run.reporting.write",
    "build_forward": "idic.model.forward",
    "solve": "idic.model.forward",
    "dic_stack": "idic.dic",
}

__all__ = ["__version__", *_LAZY]


def __getattr__(name: str):
    if name not in _LAZY:
        raise AttributeError(f"module 'idic' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_LAZY[name]), name)


def __dir__():
    return sorted(__all__)
