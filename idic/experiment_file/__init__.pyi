from .checks.model import corners_px, seen_nodes, seen_region, visible_cells
from .experiment_tables import ExperimentTables
from .init import initial_experiment
from .initial.fields import find_stages
from .inputs import inputs_of
from .laws.free_curves import BY_EVIDENCE, NEIGHBOURS, SPECTRUM, SURFACE, StatedCurve
from .laws.free_surface import KIND, SPREAD
from .load import ExperimentFolder, load_experiment, read_experiment
from .objects import ORIGIN, Objects, from_objects, further_files
from .recording import Frames
from .schema.experiment import Circle, Points
from .schema.experiment_file import ExperimentFile
from .schema.options import DesignTable
from .tables.camera_noise import recorded, with_stabilised_images
from .tables.gauges import gauges
from .tables.temperatures import with_copied_images
from .toml_file import EXPERIMENT_FILE, locate, read_toml, to_toml, validated, with_law_files, with_overrides

__all__ = [
    "BY_EVIDENCE", "EXPERIMENT_FILE", "KIND", "NEIGHBOURS", "ORIGIN", "SPECTRUM", "SPREAD", "SURFACE", "Circle",
    "DesignTable", "ExperimentFile", "ExperimentFolder", "ExperimentTables", "Frames", "Objects", "Points",
    "StatedCurve", "corners_px", "find_stages", "from_objects", "further_files", "gauges", "initial_experiment",
    "inputs_of", "load_experiment", "locate", "read_experiment", "read_toml", "recorded", "seen_nodes", "seen_region",
    "to_toml", "validated", "visible_cells", "with_copied_images", "with_law_files", "with_overrides",
    "with_stabilised_images",
]
