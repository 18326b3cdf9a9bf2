"""The enriched model judged on blocks of the recording: an addition to a finished diagnosis, for real cameras."""

from __future__ import annotations

from dataclasses import asdict, replace

from idic.diagnose.blocks import BlockJudgement, judged_by_blocks
from idic.edge.diagnosis import Diagnosis


def block_judgements(diagnosis: Diagnosis) -> tuple[BlockJudgement, ...]:
    """Both models fitted to parts and measured on the others (`idic.diagnose.blocks`); () where nothing was added."""
    if diagnosis.final is None or not diagnosis.final.usable:
        return ()
    before, after = replace(diagnosis.source, edits={}).load(), diagnosis.source.load()
    return judged_by_blocks(before, after, diagnosis.found.parameters.as_values(), diagnosis.final.values,
                            diagnosis.spacing_px)


def as_content(blocks: tuple[BlockJudgement, ...]) -> list[dict]:
    """The entry ``fit.blocks`` of ``diagnosis.json``."""
    return [asdict(block) | {"better": block.better} for block in blocks]
