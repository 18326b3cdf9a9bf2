"""Compiles loops over points that serve all laws and ends: ``python -m idic.materials.core.precompile NAME...``.

A command starts this process before it needs the loops; it reads them from numba's disk cache afterwards.
"""

from __future__ import annotations

import sys

from idic.materials.core.points import loop

if __name__ == "__main__":
    for name in sys.argv[1:]:
        loop(name)
