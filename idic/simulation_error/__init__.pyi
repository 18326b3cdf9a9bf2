from .bricks import Bricks, ErrorChanges, reason_against_bricks, simulated_sheet, thickness_error
from .comparison import ErrorInFrames, ModelPoint
from .mesh import brick_mesh_error, can_be_refined, mesh_error, mesh_error_in
from .refinement import refined
from .small_strains import strain_error, strain_error_in

__all__ = [
    "Bricks", "ErrorChanges", "ErrorInFrames", "ModelPoint", "brick_mesh_error", "can_be_refined", "mesh_error",
    "mesh_error_in", "reason_against_bricks", "refined", "simulated_sheet", "strain_error", "strain_error_in",
    "thickness_error",
]
