"""Compiles loops over points that serve all laws and ends: ``python -m idic.materials.core.precompile NAME...``.

For a process beside the one that needs them later and finds them in numba's disk cache.
"""

from __future__ import annotations

import sys

from idic.materials.core.points import loop

if __name__ == "__main__":
    for name in sys.argv[1:]:
        loop(name)
