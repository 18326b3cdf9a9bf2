"""A diagnosis as one function call, without a Prefect server; and the files that every diagnosis leaves."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from idic.diagnose.screen.candidate import Candidate
from idic.run.diagnosis.blocks import as_content, block_judgements, left_out
from idic.run.diagnosis.chain import Diagnosis, diagnose
from idic.run.diagnosis.enriched import write_enriched
from idic.run.diagnosis.files import titles_of, write_diagnosis
from idic.run.diagnosis.report import write_page
from idic.run.diagnosis.where import where_pictures
from idic.workers.dask_executor import open_cluster


def diagnose_run(run: str | Path, workers: int = 0, stage: Callable[[str], None] = lambda text: None,
                 library: Sequence[Candidate] | None = None, resume: bool = False, blocks: bool = False) -> dict:
    """Diagnose a finished RUN; writes diagnosis.json, diagnosis.html and the enriched experiment.

    Parameters
    ----------
    workers : 0 runs everything in this process, otherwise so many Dask processes
    stage : called with what is being done
    library : candidates to try, all of them without it
    resume : refits that an interrupted diagnosis has finished are not repeated
    blocks : with a judgement on parts of the recording that had no part in the fit (`idic.diagnose.residual.blocks`)

    Returns
    -------
    The content of ``RUN/diagnosis.json``.

    Raises
    ------
    InputError
        If the RUN holds no finished identification; nothing has been written then.
    """
    began = time.perf_counter()
    with open_cluster(workers) as runner:
        return write_all(run, diagnose(run, runner, stage, library=library, resume=resume), began, blocks)


def write_all(run: str | Path, diagnosis: Diagnosis, began: float, blocks: bool = False) -> dict:
    """Everything that a diagnosis leaves in the RUN folder.

    began : time.perf_counter() at its start; blocks : judge on blocks of the recording, too
    """
    judged = block_judgements(diagnosis) if blocks else ()
    enriched = None
    if diagnosis.final is not None and diagnosis.final.usable:
        enriched = write_enriched(diagnosis.source, diagnosis.residual_after.context.experiment,
                                  diagnosis.final.values, diagnosis.verdict.named)
    content = write_diagnosis(run, diagnosis, enriched, time.perf_counter() - began, as_content(judged),
                              left_out(diagnosis) if blocks else ())
    further = () if diagnosis.mismatch is None else where_pictures(diagnosis.residual, diagnosis.mismatch,
                                                                   diagnosis.always, diagnosis.side, diagnosis.active,
                                                                   diagnosis.bent)
    write_page(run, diagnosis, content, titles_of(diagnosis), further)
    return content
