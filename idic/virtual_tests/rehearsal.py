"""A tiny identification that leaves its kernels in numba's disk cache: ``python -m idic.virtual_tests.rehearsal``.

`idic demo` starts it beside its own first steps where nothing has been compiled yet. Mesh, law and options are those
of the demo, hence the signatures that are compiled; images and numbers mean nothing.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from string import Template

import numpy as np
from scipy.ndimage import gaussian_filter

from idic.laws import compiled_loop
from idic.run import SerialRunner, Workplace, identify_run
from idic.virtual_tests.demo import DemoSize, TOML
from idic.virtual_tests.experiment_files import empty_folder, write_images, write_loads
from idic.virtual_tests.meshes import write_inp

PIXEL_MM, SHAPE = 0.2, (100, 150)
GRIP_MM, FORCE_N = np.array([0.0, 0.01, 0.02]), np.array([0.0, 600.0, 1200.0])


def write_rehearsal(out: Path | str) -> Path:
    """Write the demo's experiment in small, with speckle that does not move; returns its experiment.toml."""
    folder, rng = empty_folder(out), np.random.default_rng(0)
    speckle = 128.0 + 150.0 * gaussian_filter(rng.standard_normal(SHAPE), 1.0)
    write_images(folder, [np.clip(speckle + rng.standard_normal(SHAPE), 0, 255).astype(np.uint8) for _ in GRIP_MM])
    write_loads(folder, np.arange(len(GRIP_MM)), {"force_N": FORCE_N, "grip_displacement_mm": GRIP_MM})
    mesh = DemoSize.mesh("quad8", DemoSize.of_example().user)
    write_inp(mesh, folder / "mesh.inp", "rehearsal")
    path = folder / "experiment.toml"
    path.write_text(Template(TOML).substitute(pixel_size=PIXEL_MM, column=(SHAPE[1] - 1) / 2, row=(SHAPE[0] - 1) / 2,
                                              noise_std_gv=1.0), encoding="utf-8")
    return path


def rehearse() -> None:
    """Compile what an identification needs, in the order in which `idic demo` comes to need it.

    `idic demo` compiles its law meanwhile, which is then read from the cache.
    """
    for kind in ("tangent", "directional", "stress"):
        compiled_loop(kind)
    with tempfile.TemporaryDirectory() as folder:
        identify_run(write_rehearsal(Path(folder) / "experiment"), Path(folder) / "run",
                     overrides={"options.max_iterations": 1}, workplace=Workplace(runner=_PreparingRunner()))


class _PreparingRunner(SerialRunner):
    """Does at once what others do in the background: the image kernels are compiled before the first simulation."""

    def background(self, function, job, name) -> Callable[[], None]:
        """See `TaskRunner.background`."""
        function(job)
        return super().background(function, job, name)


if __name__ == "__main__":
    rehearse()
