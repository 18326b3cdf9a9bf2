"""Free FE-DIC: the displacement of every node measured from the images alone, with no law and no force.

    motion = dic_stack(experiment)              # a whole experiment: u_px, status, residual, noise
    frame = dic_frame(reference, spline, start, smoother)    # one frame
"""

from idic.measure.dic.boundary import BoundaryStart, with_boundary_start
from idic.measure.dic.frame import DicFrame, dic_frame
from idic.measure.dic.regularisation import Regularisation, Smoother, build_smoother
from idic.measure.dic.stack import DicStack, dic_stack
from idic.measure.dic.start import build_pyramid, coarse_motion, descend

__all__ = ["BoundaryStart", "DicFrame", "DicStack", "Regularisation", "Smoother", "build_pyramid",
           "build_smoother", "coarse_motion", "descend", "dic_frame", "dic_stack", "with_boundary_start"]
