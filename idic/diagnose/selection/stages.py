"""What a diagnosis says while it works: the sentences of the terminal, the log and the flow, in one table."""

from __future__ import annotations

EVIDENCE = "residual evidence of the identified model"
MESH_ERROR = "simulation on a finer mesh"
PLACE = "side, onset and place of the mismatch"
NEGLECTED = "simulations of bricks of the thickness and of finite strains"
TURNS = "error of plane stress and parameters in turns"
CRACK_PATH = "path of a suspected crack, by refits with a crack of free length"
NULL_FIT = "fit of the identified model"
SCREENING = "screening of the library"
REFIT = "refit"
BOTH_COPIES = "judgement on both copies"
WHOLE_FIT = "fit of the enriched model to the whole recording"
ENRICHED_RESIDUAL = "residual of the enriched model"
FIGURES = "writing figures"
STAGES = (EVIDENCE, PLACE, NULL_FIT, SCREENING, REFIT, BOTH_COPIES, WHOLE_FIT, FIGURES)  # by their first words
QUICK_STAGES = (EVIDENCE, PLACE, NULL_FIT, SCREENING, REFIT, ENRICHED_RESIDUAL, FIGURES)


def stages(quick: bool) -> tuple[str, ...]:
    """First words of the steps of a diagnosis that every one of its kind takes, in their order."""
    return QUICK_STAGES if quick else STAGES
