from .demo import DemoSize, strip
from .examples import EXAMPLES, write_example
from .experiment_files import IMAGES, LOADS, empty_folder, write_images, write_loads, write_truth
from .meshes import Patch, grid_cells, mesh_patches, strip_with_hole, write_inp
from .ray_tracing import Scene
from .rendering.render import Sensor, Texture, clean_image, painted, record, render
from .section_images import SectionImages, roughness
from .sensors import recorded_by
from .simulated_experiment import simulate
from .solid_speckle import SolidSpeckle
from .stereo_images import traced_images
from .stereo_plate import PlateSize, PlateTest
from .stereo_rig import Rig
from .tomograms.reconstruction import GreyDrift, ReconstructionNoise
from .tomograms.tomograph import Pose, Tomograph
from .virtual_test import LoggedColumn, VirtualTest, medium_speckle, write_virtual_model
from .volume_bar import write_volume

__all__ = [
    "EXAMPLES", "IMAGES", "LOADS", "DemoSize", "GreyDrift", "LoggedColumn", "Patch", "PlateSize", "PlateTest", "Pose",
    "ReconstructionNoise", "Rig", "Scene", "SectionImages", "Sensor", "SolidSpeckle", "Texture", "Tomograph",
    "VirtualTest", "clean_image", "empty_folder", "grid_cells", "medium_speckle", "mesh_patches", "painted", "record",
    "recorded_by", "render", "roughness", "simulate", "strip", "strip_with_hole", "traced_images", "write_example",
    "write_images", "write_inp", "write_loads", "write_truth", "write_virtual_model", "write_volume",
]
