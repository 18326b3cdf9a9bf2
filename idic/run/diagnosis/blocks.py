"""The enriched model judged on blocks of the recording: an addition to a finished diagnosis, for real cameras."""

from __future__ import annotations

from dataclasses import asdict, replace

from idic.diagnose.residual.blocks import BlockJudgement, FittedModel, judged_by_blocks, reason_against_later_frames
from idic.run.diagnosis.chain import Diagnosis


def block_judgements(diagnosis: Diagnosis) -> tuple[BlockJudgement, ...]:
    """Both models fitted to parts and measured on the others (`idic.diagnose.residual.blocks`); () where nothing was added."""
    if diagnosis.final is None or not diagnosis.final.usable:
        return ()
    before, after = replace(diagnosis.source, edits={}).load(), diagnosis.source.load()
    return judged_by_blocks(FittedModel(before, diagnosis.found.parameters.as_values(), diagnosis.found.local),
                            FittedModel(after, diagnosis.final.values, diagnosis.final.local), diagnosis.grid)


def left_out(diagnosis: Diagnosis) -> tuple[str, ...]:
    """What of the recording judges nothing, and why: cautions for the reader."""
    if diagnosis.final is None or not diagnosis.final.usable:
        return ()
    reason = reason_against_later_frames(diagnosis.found.experiment)
    return () if reason is None else (reason,)


def as_content(blocks: tuple[BlockJudgement, ...]) -> list[dict]:
    """The entry ``fit.blocks`` of ``diagnosis.json``."""
    return [asdict(block) | {"better": block.better} for block in blocks]
