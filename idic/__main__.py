"""``python -m idic``: the same as the command ``idic``."""

import sys
from pathlib import Path

if __name__ == "__main__":  # worker processes load this module under another name, and have the path of this one
    if not sys.flags.safe_path and Path(sys.path[0] or ".").resolve() != Path(__file__).resolve().parents[1]:
        del sys.path[0]  # the working folder: nothing in it is imported by its name
    from idic.cli import main

    main()
