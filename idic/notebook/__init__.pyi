from .experiment import Experiment
from .identification import identify, load_result

__all__ = [
    "Experiment", "identify", "load_result",
]
