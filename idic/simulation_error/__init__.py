"""The errors of a simulation that another simulation shows: by its mesh, by plane stress, by small strains.

``limits.py``          how many nodes a simulation may have that serves an error alone
``refinement.py``      the test on a finer mesh, and its motion back on the given one
``real_thickness.py``  the test as solid elements of the thickness of a sheet
``comparison.py``      both simulations at one point and their difference, in every frame or in a few
``mesh.py``            by the mesh, of the given elements or of the bricks behind a sheet
``bricks.py``          by plane stress, with its derivatives by the parameters of the laws
``small_strains.py``   by small strains
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
