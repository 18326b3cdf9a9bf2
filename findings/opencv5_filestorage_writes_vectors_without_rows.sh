#!/usr/bin/env bash
# opencv-python-headless 5.0.0.93: `FileStorage` writes a one-dimensional array, such as five lens coefficients, as
# `opencv-nd-matrix` with `sizes` in place of `opencv-matrix` with `rows` and `cols`.
#
# OpenCV 4.14 writes the same array as 5 rows and 1 column. A program that takes rows and cols from a calibration file
# finds the camera matrix and no lens. The first line changes too, from `%YAML:1.0` to `%YAML 1.2`. OpenCV 4 reads the new
# file, and gives (5, 1) where OpenCV 5 gives (5,).
#
# Seen with Python 3.11. Prints both files and fails if the behaviour changes.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
cat > write.py <<'PY'
import sys

import cv2
import numpy as np

storage = cv2.FileStorage(sys.argv[1], cv2.FILE_STORAGE_WRITE)
storage.write("camera_matrix", np.eye(3))
storage.write("distortion", np.array([0.1, -0.05, 0.001, 0.0, 0.0]))
storage.release()
PY
cat > read.py <<'PY'
import cv2

storage = cv2.FileStorage("calibration-5.yml", cv2.FILE_STORAGE_READ)
node = storage.getNode("distortion")
print("read by OpenCV", cv2.__version__, node.mat().shape)
PY
for version in 4.14.0.94 5.0.0.93; do
  major=${version%%.*}
  python3 -m venv ".venv-$major"
  ".venv-$major/bin/pip" install --quiet "opencv-python-headless==$version"
  ".venv-$major/bin/python" write.py "calibration-$major.yml"
  echo "OpenCV $version:"
  cat "calibration-$major.yml"
done
grep -A 2 'distortion: !!opencv-matrix' calibration-4.yml | grep -q 'rows: 5'
grep -A 1 'distortion: !!opencv-nd-matrix' calibration-5.yml | grep -q 'sizes: \[ 5 \]'
test "$(head -n 1 calibration-4.yml)" = '%YAML:1.0'
test "$(head -n 1 calibration-5.yml)" = '%YAML 1.2'
for major in 4 5; do ".venv-$major/bin/python" read.py; done | tee read.txt
grep -q '4.14.0 (5, 1)' read.txt
grep -q '5.0.0 (5,)' read.txt
