"""Reference and one pass over a scan of SIDE voxels cubed with ELEMENTS cubed hex8: prints voxels, blocks, MB at rest,
CPU seconds of the voxel map, of the reference and of the pass with four fields, and the largest memory in MB.

python volume_job.py SIDE ELEMENTS

Scans are a periodic texture that is cut out block by block, as files would be read: none is held whole.
"""

import resource
import sys
import time

import numpy as np
from bench_jobs import brick_px
from scipy.ndimage import gaussian_filter

from idic.correlation import VolumeReference, build_voxel_map
from idic.fe import Block

PERIOD, RIM, PARAMETERS = 96, 6.0, 4


class PeriodicVolumes:
    """Two scans; the second is the first moved by one slice."""

    def __init__(self, side: int):
        self.shape, self.n_frames, self.labels = (side,) * 3, 2, ("f", "g")
        noise = np.random.default_rng(0).normal(size=(PERIOD,) * 3).astype(np.float32)
        texture = gaussian_filter(noise, 1.5, mode="wrap")
        self.texture = np.clip(128.0 + 40.0 * texture / texture.std(), 0, 255).astype(np.uint8)

    def block(self, k: int, z: slice, y: slice, x: slice) -> np.ndarray:
        places = [np.arange(*part.indices(n)) % PERIOD for part, n in zip((z, y, x), self.shape, strict=True)]
        places[0] = (places[0] - k) % PERIOD
        return self.texture[np.ix_(*places)]


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def main() -> None:
    side, elements = int(sys.argv[1]), int(sys.argv[2])
    small = PeriodicVolumes(64)
    nodes, conn = brick_px(64, 4, RIM)
    VolumeReference.of(build_voxel_map(nodes, [Block("hex8", conn)], small.shape), small, (0,)).equations(
        small, 1, np.zeros(nodes.shape)).gram(np.zeros((nodes.size, PARAMETERS)))  # compiled
    at_rest, volumes = peak_mb(), PeriodicVolumes(side)
    nodes, conn = brick_px(side, elements, RIM)
    times = [time.process_time()]
    voxel_map = build_voxel_map(nodes, [Block("hex8", conn)], volumes.shape)
    times.append(time.process_time())
    reference = VolumeReference.of(voxel_map, volumes, (0,))
    times.append(time.process_time())
    u = 0.002 * (nodes - side / 2) + [0.3, -0.2, 1.1]
    reference.equations(volumes, 1, u).gram(np.random.default_rng(1).normal(size=(u.size, PARAMETERS)))
    times.append(time.process_time())
    print(voxel_map.n_pixels, len(voxel_map.blocks) - 1, f"{at_rest:.0f}", *(f"{s:.2f}" for s in np.diff(times)),
          f"{peak_mb():.0f}")


if __name__ == "__main__":
    main()
