#!/usr/bin/env bash
# PyAMG 5.4.1: a multigrid hierarchy depends on NumPy's global random generator, and advances it.
#
# `smoothed_aggregation_solver` with its defaults smooths the prolongation with an estimate of a spectral radius whose
# first vector is drawn by `np.random.rand`. Two calls on one matrix in one process so give prolongations that differ by
# some 1e-4, and solutions of other bits; a program that seeds NumPy for itself finds its stream moved. No argument takes
# a generator. Weights of the rows (`weighting="local"`) and Gauss and Seidel's smoother draw nothing.
#
# Seen with Python 3.11, NumPy 2.4, on plane elasticity of 1800 equations. Prints the differences, fails if they change.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv .venv
.venv/bin/pip install --quiet pyamg==5.4.1 "numpy>=2,<3" "scipy>=1.14,<2"

.venv/bin/python - <<'PY'
import numpy as np
import pyamg

matrix, motions = pyamg.gallery.linear_elasticity((30, 30))


def prolongation(**options):
    levels = pyamg.smoothed_aggregation_solver(matrix, B=motions, **options).levels
    return levels[0].P.toarray()


np.random.seed(1)
undisturbed = np.random.rand()
np.random.seed(1)
first, next_number = prolongation(), np.random.rand()
second = prolongation()
difference = np.abs(first - second).max()
print(f"pyamg {pyamg.__version__}: two prolongations of one matrix differ by {difference:.1e}; "
      f"the stream of NumPy goes on at {next_number:.4f} instead of {undisturbed:.4f}")
assert difference > 1e-6 and next_number != undisturbed

drawless = {"smooth": ("jacobi", {"weighting": "local"}), "presmoother": "gauss_seidel", "postsmoother": "gauss_seidel"}
np.random.seed(1)
first, second = prolongation(**drawless), prolongation(**drawless)
assert np.array_equal(first, second) and np.random.rand() == undisturbed
print("with weights of the rows and Gauss-Seidel: the same bits, and nothing drawn")
PY
