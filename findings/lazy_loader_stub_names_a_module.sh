#!/usr/bin/env bash
# lazy_loader 0.6 (SPEC 1): a stub line that names a module is order dependent.
#
# `from .core import point` in a package's __init__.pyi, where `point` is a module of the subpackage `core`, is what a
# type checker accepts and what the same line in __init__.py does. `attach_stub` imports `core` and takes the attribute
# `point` of it, which exists only if somebody has imported that module before. So `from room import point` works or
# raises ImportError, depending on what the process has imported earlier. Declaring the module in the subpackage
# (`lazy_loader.attach(__name__, submodules=["point"])` in core/__init__.py) makes it work in any order.
#
# Seen with Python 3.11, lazy_loader 0.6. Prints three lines and fails if the behaviour changes.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv .venv
.venv/bin/pip install --quiet lazy_loader==0.6

mkdir -p room/core
cat > room/__init__.py <<'PY'
import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
PY
echo "from .core import point" > room/__init__.pyi
touch room/core/__init__.py
echo "value = 1" > room/core/point.py
cp -r room declared
cat > declared/core/__init__.py <<'PY'
import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submodules=["point"])
PY

first=$(.venv/bin/python -c "from room import point" 2>&1 | tail -n 1 || true)
later=$(.venv/bin/python -c "import room.core.point; from room import point; print(point.value)")
cured=$(.venv/bin/python -c "from declared import point; print(point.value)")
echo "first import: $first"
echo "after import room.core.point: $later"
echo "declared as a submodule of core: $cured"
case "$first" in *"cannot import name 'point' from 'room'"*) ;; *) echo "changed: $first" >&2; exit 1 ;; esac
[ "$later" = 1 ] && [ "$cured" = 1 ]
