#!/usr/bin/env bash
# surfalize 0.19.2: a .plu map of Sensofar is read two values too early.
#
# In the file the heights follow the size of their layer, two whole numbers. `Surface.load` takes these for the first two
# heights, and shifts all others by two points: the map looks right, each row begins with the last two points of the row
# before, and the first two heights are 1e-43. SurfaceTopography 1.27.1 reads the same file right.
#
# Seen with Python 3.11, on a file built here to the layout and on files of the instrument. Prints the first heights by
# both libraries and fails if the behaviour changes.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv .venv
.venv/bin/pip install --quiet surfalize==0.19.2 SurfaceTopography==1.27.1

.venv/bin/python - <<'PY'
import struct

import numpy as np
from SurfaceTopography import open_topography
from surfalize import Surface

ny, nx = 4, 6
heights = np.arange(1.0, 25.0, dtype="<f4").reshape(ny, nx)
calibration = struct.pack("<IIIfffffff", ny, nx, 0, 1.0, 0.5, 0.5, 0.0, 0.0, 1.0, 0.0)
measurement = struct.pack("<5I5IdfII", 3, 0, 0, 0, 0, nx, ny, nx, ny, 1, 0.1, 100.0, 10, 0)
layers = struct.pack("<8BI", 0, 1, 0, 0, 0, 0, 0, 0, 1)
with open("map.plu", "wb") as stream:
    stream.write(b"Mon Nov 30 10:00:00 2026".ljust(128, b"\0") + bytes(4 + 256) + calibration + measurement + layers
                 + struct.pack("<II", ny, nx) + heights.tobytes() + struct.pack("<ff", 1.0, 24.0))

by_surfalize = np.asarray(Surface.load("map.plu").data, float)
with open_topography("map.plu") as reader:
    by_surface_topography = np.asarray(reader.topography().heights(), float).T
print("in the file        ", heights.ravel()[:5])
print("surfalize          ", by_surfalize.ravel()[:5])
print("SurfaceTopography  ", by_surface_topography.ravel()[:5])
assert (by_surface_topography == heights).all()
assert (by_surfalize.ravel()[2:] == heights.ravel()[:-2]).all() and by_surfalize.ravel()[0] < 1e-40
PY
