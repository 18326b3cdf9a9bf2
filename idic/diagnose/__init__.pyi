from .chain import SEED, diagnose
from .content import diagnosis_numbers, free_parameters
from .diagnosis import Diagnosis
from .locate.mismatch import Mismatch, SelectedEffect
from .locate.mismatch_words import MOTION, place_words
from .locate.place import element_centres, in_words
from .model_change import LawPair, WindowCurve, law_pairs, window_curves
from .physics.candidate import Candidate, FAMILIES, MESH_TOO_COARSE, Variant, Situation
from .refits.refit import Fit, identification_at
from .refits.refit_job import RefitJob, run_refit
from .residual.evidence import Columns, Evidence
from .residual.excess_left import MIN_EXCESS_Z
from .residual.heldout import Misfit
from .residual.margin import Margin
from .residual.measured_motion import (
    OutOfRegister, by_motion, holds_motion, image_chi2, may_be_out_of_register, out_of_register, with_edge_modes,
)
from .residual.residual_evidence import ResidualEvidence, context_of, residual_evidence
from .residual.residual_maps import map_of_noise, maps_of_evidence, maps_of_identification
from .residual.score import null_model, score
from .residual.spots import DUST, LeftOut, MARGIN_PX, PAINT, Spot
from .residual.thinning import JUDGEMENT, thinned
from .screen.courses import SUPPOSED_EXPANSION_PER_K
from .screen.decoys import decoy_scores
from .screen.library import candidate_library
from .screen.misregistration import HIDDEN_BY_MOTION
from .screen.score_columns import ScoreColumn
from .screen.select import MAX_FAMILYWISE_P, MAX_HIDDEN_VISIBILITY, Ranked, screen_candidates
from .selection.block_step import holds
from .selection.notes import Notes
from .selection.rival import NO_CAUSE, Round
from .selection.stages import stages
from .selection.state import Stage, silent
from .selection.verdict import Verdict
from .spotless import diagnose_without_spots

__all__ = [
    "DUST", "FAMILIES", "HIDDEN_BY_MOTION", "JUDGEMENT", "MARGIN_PX", "MAX_FAMILYWISE_P", "MAX_HIDDEN_VISIBILITY",
    "MESH_TOO_COARSE", "MIN_EXCESS_Z", "MOTION", "NO_CAUSE", "PAINT", "SEED", "SUPPOSED_EXPANSION_PER_K", "Candidate",
    "Columns", "Diagnosis", "Evidence", "Fit", "LawPair", "LeftOut", "Margin", "Misfit", "Mismatch", "Notes",
    "OutOfRegister", "Ranked", "RefitJob", "ResidualEvidence", "Round", "ScoreColumn", "SelectedEffect", "Situation",
    "Spot", "Stage", "Variant", "Verdict", "WindowCurve", "by_motion", "candidate_library", "context_of",
    "decoy_scores", "diagnose", "diagnose_without_spots", "diagnosis_numbers", "element_centres", "free_parameters",
    "holds", "holds_motion", "identification_at", "image_chi2", "in_words", "law_pairs", "map_of_noise",
    "maps_of_evidence", "maps_of_identification", "may_be_out_of_register", "null_model", "out_of_register",
    "place_words", "residual_evidence", "run_refit", "score", "screen_candidates", "silent", "stages", "thinned",
    "window_curves", "with_edge_modes",
]
