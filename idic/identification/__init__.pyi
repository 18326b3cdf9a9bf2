from .coarse import CoarseFit
from .design import Design, JointDesign
from .discrepancy.normal_equations import Component, DiscrepancySystem, joined, reason_against
from .driver import StageHook, describe_evaluation, log_progress, next_local, run_loop
from .frame_fit import FrameFit, PointFit, experiment_result, mean_chi2, used_fits
from .free_form.evidence import ChosenKnots
from .free_form.forms import FreeCurve, FreeForm, FreeSpectrum, FreeSurface
from .free_motion.free_motion_start import (
    measured_nodes, measured_start, motion_in_space, needs_free_dic, needs_motion_in_space, starts_from_dic,
    without_edges,
)
from .free_motion.two_step import check_method, measured_reference, regularisation_of
from .free_motion.volume_axes import check_volume_axes
from .in_memory import Identification, evaluate_at, identify, point_discrepancy
from .joint import Joint, joint_names
from .judgement.local_residual import ElementSums, LocalResidual
from .judgement.remedies import Remedy
from .judgement.significance import p_text, z_text
from .kept_simulation import MAX_SECOND_ORDER_STD, Path
from .loop import experiment_of, start
from .noise.channel_noise import repeated_readings
from .noise.input_noise import logged_noise, measured_noise, with_measured_noise
from .plan.planned_test import (
    DOT_SIGMA_PER_SPECKLE, VIRTUAL_SPECKLE, Plan, planned_speckle, recorded_or_planned,
)
from .plan.separation import expected_odds
from .point import chunk_frames, chunk_system, closed_evaluation, point_context
from .result import Analysis, build_result
from .sensitivity import checked_sensitivity, choose_sensitivity, perturbations
from .specimens.own_values import specimens_content
from .start_search import FoundStart, StartTrial, search
from .step.estimator import may_begin_generalised
from .step.increments import chooses_increments, planned_increments
from .step.parameter_covariance import scaled_system
from .step.schedule import first_free, seen_in, wants_search
from .step.stages import resolve_stages
from .step.state import GENERALISED, HALF_RATE, ORDINARY, AcceptedPoint, Evaluation, LoopState, Trial
from .systematic.discretisation import discretisation_bias, time_step_bias
from .systematic.spread import Assessment, determined_values, ratios_of, with_bias, with_spread
from .systematic.treatments import Treatment, treatments
from .weights import noise_weights, paper_weights

__all__ = [
    "DOT_SIGMA_PER_SPECKLE", "GENERALISED", "HALF_RATE", "MAX_SECOND_ORDER_STD", "ORDINARY", "VIRTUAL_SPECKLE",
    "AcceptedPoint", "Analysis", "Assessment", "ChosenKnots", "CoarseFit", "Component", "Design", "DiscrepancySystem",
    "ElementSums", "Evaluation", "FoundStart", "FrameFit", "FreeCurve", "FreeForm", "FreeSpectrum", "FreeSurface",
    "Identification", "Joint", "JointDesign", "LocalResidual", "LoopState", "Path", "Plan", "PointFit", "Remedy",
    "StageHook", "StartTrial", "Treatment", "Trial", "build_result", "check_method", "check_volume_axes",
    "checked_sensitivity", "choose_sensitivity", "chooses_increments", "chunk_frames", "chunk_system",
    "closed_evaluation", "describe_evaluation", "determined_values", "discretisation_bias", "evaluate_at",
    "expected_odds", "experiment_of", "experiment_result", "first_free", "identify", "joined", "joint_names",
    "log_progress", "logged_noise", "may_begin_generalised", "mean_chi2", "measured_nodes", "measured_noise",
    "measured_reference", "measured_start", "motion_in_space", "needs_free_dic", "needs_motion_in_space", "next_local",
    "noise_weights", "p_text", "paper_weights", "perturbations", "planned_increments", "planned_speckle",
    "point_context", "point_discrepancy", "ratios_of", "reason_against", "recorded_or_planned", "regularisation_of",
    "repeated_readings", "resolve_stages", "run_loop", "scaled_system", "search", "seen_in", "specimens_content",
    "start", "starts_from_dic", "time_step_bias", "treatments", "used_fits", "wants_search", "with_bias",
    "with_measured_noise", "with_spread", "without_edges", "z_text",
]
