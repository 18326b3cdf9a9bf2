"""The ablation of the diagnosis.

    python -m idic_studies.ablation sample OUT               draw the worlds (needs CalculiX)
    python -m idic_studies.ablation trace OUT [NAME …]       diagnose them with a trace
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from idic_studies.ablation.runs import traced_sample


def main(arguments: Sequence[str] | None = None) -> None:
    """One step of the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("step", choices=("sample", "trace"))
    parser.add_argument("out", type=Path)
    parser.add_argument("names", nargs="*")
    options = parser.parse_args(arguments)
    if options.step == "trace":
        for name in traced_sample(options.out, options.names):
            sys.stdout.write(f"{name}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
