#!/usr/bin/env bash
# SurfaceTopography 1.27.1: points that were not measured come out of a binary .sdf map as heights of -inf.
#
# ISO 25178-71 marks such a point with the smallest number of the data's type, -1.8e308 for doubles. `heights()` gives a
# masked array in which this point is not masked, multiplied by the scale; `has_undefined_data` is False. A mean, a plane
# or a filter of the map is then not finite. The same map as .x3p comes out masked, and surfalize 0.19.2 reads NaN.
#
# Seen with Python 3.11 on files that surfalize writes. Prints the row with the missing point by both libraries and fails
# if the behaviour changes.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv .venv
.venv/bin/pip install --quiet surfalize==0.19.2 SurfaceTopography==1.27.1

.venv/bin/python -W ignore::RuntimeWarning - <<'PY'
import numpy as np
from SurfaceTopography import open_topography
from surfalize import Surface

heights = np.arange(1.0, 25.0).reshape(4, 6)
heights[1, 2] = np.nan
for name in ("map.sdf", "map.x3p"):
    Surface(heights, 0.5, 0.5).save(name)
    by_surfalize = np.asarray(Surface.load(name).data, float)[1]
    with open_topography(name) as reader:
        topography = reader.topography()
        row = topography.heights()[:, 1]
    print(f"{name}  surfalize {by_surfalize}  SurfaceTopography {row}  undefined: {topography.has_undefined_data}")
    assert np.isnan(by_surfalize[2])
    if name == "map.sdf":
        assert row.data[2] == -np.inf and not np.ma.getmaskarray(row)[2] and not topography.has_undefined_data
    else:
        assert np.ma.getmaskarray(row)[2] and topography.has_undefined_data
PY
