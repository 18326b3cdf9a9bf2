"""The identification: loop, covariance, result. The package is also the call ``idic.identify(experiment)``.

    result = idic.identify(experiment)                      # in memory
    result = idic.identify(experiment, out="runs/first")    # with a RUN folder

`idic.notebook.identify.identify` is what is called; it has every argument.
"""

import sys
from importlib import import_module
from types import ModuleType


class _CallablePackage(ModuleType):
    """Importing a module of the package binds its name in `idic`; the name has to stay a function there."""

    def __call__(self, experiment, out=None, **settings):
        return import_module("idic.notebook.identify").identify(experiment, out, **settings)


sys.modules[__name__].__class__ = _CallablePackage
