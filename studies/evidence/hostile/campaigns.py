"""The campaigns by name."""

from __future__ import annotations

from idic_studies.evidence.hostile.bases import Base, demonstration
from idic_studies.evidence.hostile.command_lines import command_lines
from idic_studies.evidence.hostile.counting import Case
from idic_studies.evidence.hostile.exports import exports
from idic_studies.evidence.hostile.requests import requests
from idic_studies.evidence.hostile.runs import damaged, forged

CAMPAIGNS = {"forged": forged, "damaged": damaged, "exports": exports, "requests": requests, "commands": command_lines}


def case_of(name: str, base: Base | None = None) -> Case:
    """The case of a campaign; `base`: its experiment and RUN, else the demonstration."""
    return CAMPAIGNS[name](base or demonstration())
