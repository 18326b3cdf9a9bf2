"""``python -m idic``: the same as the command ``idic``."""

import sys
from pathlib import Path

if not sys.flags.safe_path and Path(sys.path[0] or ".").resolve() != Path(__file__).resolve().parents[1]:
    del sys.path[0]  # the working folder: nothing in it is imported by its name

from idic.cli import main

if __name__ == "__main__":
    main()
