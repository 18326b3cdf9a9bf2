"""Time-resolved integrated digital image correlation: images and forces in, constitutive parameters out.

The equation: `nodal_equations` in `idic/correlation/image_equations/frame.py` makes the residual f(x) - g(x + u) and
its normal equations M dlam = b (Neggers et al. 2015, equations 6, 7 and 10). What comes before and after is described
in `idic/correlation/__init__.py`; derivations are in docs/method.md.

`identify` finds the parameters of an experiment, in memory or into a RUN folder: of an `Experiment` of Python objects
(images, mesh, log, law), of an experiment folder, or of several. A result has tables and pictures (docs/python.md);
`load_result` reads it again.

`load_experiment` reads a folder, `build_forward` and `solve` simulate it, `write_report` makes the page of a RUN.
`write_example` writes a folder to try, `write_design` judges a test that is not made yet. An `Experiment` of images and
a mesh alone has a `free_motion`; `dic_stack` measures the displacement of all frames of any experiment. `flow` holds
the Prefect flows. Each is loaded at its first use.
"""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile

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


def keep_compiled_somewhere(places, environment) -> None:
    """Give numba a temporary folder for compiled kernels where none of its own may be written.

    places : folders in which numba would make its own, one of which is enough; environment : ``os.environ``
    """
    def is_writable(place: str) -> bool:
        while not os.path.isdir(place):
            place = os.path.dirname(place)
        try:
            with tempfile.TemporaryFile(dir=place):
                return True
        except OSError:
            return False

    if environment.get("NUMBA_CACHE_DIR") or any(is_writable(os.path.abspath(place)) for place in places):
        return
    folder, owner = tempfile.mkdtemp(prefix="idic-compiled-"), os.getpid()
    environment["NUMBA_CACHE_DIR"] = folder  # for worker processes too
    atexit.register(lambda: shutil.rmtree(folder, ignore_errors=True) if os.getpid() == owner else None)


def _caches() -> tuple[str, str]:
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return os.path.dirname(__file__), home


keep_compiled_somewhere(_caches(), os.environ)


def __getattr__(name: str):
    from importlib import import_module

    if name == "flow":
        return import_module("idic_flows.public")
    if name not in _ROOMS:
        raise AttributeError(f"module 'idic' has no attribute {name!r}")
    return getattr(import_module(f"idic.{_ROOMS[name]}"), name)


def __dir__():
    return sorted(__all__)
