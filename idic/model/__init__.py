"""The modelled experiment: recording, boundary conditions and loads, and the forward simulation.

In the order of reading:

``experiment.py``       the record `Experiment`: images, times, channels, mesh, cameras, materials, boundaries, options
``drives.py``           prescribed displacements: logged, fixed, measured (`DriveTable`)
``boundary_modes.py``   virtual boundaries: shapes along an edge times courses in time; ``mode_words.py``: their names
``loads.py``            forces, tractions, pressures (`LoadHistories`)
``temperature.py``      the temperature of every node (`NodalTemperature`)
``heterogeneity.py``    stiffness that varies over the body
``readings.py``         channels that are no reactions (`Readings`)
``forward.py``          `ForwardModel`: parameters in; displacements, channels and derivatives of every frame out
``black_box.py``        `ExternalForward`: the same with an external solver
``first_frames.py``   the experiment up to a frame
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
