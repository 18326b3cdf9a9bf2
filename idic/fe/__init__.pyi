from .body.boundary import constrain, dead_pressure, dofs_of, face_area, traction
from .body.body import Constraints, Direction, Loads, Body, PathControl, Reaction, Section
from .body.variation import Variation
from .crack.cut import Cut, cut_along
from .crack.fracture import ring_around
from .body.seam import Seam
from .crack.seams_of_cuts import with_seams
from .conduction import conductance, conducted, unreached, volume
from .equilibrium import Control
from .external.deck import parse_deck
from .external.inp_writer import ABAQUS_TYPES, inp_text
from .external.process import LOG_FILE, PERMISSION, check_environment, find_program, require_permission
from .external.solver import EXTERNAL, ExternalSetup, ExternalSolver, REASON_FILE, sweep
from .external.solver_output import ExpectedOutput, Solution, gathered, read_calculix_dat
from .extrapolation import increments_to_try, march_extrapolated
from .fields import green_strain, nodal_deformation, nodal_field, nodal_state
from .half_rate import Motion, without_time_error
from .mesh.coarsen import Coarse
from .mesh.curved_edges import curved
from .mesh.edge_morph import EDGE_STD_SHARE, OUTLINE, edges_by_name, free_edges, outward_velocity
from .mesh.element import CELL_TYPES, cell_type
from .mesh.halve import halve
from .mesh.locate import interpolation
from .mesh.mesh import Block, make_mesh, Mesh, PerMesh
from .mesh.morph import Hole, Morph, admissible, find_holes, morphed, on_circle
from .mesh.outline import Boundary, Segments
from .mesh.polygon import Filling, fill, mesh_polygon
from .mesh.refine import raise_order
from .mesh.surface_edges import CORNER_COSINE, followed, normal_axis, second_differences, seen_first
from .products import Linearisation
from .response import Alternative, Responses, first_responses
from .solver.factorisation_cost import Fill, dissected
from .solver.rigid_motion import FreePart, bodies, free_parts
from .solver.threads import solver_threads
from .stress_error import stress_error_responses
from .superposition import superposed
from .time_march import FrameState, PointValues, StepList, march
from .tangent import Tangent, tangents_along

__all__ = [
    "ABAQUS_TYPES", "CELL_TYPES", "CORNER_COSINE", "EDGE_STD_SHARE", "EXTERNAL", "LOG_FILE", "OUTLINE", "PERMISSION",
    "REASON_FILE", "Alternative", "Block", "Body", "Boundary", "Coarse", "Constraints", "Control", "Cut", "Direction",
    "ExpectedOutput", "ExternalSetup", "ExternalSolver", "Fill", "Filling", "FrameState", "FreePart", "Hole",
    "Linearisation", "Loads", "Mesh", "Morph", "Motion", "PathControl", "PerMesh", "PointValues", "Reaction",
    "Responses", "Seam", "Section", "Segments", "Solution", "StepList", "Tangent", "Variation", "admissible", "bodies",
    "cell_type", "check_environment", "conductance", "conducted", "constrain", "curved", "cut_along", "dead_pressure",
    "dissected", "dofs_of", "edges_by_name", "face_area", "fill", "find_holes", "find_program", "first_responses",
    "followed", "free_edges", "free_parts", "gathered", "green_strain", "halve", "increments_to_try", "inp_text",
    "interpolation", "make_mesh", "march", "march_extrapolated", "mesh_polygon", "morphed", "nodal_deformation",
    "nodal_field", "nodal_state", "normal_axis", "on_circle", "outward_velocity", "parse_deck", "raise_order",
    "read_calculix_dat", "require_permission", "ring_around", "second_differences", "seen_first", "solver_threads",
    "stress_error_responses", "superposed", "sweep", "tangents_along", "traction", "unreached", "volume", "with_seams",
    "without_time_error",
]
