"""The equations of a scan against the same voxel by voxel in SciPy, for every solid and spline."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from volumes.voxel_equations import voxel_equations

from idic.correlation import VolumeReference, build_voxel_map
from idic.errors import InputError
from idic.fe import Block, Mesh, raise_order
from idic.images import ArrayVolumes

SIDE, N = 44, 2
FIVE_TETS = (((0, 1, 3, 4), (1, 2, 3, 6), (4, 6, 5, 1), (4, 7, 6, 3), (1, 3, 4, 6)),
             ((0, 1, 2, 5), (0, 2, 3, 7), (0, 5, 7, 4), (2, 7, 5, 6), (0, 2, 7, 5)))  # neighbours mirror each other


def scans(seed=1):
    rng = np.random.default_rng(seed)
    f, g = (gaussian_filter(rng.normal(size=(SIDE,) * 3), 1.2) for _ in range(2))
    return [(128.0 + 40.0 * part / part.std()).astype(np.float32) for part in (f, 0.7 * f + 0.3 * g)]


def solid(cell, bend):
    """Nodes (n, 3) in voxels and elements (n, n_nodes) of a block with moved nodes."""
    rng, x = np.random.default_rng(2), np.linspace(8.0, 33.0, N + 1)
    Z, Y, X = np.meshgrid(x, x, x, indexing="ij")
    nodes = np.stack([X, Y, Z], axis=-1).reshape(-1, 3) + bend * rng.normal(size=((N + 1) ** 3, 3))
    def at(a, b, c):
        return (c * (N + 1) + b) * (N + 1) + a
    bricks = [(sum(place), [at(a, b, c), at(a + 1, b, c), at(a + 1, b + 1, c), at(a, b + 1, c), at(a, b, c + 1),
                            at(a + 1, b, c + 1), at(a + 1, b + 1, c + 1), at(a, b + 1, c + 1)])
              for place in np.ndindex(N, N, N) for a, b, c in [place]]
    linear = "hex8" if cell.startswith("hex") else "tet4"
    conn = np.array([brick for _, brick in bricks] if linear == "hex8"
                    else [[brick[k] for k in tet] for parity, brick in bricks for tet in FIVE_TETS[parity % 2]])
    if cell == linear:
        return nodes, conn
    mesh = raise_order(Mesh(nodes, (Block(linear, conn),)))
    return mesh.nodes + 0.3 * bend * rng.normal(size=mesh.nodes.shape), mesh.blocks[0].connectivity


@pytest.mark.parametrize("degree", [3, 5])
@pytest.mark.parametrize("cell, bend", [("hex8", 0.0), ("hex8", 0.5), ("tet4", 0.5), ("tet10", 0.5), ("hex20", 0.5)])
def test_the_sums_are_those_of_the_voxels(cell, bend, degree):
    f, g = scans()
    nodes, conn = solid(cell, bend)
    voxel_map = build_voxel_map(nodes, [Block(cell, conn)], f.shape)
    points = voxel_map.points()
    assert len(np.unique(points, axis=0)) == voxel_map.n_pixels  # no voxel counts twice
    rng = np.random.default_rng(4)
    u = 0.02 * (nodes - 20.0) + [12.0, 0.7, 0.3] + 0.3 * rng.normal(size=nodes.shape)
    directions = rng.normal(size=(*nodes.shape, 4))
    volumes = ArrayVolumes([f, g])
    equations = VolumeReference.of(voxel_map, volumes, (0,), degree).equations(volumes, 1, u, "none")
    gram = equations.gram(directions.reshape(-1, 4))
    owner = np.repeat(voxel_map.element, voxel_map.pixels_per_element)
    twin = voxel_equations(cell, nodes, conn, owner, points, f, g, u, directions, degree)
    assert equations.n_lost == (~twin.valid).sum() > 0
    np.testing.assert_allclose(gram.matrix, twin.M, rtol=0, atol=3e-6 * np.abs(twin.M).max())
    size = np.linalg.norm(np.abs(twin.L).T @ np.abs(twin.r))
    np.testing.assert_allclose(gram.rhs, twin.b, rtol=0, atol=1e-6 * size)
    assert equations.rr == pytest.approx(twin.r @ twin.r, rel=1e-6)


def test_every_voxel_of_a_block_of_bricks_has_one_element():
    nodes, conn = solid("hex8", 0.0)
    voxel_map = build_voxel_map(nodes, [Block("hex8", conn)], (SIDE,) * 3)
    assert voxel_map.n_pixels == 25**3  # 8 … 32: those on the far faces lie outside by a hair


@pytest.mark.parametrize("whole", [True, False])
def test_the_voxels_of_a_scan_that_is_not_kept_whole_are_given_back(monkeypatch, whole):
    """The next pass makes them anew, to the same bits."""
    monkeypatch.setattr("idic.correlation.volume.voxel_map.VOXELS_PER_BLOCK", 4000)
    monkeypatch.setattr("idic.correlation.volume.voxel_map.LEAST_BLOCK_PX", 12)
    nodes, conn = solid("hex8", 0.0)
    volumes = ArrayVolumes(scans())
    voxel_map = build_voxel_map(nodes, [Block("hex8", conn)], (SIDE,) * 3)
    n_blocks = len(voxel_map.blocks) - 1
    if not whole:
        kept = VolumeReference.of(voxel_map, volumes, (0,)).stored[0].nbytes
        monkeypatch.setattr("idic.correlation.volume.reference.KEPT_BYTES", 2 * kept)
    reference = VolumeReference.of(voxel_map, volumes, (0,))
    before = reference.equations(volumes, 1, np.zeros(nodes.shape))
    assert 0 < len(reference.stored) <= n_blocks and (len(reference.stored) == n_blocks) is whole
    reference.release()
    assert len(reference.stored) == (n_blocks if whole else 0)
    after = reference.equations(volumes, 1, np.zeros(nodes.shape))
    np.testing.assert_array_equal(after.q, before.q)
    assert after.rr == before.rr


def test_light_is_found():
    """Gain and offset of a scan at rest come out of its equations."""
    f, _ = scans()
    nodes, conn = solid("hex8", 0.5)
    volumes = ArrayVolumes([f, 1.1 * f + 7.0])
    reference = VolumeReference.of(build_voxel_map(nodes, [Block("hex8", conn)], f.shape), volumes, (0,))
    equations = reference.equations(volumes, 1, np.zeros(nodes.shape))
    gain, offset = np.linalg.solve(equations.bb, equations.rb)
    mean = float(reference.layout("frame").mean[0])
    assert gain == pytest.approx(0.1, abs=1e-4)
    assert offset == pytest.approx(7.0 + 0.1 * mean, rel=1e-4)


def test_the_step_leads_to_a_translation():
    """A scan moved by a fraction of a voxel (by Fourier's shift, no spline) is found to a thousandth."""
    f, _ = scans()
    shift = np.array([0.3, -0.2, 0.4])  # column, row, slice
    waves = np.meshgrid(*[np.fft.fftfreq(SIDE)] * 3, indexing="ij")
    phase = np.exp(-2j * np.pi * sum(w * s for w, s in zip(waves, shift[::-1], strict=True)))
    moved = np.real(np.fft.ifftn(np.fft.fftn(f) * phase)).astype(np.float32)
    nodes, conn = solid("hex8", 0.0)
    volumes = ArrayVolumes([f, moved])
    reference = VolumeReference.of(build_voxel_map(nodes, [Block("hex8", conn)], f.shape), volumes, (0,), 5)
    modes, u = np.tile(np.eye(3), (len(nodes), 1)), np.zeros(3)
    for _ in range(6):
        gram = reference.equations(volumes, 1, np.tile(u, (len(nodes), 1)), "none").gram(modes)
        u = u + np.linalg.solve(gram.matrix, gram.rhs)
    np.testing.assert_allclose(u, shift, rtol=0, atol=2e-3)


def test_a_volume_without_texture_is_refused():
    nodes, conn = solid("hex8", 0.0)
    flat = ArrayVolumes([np.full((SIDE,) * 3, 7, np.uint8)] * 2)
    with pytest.raises(InputError, match="no contrast"):
        VolumeReference.of(build_voxel_map(nodes, [Block("hex8", conn)], flat.shape), flat, (0,))


def test_a_mesh_beside_the_volume_is_refused():
    nodes, conn = solid("hex8", 0.0)
    with pytest.raises(InputError, match="no voxel lies in the mesh"):
        build_voxel_map(nodes + 100.0, [Block("hex8", conn)], (SIDE,) * 3)
