from .demo import DEMO_TRUTH, DemoSize, LENGTH, RADIUS, REDUCED, THICKNESS, WIDTH, strip
from .examples import EXAMPLES, write_example
from .experiment_files import IMAGES, LOADS, empty_folder, write_images, write_loads, write_truth
from .meshes import MERGE_DISTANCE, Patch, grid_cells, mesh_patches, strip_with_hole, write_inp
from .render import Sensor, Texture, clean_image, painted, record
from .section_images import SectionImages, roughness
from .sensors import recorded_by
from .simulated_experiment import simulate
from .tomograms.reconstruction import GreyDrift, ReconstructionNoise
from .tomograms.tomograph import Pose, Tomograph
from .virtual_test import LoggedColumn, VirtualTest, medium_speckle, write_virtual_model
from .volume_bar import write_volume

__all__ = [
    "DEMO_TRUTH", "EXAMPLES", "IMAGES", "LENGTH", "LOADS", "MERGE_DISTANCE", "RADIUS", "REDUCED", "THICKNESS", "WIDTH",
    "DemoSize", "GreyDrift", "LoggedColumn", "Patch", "Pose", "ReconstructionNoise", "SectionImages", "Sensor",
    "Texture", "Tomograph", "VirtualTest", "clean_image", "empty_folder", "grid_cells", "medium_speckle",
    "mesh_patches", "painted", "record", "recorded_by", "roughness", "simulate", "strip", "strip_with_hole",
    "write_example", "write_images", "write_inp", "write_loads", "write_truth", "write_virtual_model", "write_volume",
]
