#!/usr/bin/env bash
# tifffile 2026.3.3: of an OME series over several files a member that is missing is read as an image of zeros.
#
# A microscope writes one TIFF per time and names all of them in the OME header of each. If one file is lost on the way
# to the laboratory, `tifffile.imread` of any other still returns the whole series: the lost time is an image of zeros,
# no exception and no warning, one line of the logging module. To a reader that looks at the array alone the lost frame
# is a black picture that somebody took.
#
# Seen with Python 3.11. Prints the means of the frames before and after a loss and fails if the behaviour changes.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv .venv
.venv/bin/pip install --quiet tifffile==2026.3.3

.venv/bin/python - <<'PY'
import pathlib
import warnings

import numpy as np
import tifffile

NAMES = [f"test_{k}.ome.tif" for k in range(3)]
BLOCKS = "".join(f'<TiffData FirstT="{k}" FirstC="0" FirstZ="0" IFD="0" PlaneCount="1">'
                 f'<UUID FileName="{name}">urn:uuid:00000000-0000-0000-0000-00000000000{k}</UUID></TiffData>'
                 for k, name in enumerate(NAMES))


def header(k):
    return ('<?xml version="1.0" encoding="UTF-8"?>'
            '<OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06" '
            f'UUID="urn:uuid:00000000-0000-0000-0000-00000000000{k}"><Image ID="Image:0" Name="test">'
            '<Pixels ID="Pixels:0" DimensionOrder="XYCZT" Type="uint16" SizeX="32" SizeY="24" SizeC="1" SizeZ="1" '
            f'SizeT="3"><Channel ID="Channel:0:0" SamplesPerPixel="1"/>{BLOCKS}</Pixels></Image></OME>')


for k, name in enumerate(NAMES):
    tifffile.imwrite(name, np.full((24, 32), 100 * (k + 1), np.uint16), description=header(k), metadata=None)
whole = tifffile.imread(NAMES[0])
pathlib.Path(NAMES[1]).unlink()
with warnings.catch_warnings():
    warnings.simplefilter("error")
    rest = tifffile.imread(NAMES[0])
print(f"tifffile {tifffile.__version__}")
print("three files:", whole.shape, [float(frame.mean()) for frame in whole])
print("the second is lost:", rest.shape, [float(frame.mean()) for frame in rest])
assert whole.shape == rest.shape == (3, 24, 32), "the behaviour changed"
assert [float(frame.mean()) for frame in rest] == [100.0, 0.0, 300.0], "the behaviour changed"
PY
