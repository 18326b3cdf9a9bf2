"""A tiny identification that leaves its kernels in numba's disk cache: ``python -m idic.virtual_tests.rehearsal``.

`idic demo` starts it beside its own first steps where nothing has been compiled yet. Mesh, law and options are those
of the demo, hence the signatures that are compiled; images and numbers mean nothing.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from string import Template

import numpy as np
from scipy.ndimage import gaussian_filter

from idic.laws import compiled_loop
from idic.run import Console, OpenRun, SerialRunner, Timing, compile_image_kernels, plan_run
from idic.virtual_tests.demo import FULL, LENGTH, RADIUS, TOML, WIDTH
from idic.virtual_tests.experiment_files import empty_folder, write_images, write_loads
from idic.virtual_tests.meshes import strip_with_hole, write_inp

PIXEL_MM, SHAPE = 0.2, (100, 150)
GRIP_MM, FORCE_N = np.array([0.0, 0.01, 0.02]), np.array([0.0, 600.0, 1200.0])


def write_rehearsal(out: Path | str) -> Path:
    """Write the demo's experiment in small, with speckle that does not move; returns its experiment.toml."""
    folder, rng = empty_folder(out), np.random.default_rng(0)
    speckle = 128.0 + 150.0 * gaussian_filter(rng.standard_normal(SHAPE), 1.0)
    write_images(folder, [np.clip(speckle + rng.standard_normal(SHAPE), 0, 255).astype(np.uint8) for _ in GRIP_MM])
    write_loads(folder, np.arange(len(GRIP_MM)), {"force_N": FORCE_N, "grip_displacement_mm": GRIP_MM})
    write_inp(strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", *FULL.user), folder / "mesh.inp", "rehearsal")
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
        planned = plan_run([write_rehearsal(Path(folder) / "experiment")], Path(folder) / "run",
                           {"options.max_iterations": 1})
        planned.check("auto")
        with planned.claim(False):
            planned.ingest(SerialRunner())
            compile_image_kernels(planned.first_job)
            OpenRun(planned, SerialRunner(), "auto", Timing(), time.perf_counter(), Console()).identify()


if __name__ == "__main__":
    rehearse()
