#!/usr/bin/env bash
# SurfaceTopography 1.27.1: the height offset of a .sur map (Digital Surf) is not added.
#
# The header holds a spacing and an offset of the heights; what is stored is (height - offset) / spacing. `heights()` only
# multiplies. A map, and the same map 100 um higher, come out as equal: in a series of maps of a surface that rises, the
# rise is gone. surfalize 0.19.2 adds the offset. The unit, UTF-8 in the file, comes out with an additional character.
#
# Seen with Python 3.11 on files that surfalize writes. Prints the mean rise by both libraries and fails if the behaviour
# changes.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv .venv
.venv/bin/pip install --quiet surfalize==0.19.2 SurfaceTopography==1.27.1

.venv/bin/python - <<'PY'
import numpy as np
from SurfaceTopography import open_topography
from surfalize import Surface

heights = np.arange(1.0, 25.0).reshape(4, 6)
Surface(heights, 0.5, 0.5).save("low.sur")
Surface(heights + 100.0, 0.5, 0.5).save("high.sur")


def by_surface_topography(name):
    with open_topography(name) as reader:
        topography = reader.topography()
    return np.asarray(topography.heights(), float), topography.unit


rise_by_surfalize = np.mean(np.asarray(Surface.load("high.sur").data) - np.asarray(Surface.load("low.sur").data))
(low, unit), (high, _) = by_surface_topography("low.sur"), by_surface_topography("high.sur")
print("rise by surfalize          ", rise_by_surfalize)
print("rise by SurfaceTopography  ", np.mean(high - low), " unit", repr(unit))
assert abs(rise_by_surfalize - 100.0) < 1e-4 and abs(np.mean(high - low)) < 1e-4 and unit == "\u00c2\u00b5m"
PY
