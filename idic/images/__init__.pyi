from .camera import CAMERA_PARAMETERS, Camera
from .camera_motion import CameraMotion
from .gaussian_lowpass import (
    REACH_STDS, blur_column, lowpass, lowpass_weights, mirrored_rim_px, noise_share, still_gain,
)
from .interpolate import DEGREES, Spline, noise_gain, prefilter
from .lens_camera import LensCamera, left_jacobian, rotation_of
from .lenses.brown import PinholeCamera
from .lenses.lens_models import LENS_MODELS, LENS_PARAMETERS
from .pattern import DOT_RADIUS, Pattern, dense_speckle, sparse_speckle
from .placed_camera import PLACED_TURNS, PLACEMENT_STEM, PlacedCamera
from .matched_blur import PIXEL_BLUR_PX, derivative_maps, fineness_of, matched_gain, matching_weights, mean_shift
from .quality.compression import BLOCK_PX, compressed_at
from .quality.drift import MIN_TOLD_SHIFT_PX, drift_note, shifts
from .quality.field_noise import FieldNoise, MIN_POINTS, MIN_STAGES
from .quality.gap_marks import gap_mark
from .quality.gradient_noise import gradient_noise_share, without_noise
from .quality.noise import NoiseModel, image_noise, still_noise
from .quality.noise_covariance import NoiseCovariance, coloured, pixel_gain, sum_gain
from .quality.round_trip import spline_error
from .quality.saturation import largest_value, saturated_share, sensor_levels
from .quality.speckle import edge_blur, speckle_size
from .quality.stabilise import StabilisedStack, Stabiliser
from .quality.subpixel_blur import subpixel_blur
from .quality.tiles_on_material import TilesOnMaterial
from .quality.volume_noise import cube_corners, grey_change, volume_noise, whole_shift
from .rigid_motion import RIGID, RigidMotion
from .spline_filter import MIRROR_PAD_PX, POLES, filter_block
from .stack import ArrayStack, Stack
from .stack_views import LeadingFrames, LitStack, NoisyStack, RoundedStack, StackView
from .volumes.any_camera import AnyCamera
from .volumes.scanner import SCANNER, Scanner, ScannerMotion
from .volumes.sections import GAP_PX, picture, picture_places, picture_shape
from .volumes.stack import ArrayVolumes, VolumeStack
from .taps import cubic_value, quintic_value, weight_polynomials

__all__ = [
    "BLOCK_PX", "CAMERA_PARAMETERS", "DEGREES", "DOT_RADIUS", "GAP_PX", "LENS_MODELS", "LENS_PARAMETERS", "MIN_POINTS",
    "MIN_STAGES", "MIN_TOLD_SHIFT_PX", "MIRROR_PAD_PX", "PIXEL_BLUR_PX", "PLACED_TURNS", "PLACEMENT_STEM", "POLES",
    "REACH_STDS", "RIGID", "SCANNER", "AnyCamera", "ArrayStack", "ArrayVolumes", "Camera", "CameraMotion",
    "FieldNoise", "LeadingFrames", "LensCamera", "LitStack", "NoiseCovariance", "NoiseModel", "NoisyStack", "Pattern",
    "PinholeCamera", "PlacedCamera", "RigidMotion", "RoundedStack", "Scanner", "ScannerMotion", "Spline",
    "StabilisedStack", "Stabiliser", "Stack", "StackView", "TilesOnMaterial", "VolumeStack", "blur_column", "coloured",
    "compressed_at", "cube_corners", "cubic_value", "dense_speckle", "derivative_maps", "drift_note", "edge_blur",
    "filter_block", "fineness_of", "gap_mark", "gradient_noise_share", "grey_change", "image_noise", "largest_value",
    "left_jacobian", "lowpass", "lowpass_weights", "matched_gain", "matching_weights", "mean_shift", "mirrored_rim_px",
    "noise_gain", "noise_share", "picture", "picture_places", "picture_shape", "pixel_gain", "prefilter",
    "quintic_value", "rotation_of", "saturated_share", "sensor_levels", "shifts", "sparse_speckle", "speckle_size",
    "spline_error", "still_gain", "still_noise", "subpixel_blur", "sum_gain", "volume_noise", "weight_polynomials",
    "whole_shift", "without_noise",
]
