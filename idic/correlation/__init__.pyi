from .channels import channel_equations, channel_values
from .equations_of_frame import (
    at_fixed_pixels, frame_equations, frame_system, global_columns, turned_response, with_all_cameras,
)
from .experiment_reference import build_experiment_reference, camera_at
from .field.equations import FieldEquations
from .field.point_map import build_point_map
from .field.reference import FieldReference
from .height.cross_section import SectionReference
from .height.section_nodes import section_motion
from .image_equations.comparison import Reference
from .image_equations.context import CorrelationContext, FrameResponse
from .image_equations.equations import ColumnSum, FrameEquations, Weights, dense
from .image_equations.frame import NodalEquations, nodal_equations
from .image_equations.grey import GreyReference, blur_bias, frame_spline
from .image_equations.image_kernel import residual_pass
from .image_equations.reference import MAX_GRADIENT_NOISE, ReferenceImage
from .image_equations.residual import ResidualMap, residual_map
from .image_equations.system import (
    CorrelationSystem, FrameRecord, LocalEquations, OpenSums, eliminate, local_covariance, reduce_systems,
)
from .measured import MeasuredReference, mean_information
from .pinhole.agreement import COARSE_PX, Seen, speckle_agreement
from .pinhole.ray_map import build_ray_map
from .pinhole.texture import MIN_CORRELATION, TexturePair, determined_by_texture, texture_pairs
from .pixels.cells import CELLS, N_NODES
from .pixels.pixel_map import PixelMap
from .pixels.projection import NodalField, onto_nodes
from .shared_noise import MAX_DENSE_UNKNOWNS, closed_system, ordinary_variance
from .views.pinhole_view import PinholeView, in_space, nodal_normals
from .views.kinds import ViewKind
from .views.view import View, view_of
from .volume.reference import VolumeReference
from .volume.voxel_map import build_voxel_map

__all__ = [
    "CELLS", "COARSE_PX", "MAX_DENSE_UNKNOWNS", "MAX_GRADIENT_NOISE", "MIN_CORRELATION", "N_NODES", "ColumnSum",
    "CorrelationContext", "CorrelationSystem", "FieldEquations", "FieldReference", "FrameEquations", "FrameRecord",
    "FrameResponse", "GreyReference", "LocalEquations", "MeasuredReference", "NodalEquations", "NodalField",
    "OpenSums", "PinholeView", "PixelMap", "Reference", "ReferenceImage", "ResidualMap", "SectionReference", "Seen",
    "TexturePair", "View", "ViewKind", "VolumeReference", "Weights", "at_fixed_pixels", "blur_bias",
    "build_experiment_reference", "build_point_map", "build_ray_map", "build_voxel_map", "camera_at",
    "channel_equations", "channel_values", "closed_system", "dense", "determined_by_texture", "eliminate",
    "frame_equations", "frame_spline", "frame_system", "global_columns", "in_space", "local_covariance",
    "mean_information", "nodal_equations", "nodal_normals", "onto_nodes", "ordinary_variance", "reduce_systems",
    "residual_map", "residual_pass", "section_motion", "speckle_agreement", "texture_pairs", "turned_response",
    "view_of", "with_all_cameras",
]
