#!/usr/bin/env bash
# Numba 0.68.1: a cached closure that is passed as a first-class function may run the code of another one.
#
# Two closures of one factory, each compiled first in a process of its own with `cache=True`, have the same symbol: its
# name counts the functions of the process. A third process loads both from the cache. Called directly each does what it
# should; passed to a compiled function as an argument of `FunctionType`, both are looked up by that name, and the one
# that was loaded later runs for both, without a word. In the order of loading, looked up one by one, the addresses are
# right.
#
# Seen with Python 3.11, llvmlite 0.50. Prints both answers, fails if they change.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv .venv
.venv/bin/pip install --quiet numba==0.68.1 "numpy>=2,<3"

cat > alike.py <<'PY'
import numba

signature = numba.float64(numba.float64)


def made(size):
    @numba.njit(signature, cache=True)
    def law(x):
        return size * x
    return law
PY
.venv/bin/python -c "import alike; alike.made(1.0)"
.venv/bin/python -c "import alike; alike.made(2.0)"
.venv/bin/python - <<'PY'
import numba
from alike import made, signature


@numba.njit(numba.float64(numba.types.FunctionType(signature), numba.float64))
def entry(law, x):
    return law(x)


laws = made(1.0), made(2.0)
direct, passed = [law(1.0) for law in laws], [entry(law, 1.0) for law in laws]
print(f"numba {numba.__version__}: called {direct}, passed as arguments {passed}")
assert direct == [1.0, 2.0] and passed == [2.0, 2.0]
PY
