from .design.content import design_content, design_files, plan_pictures
from .design.figures import PlanPictures
from .design.summary import MIN_CONFUSABLE_CORRELATION
from .diagnosis.content import diagnosis_content
from .diagnosis.page_record import diagnosis_page
from .evidence.causes.after_run import cause_after_run
from .evidence.check import check, overlay
from .evidence.cost import expected_cost
from .evidence.free_dic import FreeMotions, noise_floor
from .accepted_frames import AcceptedFrames, run_evidence
from .evidence.hardening import covariance_of
from .evidence.matrices import shown_step, without_modes
from .evidence.volumes.shown_mesh import ShownMesh
from .figures.calibration import calibration_picture
from .figures.law_curve import plot_law
from .figures.maps import RESIDUAL_RANGE, bare, residual_window
from .figures.picture import CYCLE, DPI, Colour, Picture
from .figures.style import DIVERGING, MARKERS, SEQUENTIAL, look, new_figure, to_picture
from .html import filled_in
from .page import all_pictures, draw_sections, parts, plan_sections, render_page
from .residual_image import RANGE, residual_png
from .result.fit_words import NOISE_CHI2
from .result.record import ChannelRecord, FieldFrames, ResidualMaps, RunRecord, Sensitivities
from .result.stress_scale import stress_unit
from .result.words import (
    derived_names, number_text, readable_unit, result_headline, result_verdict, short_names, time_label, with_std,
    undetermined,
)
from .several_runs.batch_numbers import batch_table, scatter
from .several_runs.batch_page import render_batch, batch_headline
from .several_runs.tables_page import comparison_tables, joint_page, comparison_page, comparison_headlines
from .tables import all_tables
from .terminal.batch import batch_lines
from .terminal.design import design_lines
from .terminal.diagnosis import candidates_table, diagnosis_lines
from .terminal.result import result_table, remarks, summary_line, systematic_table, treatments_table, number_with_std
from .terminal.text_table import Line, TextTable

__all__ = [
    "CYCLE", "DIVERGING", "DPI", "MARKERS", "MIN_CONFUSABLE_CORRELATION", "NOISE_CHI2", "RANGE", "RESIDUAL_RANGE",
    "SEQUENTIAL", "AcceptedFrames", "ChannelRecord", "Colour", "FieldFrames", "FreeMotions", "Line", "Picture",
    "PlanPictures", "ResidualMaps", "RunRecord", "Sensitivities", "ShownMesh", "TextTable", "all_pictures",
    "all_tables", "bare", "batch_headline", "batch_lines", "batch_table", "calibration_picture", "candidates_table",
    "cause_after_run", "check", "comparison_headlines", "comparison_page", "comparison_tables", "covariance_of",
    "derived_names", "design_content", "design_files", "design_lines", "diagnosis_content", "diagnosis_lines",
    "diagnosis_page", "draw_sections", "expected_cost", "filled_in", "joint_page", "look", "new_figure", "noise_floor",
    "number_text", "number_with_std", "overlay", "parts", "plan_pictures", "plan_sections", "plot_law",
    "readable_unit", "remarks", "render_batch", "render_page", "residual_png", "residual_window", "result_headline",
    "result_table", "result_verdict", "run_evidence", "scatter", "short_names", "shown_step", "stress_unit",
    "summary_line", "systematic_table", "time_label", "to_picture", "treatments_table", "undetermined", "with_std",
    "without_modes",
]
