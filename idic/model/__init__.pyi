from .camera_time import is_camera_time
from .drives import COMPONENTS, DriveTable, boundary_parameters, mode_shapes
from .records.experiment import Experiment
from .records.model import Model
from .records.options import Options, Stage
from .records.parts import (
    Channel, Column, Constant, Controlled, Correction, Crack, Drive, Heterogeneity, Load, Material, Measured,
    Parametrised, Prescribed, Temperature, TemperatureField, corrections_of,
)
from .records.recording import CorrelatedNoise, Depth, FieldPoints, FurtherCamera, Noise, Recording
from .first_frames import leading_frames, selected_frames
from .forward import ForwardModel, build_forward, solve, tried_increments
from .records.free_course import KNOTS, TEMPERATURE, hats, jump_frame, jump_name, knot_frames, knot_name, without_knot
from .records.gauges import Gauge, KINDS
from .heterogeneity import nodes_of, strayed
from .loads import load_parameters
from .mode_words import in_words, is_mode, motions
from .records.motion_error import MotionError
from .readings import Readings
from .remedies import Remedies
from .records.stated_curve import StatedCurve
from .temperature import nodal_temperature
from .terms.channels.channel_term import ChannelTerm
from .terms.channels.channel_terms import CHANNEL_TERMS, channel_term, shown_value
from .terms.corrections.correction_term import CorrectedMotion, CorrectionTerm
from .terms.corrections.correction_terms import CORRECTION_TERMS, term_of_motion

__all__ = [
    "CHANNEL_TERMS", "COMPONENTS", "CORRECTION_TERMS", "KINDS", "KNOTS", "TEMPERATURE", "Channel", "ChannelTerm",
    "Column", "Constant", "Controlled", "CorrectedMotion", "Correction", "CorrectionTerm", "CorrelatedNoise", "Crack",
    "Depth", "Drive", "DriveTable", "Experiment", "FieldPoints", "ForwardModel", "FurtherCamera", "Gauge",
    "Heterogeneity", "Load", "Material", "Measured", "Model", "MotionError", "Noise", "Options", "Parametrised",
    "Prescribed", "Readings", "Recording", "Remedies", "Stage", "StatedCurve", "Temperature", "TemperatureField",
    "boundary_parameters", "build_forward", "channel_term", "corrections_of", "hats", "in_words", "is_camera_time",
    "is_mode", "jump_frame", "jump_name", "knot_frames", "knot_name", "leading_frames", "load_parameters",
    "mode_shapes", "motions", "nodal_temperature", "nodes_of", "selected_frames", "shown_value", "solve", "strayed",
    "term_of_motion", "tried_increments", "without_knot",
]
