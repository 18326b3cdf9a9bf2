from .design.figures import PlanPictures
from .design.page import assumed, design_table, draw_design, parameter_rows, render_design, said, short
from .design.summary import MIN_CONFUSABLE_CORRELATION, compare, joint_summary, summary
from .design.words import best_plan, in_words, largest_motion, motion_unit, seen_area
from .diagnosis.headline import diagnosis_headline, left_over
from .diagnosis.not_excluded import not_excluded
from .diagnosis.page import STANDINGS, draw_diagnosis_sections, render_diagnosis_page
from .diagnosis.record import Curve, DiagnosisRecord, KNOWN_ERROR_COUNTED
from .diagnosis.spot_figure import spot_picture
from .diagnosis.spots import with_spots
from .diagnosis.where import WhereRecord, pictures
from .diagnosis.words import heldout_drop, sentence, standing_of, strongest
from .evidence.causes.after_run import cause_after_run
from .evidence.check import check, overlay
from .evidence.cost import expected_cost
from .evidence.free_dic import FreeMotions, free_motions, noise_floor, with_residuals
from .evidence.hardening import covariance_of, hardening_curves
from .evidence.law import law_curves
from .evidence.matrices import shown_step, without_modes
from .evidence.points import point_maps_of
from .evidence.practice import frame_views, practice_of
from .evidence.relaxation import relaxation_curves
from .evidence.rubber import rubber_curves
from .evidence.volumes.shown_mesh import ShownMesh, shown_mesh
from .evidence.section import section_fields, with_profiles, with_section_floor
from .evidence.temperature import temperature_factors
from .evidence.yield_surface import yield_surfaces
from .figures.calibration import calibration_picture
from .figures.law_curve import plot_law
from .figures.maps import RESIDUAL_RANGE, bare, residual_window
from .figures.picture import BLACK, BLUE, CYCLE, DPI, FAINT, GREY, ORANGE, Picture, RED
from .figures.style import DIVERGING, MARKERS, SEQUENTIAL, look, new_figure, to_picture
from .html import filled_in
from .page import all_pictures, draw_sections, in_turn, parts, plan_sections, render_page
from .residual_image import RANGE, residual_png
from .result.fit_words import NOISE_CHI2, against_free, in_words_of
from .result.record import ChannelRecord, FieldFrames, ResidualMaps, RunRecord, Sensitivities
from .result.stress_scale import held_stresses, in_ratios, stress_unit
from .result.words import (
    advice, between_specimens, derived_names, left_out, not_explained, number_text, parts_of_std, readable_unit,
    result_headline, result_verdict, short_names, time_label, two_digits, undetermined, virtual_boundaries, with_std,
)
from .several_runs.batch_numbers import batch_table, scatter
from .several_runs.batch_page import batch_headline, batch_parameters, draw_batch, render_batch
from .several_runs.tables_page import comparison_picture, comparison_tables, joint_page, of_fields, render_tables
from .tables import all_tables
from .treatments import treatment_table

__all__ = [
    "BLACK", "BLUE", "CYCLE", "DIVERGING", "DPI", "FAINT", "GREY", "KNOWN_ERROR_COUNTED", "MARKERS",
    "MIN_CONFUSABLE_CORRELATION", "NOISE_CHI2", "ORANGE", "RANGE", "RED", "RESIDUAL_RANGE", "SEQUENTIAL", "STANDINGS",
    "ChannelRecord", "Curve", "DiagnosisRecord", "FieldFrames", "FreeMotions", "Picture", "PlanPictures",
    "ResidualMaps", "RunRecord", "Sensitivities", "ShownMesh", "WhereRecord", "advice", "against_free", "all_pictures",
    "all_tables", "assumed", "bare", "batch_headline", "batch_parameters", "batch_table", "best_plan",
    "between_specimens", "calibration_picture", "cause_after_run", "check", "compare", "comparison_picture",
    "comparison_tables", "covariance_of", "derived_names", "design_table", "diagnosis_headline", "draw_batch",
    "draw_design", "draw_diagnosis_sections", "draw_sections", "expected_cost", "filled_in", "frame_views",
    "free_motions", "hardening_curves", "held_stresses", "heldout_drop", "in_ratios", "in_turn", "in_words",
    "in_words_of", "joint_page", "joint_summary", "largest_motion", "law_curves", "left_out", "left_over", "look",
    "motion_unit", "new_figure", "noise_floor", "not_excluded", "not_explained", "number_text", "of_fields", "overlay",
    "parameter_rows", "parts", "parts_of_std", "pictures", "plan_sections", "plot_law", "point_maps_of", "practice_of",
    "readable_unit", "relaxation_curves", "render_batch", "render_design", "render_diagnosis_page", "render_page",
    "render_tables", "residual_png", "residual_window", "result_headline", "result_verdict", "rubber_curves", "said",
    "scatter", "section_fields", "seen_area", "sentence", "short", "short_names", "shown_mesh", "shown_step",
    "spot_picture", "standing_of", "stress_unit", "strongest", "summary", "temperature_factors", "time_label",
    "to_picture", "treatment_table", "two_digits", "undetermined", "virtual_boundaries", "with_profiles",
    "with_residuals", "with_section_floor", "with_spots", "with_std", "without_modes", "yield_surfaces",
]
