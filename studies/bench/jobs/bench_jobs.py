"""What the measurements run: made meshes, an image pair, and jobs that worker processes import."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from idic.fe import Block, Constraints, Direction, Mesh, Body, Reaction, Section, Variation, march
from idic.laws import compile as compile_law

PLASTIC = {"E": 70000.0, "nu": 0.3, "yield_stress": 200.0, "hardening_modulus": 1500.0}


def best_of(functions, repeats):
    """Minimum time (s) of each function, run in turn: a load on the machine meets all of them."""
    times = [[] for _ in functions]
    for _ in range(repeats):
        for function, seconds in zip(functions, times, strict=True):
            start = time.perf_counter()
            function()
            seconds.append(time.perf_counter() - start)
    return [min(seconds) for seconds in times]


def brick(nx: int, ny: int, nz: int) -> Mesh:
    """nx x ny x nz hexahedra of 1 mm."""
    i, j, k = np.meshgrid(np.arange(nx + 1), np.arange(ny + 1), np.arange(nz + 1), indexing="ij")
    nodes = np.stack([i, j, k], axis=-1).reshape(-1, 3).astype(float)
    number = np.arange(len(nodes)).reshape(i.shape)
    low, high = slice(0, -1), slice(1, None)
    corners = [(low, low, low), (high, low, low), (high, high, low), (low, high, low)]
    corners += [(a, b, high) for a, b, _ in corners]
    conn = np.stack([number[c].ravel() for c in corners], axis=1)
    sets = {"LEFT": np.flatnonzero(nodes[:, 0] == 0), "RIGHT": np.flatnonzero(nodes[:, 0] == nx)}
    return Mesh(nodes, (Block("hex8", conn, 0),), sets, {"body": np.arange(len(conn))})


def brick_px(side: int, elements: int, rim: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (column, row, slice) and cells of cubed hex8 in a volume of `side` voxels cubed, `rim` from its borders."""
    x = np.linspace(rim, side - 1.0 - rim, elements + 1)
    nodes = np.stack(np.meshgrid(x, x, x, indexing="ij")[::-1], axis=-1).reshape(-1, 3)
    number = np.arange(len(nodes)).reshape((elements + 1,) * 3)
    corners = [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0)]
    cells = [number[c:elements + c, b:elements + b, a:elements + a].ravel() for c, b, a in corners]
    return nodes, np.stack(cells, axis=1)


def many_fields(law: str, cells: tuple[int, int]) -> tuple[Body, dict, np.ndarray]:
    """A sheet of 60 x 40 quad4, pulled as `stretched`, with a field of the stiffness: model, values, times."""
    i, j = np.meshgrid(np.arange(61), np.arange(41), indexing="ij")
    nodes, number = np.stack([i, j], axis=-1).reshape(-1, 2).astype(float), np.arange(i.size).reshape(i.shape)
    corners = [number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]]
    conn = np.stack([c.ravel() for c in corners], axis=1)
    sets = {"LEFT": np.flatnonzero(nodes[:, 0] == 0), "RIGHT": np.flatnonzero(nodes[:, 0] == 60)}
    mesh = Mesh(nodes, (Block("quad4", conn, 0),), sets, {"body": np.arange(len(conn))})
    model, values, times = stretched(mesh, "plane_stress", 60.0, 9)
    half = np.array([30.0, 20.0])
    n = (cells[0] + 1) * (cells[1] + 1)
    field = Variation("body", "field", {str(k): 0.1 * float(np.sin(k)) for k in range(n)}, half, half, cells)
    if law != "j2_linear":
        compiled = compile_law(law, "finite")
        model = replace(model, sections=(Section("body", compiled, np.arange(len(conn))),))
        values = {"body": np.full(len(compiled.spec.parameters), 1000.0)}
    return replace(model, variations=(field,)), values, times


def stretched(mesh: Mesh, kind: str, length: float, n_frames: int) -> tuple[Body, dict, np.ndarray]:
    """A body clamped at LEFT and pulled by 1.2 % at RIGHT, half of the frames beyond yielding: model, values, times."""
    dim = mesh.nodes.shape[1]
    left_end, right_end = mesh.node_sets["LEFT"], mesh.node_sets["RIGHT"]
    dofs = np.concatenate([dim * right_end + c for c in range(dim)] + [dim * left_end + c for c in range(dim)])
    basis = np.zeros((len(dofs), 1))
    basis[: len(right_end)] = 1.0
    grip = 0.012 * length * np.linspace(0.0, 1.0, n_frames)[:, None]
    law = compile_law("j2_linear", "finite")
    name = next(iter(mesh.element_sets))
    model = Body(mesh=mesh, kind=kind, sections=(Section(name, law, mesh.element_sets[name]),), thickness=2.0,
                  constraints=Constraints(dofs, basis, grip), channels=(Reaction(dim * right_end),))  # fmt: skip
    return model, {name: np.array([PLASTIC[p] for p in law.spec.parameter_names])}, np.arange(n_frames, dtype=float)


def directions(n: int) -> tuple[Direction, ...]:
    """The first n material parameters."""
    return tuple(Direction(name, material=(0, i)) for i, name in enumerate(list(PLASTIC)[:n]))


def simulations(job: int) -> float:
    """`job` times the same simulation, of a second or less each; returns the seconds it took (on a worker)."""
    began = time.perf_counter()
    model, values, times = stretched(brick(8, 5, 3), "solid", 8.0, 8)
    for _ in range(job):
        for _state in march(model, values, times):
            pass
    return time.perf_counter() - began
