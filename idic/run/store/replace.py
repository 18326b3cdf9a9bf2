"""Files and folders put in the place of others, also while another program looks at them.

On Windows a file that another program has open, a virus scanner or a reader of the RUN, can neither be replaced nor
renamed; it is let go after moments.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

PATIENCE_S = 5.0 if os.name == "nt" else 0.0
PAUSE_S = 0.02


def replace_file(source: Path | str, target: Path | str, patience_s: float = PATIENCE_S) -> None:
    """`os.replace`, tried again while another program holds one of the two.

    Raises
    ------
    PermissionError
        It is held longer than `patience_s`, or this user may not write there.
    """
    end = time.monotonic() + patience_s
    while True:
        try:
            os.replace(source, target)
            return
        except PermissionError:
            if time.monotonic() >= end:
                raise
        time.sleep(PAUSE_S)
