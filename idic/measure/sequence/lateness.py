"""A camera whose images show the motion earlier or later than those of the others."""

from __future__ import annotations

from collections.abc import Sequence

from idic.measure.sequence.frames import FrameSequence


def late_cameras(sequences: Sequence[FrameSequence]) -> list[str]:
    """Sentences on the cameras that are late, with the lines that say so."""
    return []
