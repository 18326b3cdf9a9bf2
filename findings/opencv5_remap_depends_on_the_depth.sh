#!/usr/bin/env bash
# opencv-python-headless 5.0.0.93: whether remap is exact to sub-pixel depends on the depth of the image.
#
# A ramp of one grey value per pixel is moved by 0.01, 0.02 ... 0.99 px with cv2.remap, linear interpolation and maps of
# float32. For a float32 image the answer is exact. For the same image as float64 the map is rounded to 1/32 px without a
# word: a motion of 0.01 px gives none, the largest error is 0.015 px. Converting to double "to be on the safe side"
# costs a digital image correlation a hundred times its noise; a test of the warp in one depth says nothing of the other.
#
# Seen with Python 3.11, NumPy 2. Prints the largest error of either depth and fails if the behaviour changes.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv .venv
.venv/bin/pip install --quiet opencv-python-headless==5.0.0.93

.venv/bin/python - <<'PY'
import cv2
import numpy as np

ramp = np.tile(np.arange(64.0), (16, 1))
column, row = np.meshgrid(np.arange(8, 56), np.arange(4, 12))


def largest_error(image):
    errors = []
    for shift in np.arange(1, 100) / 100.0:
        moved = cv2.remap(image, (column + shift).astype(np.float32), row.astype(np.float32), cv2.INTER_LINEAR)
        errors.append(np.abs(moved - (column + shift)).max())
    return max(errors)


single, double = largest_error(ramp.astype(np.float32)), largest_error(ramp)
small = cv2.remap(ramp, (column + 0.01).astype(np.float32), row.astype(np.float32), cv2.INTER_LINEAR) - column
print(f"OpenCV {cv2.__version__}")
print(f"float32: largest error {single:.5f} px")
print(f"float64: largest error {double:.5f} px; a motion of 0.01 px is read as {small.mean():.5f} px")
assert single < 1e-4 and 0.014 < double < 0.017 and abs(small).max() < 1e-6, "the behaviour changed"
PY
