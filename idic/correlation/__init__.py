"""Correlation of the images with the simulated motion: normal equations M, b and functional of every frame.

The function that reads like the equations is `nodal_equations` in `image_equations/frame`; pixel by pixel they stand in
`tests/correlation/pixel_equations.py`. A row of pixels passes through six files; the last five are in
`image_equations/`:

1. `pixels/pixel_map`: the element of each pixel and its place in it, found once per mesh and camera.
2. `reference`: grey value, gradient and element matrices of the reference image, made once.
3. `image_motion`: motion of the nodes -> coefficients, F^-1 and det F of the elements: one record per frame, which all
   that follows reads, the residual of the pixels (`residual`) and the noise of the reference as well.
4. `image_kernel`: position in the frame -> spline value -> residual -> sums over the element.
5. `frame`: element sums -> H and q at the nodes with the convected gradient (docs/method.md, equations 3.2 to 4.3).
6. `system`: H and q times the nodal sensitivities -> M and b of the frame; frame-local unknowns are eliminated, frames
   added (docs/method.md, sections 2 and 8).

`frame_equations` joins these steps for an experiment. `image_equations/context` holds its input, `views/` turns the
simulated motion into motion in the image, `channels` adds forces and gauges, `cameras` joins several cameras,
`shared_noise` closes the sums for the noise of the reference image (docs/method.md, section 7).

Steps 2 to 5 depend on the kind of reference image. `image_equations/comparison` is the protocol of all kinds: grey
images (`image_equations/grey`), heights of a surface and of a cross-section (`height/`), measured fields (`field/`),
the motion of a free FE-DIC (`measured`). `experiment_reference` makes the kind that an experiment has.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
