from .dic.affine_motion import AffineMotions
from .dic.boundary import BoundaryStart, edge_modes, virtual_boundaries, with_boundary_start
from .dic.camera_floor import CameraFloor
from .dic.field import field_frame
from .dic.frame import dic_frame, measured_nodes
from .dic.noise import fitted_dof, residual_noise
from .dic.regularisation import Regularisation, build_smoother
from .dic.section import section_field, smoothing_length
from .dic.stack import DicStack, dic_stack
from .dic.stereo import surface_motion
from .dic.still import declared_stack, find_still_frames
from .sequence.frames import FrameSequence
from .dic.volume import volume_motion
from .fields.columns import field_columns
from .fields.free import Seen, in_mm
from .fields.in_space import SeenInSpace
from .fields.readings import Reading, readings
from .fields.series import FieldSeries, simulated_states
from .fields.strain import MEASURES, rotated, strain
from .fields.surface import surface_of

__all__ = [
    "MEASURES", "AffineMotions", "BoundaryStart", "CameraFloor", "DicStack", "FieldSeries", "FrameSequence", "Reading",
    "Regularisation", "Seen", "SeenInSpace", "build_smoother", "declared_stack", "dic_frame", "dic_stack",
    "edge_modes", "field_columns", "field_frame", "find_still_frames", "fitted_dof", "in_mm", "measured_nodes",
    "readings", "residual_noise", "rotated", "section_field", "simulated_states", "smoothing_length", "strain",
    "surface_motion", "surface_of", "virtual_boundaries", "volume_motion", "with_boundary_start",
]
