from .bricks import (
    Bricks, ErrorChanges, bricks_of, reason_against_bricks, simulated_sheet, thickness_error,
)
from .comparison import ErrorInFrames, ModelPoint
from .mesh import brick_mesh_error, can_be_refined, mesh_error, mesh_error_in, without_reactions
from .real_thickness import extruded, gripped_ends, thick
from .refinement import projection, refined
from .small_strains import strain_error, strain_error_in, with_finite_strains

__all__ = [
    "Bricks", "ErrorChanges", "ErrorInFrames", "ModelPoint", "brick_mesh_error", "bricks_of", "can_be_refined",
    "extruded", "gripped_ends", "mesh_error", "mesh_error_in", "projection", "reason_against_bricks", "refined",
    "simulated_sheet", "strain_error", "strain_error_in", "thick", "thickness_error", "with_finite_strains",
    "without_reactions",
]
