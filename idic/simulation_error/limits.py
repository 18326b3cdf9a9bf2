"""How many nodes a simulation may have that serves an error alone; of a larger one the error is not made."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class NodeLimits:
    """Nodes of the finer model, by the cost of its simulation."""

    plane: int = 40_000  # as many as an identification in the plane has on a workstation: one simulation of hundreds
    solid: int = 12_000  # in every frame: 40 CPU s under a load that yields, 36 frames of 9000
    solid_in_few_frames: int = 20_000  # 2 s per frame of rubber
    superposed: int = 40_000  # one factorisation for all frames: 9000 take a second


LIMITS = NodeLimits()
