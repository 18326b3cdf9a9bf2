from .calibration.read import read_calibration
from .calibration.rig import CameraRig, Conventions
from .calibration.write import write_rig
from .catalogue.known_formats import FORMATS
from .delimited.text_files import text_of
from .delimited.units import column_factor, factor_between, factor_to, parse_unit, unit_in_name
from .fields.bending import ALLOWED_SHARE, largest_bending
from .fields.chosen_stages import StageRule, chosen_stages, mean_strain, strain_path
from .fields.exports.named_columns import NamedColumns
from .fields.flattened import Flattening
from .fields.outline import MIN_HOLE, PointOutline, loops_of, sides_of_any
from .fields.outline_width import narrowest_width, notched_axis
from .fields.placement import Edges, Placement
from .fields.plane import BENDING_DEGREE, largest_change, out_of_plane, powers
from .fields.series import FieldSeries, FieldStack, MeasuredPoints, UM_PER_MM, detected
from .fields.sound_stages import check_stages
from .frame_names import FrameNames
from .frames.name_orders import natural_key
from .gmsh_mesher import has_gmsh
from .images import FileStack, PICTURE_SUFFIXES, image_entries, open_stack, read_image
from .logs import Log, MatchedLog, check_increasing
from .meshes import mesh_suffixes, read_mesh_file
from .objects.images import ArrayFrames, frames_of
from .objects.log import LOG_IN_MEMORY, log_of
from .objects.mesh import MESH_IN_MEMORY, mesh_of
from .outline_mesh import Drawing, from_image
from .paths import existing_file, matching_files, patterns_of, recorded_order
from .position_sets import points_where
from .mesh_files.raw_mesh import DIMENSION, RawMesh
from .region_mesh import roi_mesh
from .targets.find import KINDS, find_target, kind_of
from .targets.view import TargetView
from .volumes.entry import VolumeEntry
from .volumes.scans import volume_entries

__all__ = [
    "ALLOWED_SHARE", "BENDING_DEGREE", "DIMENSION", "FORMATS", "KINDS", "LOG_IN_MEMORY", "MESH_IN_MEMORY", "MIN_HOLE",
    "PICTURE_SUFFIXES", "UM_PER_MM", "ArrayFrames", "CameraRig", "Conventions", "Drawing", "Edges", "FieldSeries",
    "FieldStack", "FileStack", "Flattening", "FrameNames", "Log", "MatchedLog", "MeasuredPoints", "NamedColumns",
    "Placement", "PointOutline", "RawMesh", "StageRule", "TargetView", "VolumeEntry", "check_increasing",
    "check_stages", "chosen_stages", "column_factor", "detected", "existing_file", "factor_between", "factor_to",
    "find_target", "frames_of", "from_image", "has_gmsh", "image_entries", "kind_of", "largest_bending",
    "largest_change", "log_of", "loops_of", "matching_files", "mean_strain", "mesh_of", "mesh_suffixes",
    "narrowest_width", "natural_key", "notched_axis", "open_stack", "out_of_plane", "parse_unit", "patterns_of",
    "points_where", "powers", "read_calibration", "read_image", "read_mesh_file", "recorded_order", "roi_mesh",
    "sides_of_any", "strain_path", "text_of", "unit_in_name", "volume_entries", "write_rig",
]
