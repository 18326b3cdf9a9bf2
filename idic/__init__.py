"""Time-resolved Integrated Digital Image Correlation: images and force in, constitutive parameters out.

The functions below are loaded when they are first used; ``import idic`` alone costs nothing.
"""

from __future__ import annotations

__version__ = "0.1.0"

_LAZY = {
    "identify_experiment": "idic.edge.plain",
    "load_experiment": "idic.edge.config",
    "write_example": "idic.edge.example",
    "write_design": "idic.edge.design",
    "write_report": "idic.edge.report",
    "build_forward": "idic.forward",
    "solve": "idic.forward",
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
