"""A study without a server, on processes of this machine.

The folder is that of `idic study`, which can continue it.

    python -m idic_studies.cases.plain coverage --out DIR --size full --processes 16
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from multiprocessing import get_context
from pathlib import Path

from idic.errors import InputError
from idic_studies.cases.case import CaseJob, render, run_case
from idic_studies.cases.registry import SIZES, STUDIES, make_study
from idic_studies.cases.store import StudyStore, write_page


def run_plainly(name: str, out: str | Path, size: str = "full", only: Sequence[str] | None = None,
                processes: int = 1) -> Path:
    """Run the unfinished cases of a study and write ``OUT/study.html``; returns its path.

    Raises
    ------
    InputError
        Unknown study or cases, a folder in use.
    """
    study, store = make_study(name, size), StudyStore(out)
    chosen = study.select(only)
    with store.claim(f"study {name} {size}", title=study.title), get_context("spawn").Pool(processes) as pool:
        used = [r.name for r in study.renderings if any(case.images == r.name for case in chosen)]
        pool.map(render, [CaseJob(str(store.run), name, size, key) for key in used], chunksize=1)
        missing = [case.key for case in chosen
                   if not store.has_case(case.key, case.ident(study.rendering(case.images)))]
        for _ in pool.imap_unordered(run_case, [CaseJob(str(store.run), name, size, key) for key in missing]):
            pass
        return write_page(store, study)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m idic_studies.cases.plain",
                                     description=__doc__.splitlines()[0])
    parser.add_argument("name", choices=sorted(STUDIES))
    parser.add_argument("--out", required=True)
    parser.add_argument("--size", choices=SIZES, default="full")
    parser.add_argument("--only", action="append")
    parser.add_argument("--processes", type=int, default=1)
    options = parser.parse_args()
    try:
        run_plainly(options.name, options.out, options.size, options.only, options.processes)
    except InputError as problem:
        sys.stderr.write(f"{problem}\n")
        sys.exit(2)
