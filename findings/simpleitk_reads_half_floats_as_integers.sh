#!/usr/bin/env bash
# SimpleITK 2.5.7: a TIFF of 16-bit floats is read as unsigned integers that hold the bit patterns of the floats.
#
# Reconstructions are stored as half floats to save space; tifffile writes them with SampleFormat 3 (IEEE float) and 16
# bits per sample, as TIFF 6.0 has it. SimpleITK's reader looks at the 16 bits and not at the sample format: the image is
# "16-bit unsigned integer", without an exception or a warning. Grey values of 0.5 and 1.0 become 14336 and 15360, those
# below zero 32768 and more: still a picture, with another contrast and its dark side turned to white. 32-bit floats of
# the same volume are read as floats.
#
# Seen with Python 3.11, tifffile 2026.3.3. Prints what is read and fails if the behaviour changes.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv .venv
.venv/bin/pip install --quiet simpleitk==2.5.7 tifffile==2026.3.3 numpy

.venv/bin/python - <<'PY'
import numpy as np
import SimpleITK
import tifffile

volume = np.linspace(-1.0, 1.0, 5 * 8 * 10).reshape(5, 8, 10)
kinds, values = {}, {}
for dtype in (np.float16, np.float32):
    name = f"{np.dtype(dtype).name}.tif"
    tifffile.imwrite(name, volume.astype(dtype))
    tags = tifffile.TiffFile(name).pages[0].tags
    assert (tags["SampleFormat"].value, tags["BitsPerSample"].value) == (3, 8 * np.dtype(dtype).itemsize)
    image = SimpleITK.ReadImage(name)
    kinds[name] = image.GetPixelIDTypeAsString()
    values[name] = SimpleITK.GetArrayFromImage(image)
    print(f"SimpleITK {SimpleITK.Version.VersionString()}, {name}: {kinds[name]}, from {values[name].min()} to "
          f"{values[name].max()} (written: -1.0 to 1.0)")
assert kinds["float32.tif"] == "32-bit float", "the behaviour changed"
assert kinds["float16.tif"] == "16-bit unsigned integer", "the behaviour changed"
assert (values["float16.tif"] == volume.astype(np.float16).view(np.uint16)).all(), "the behaviour changed"
PY
