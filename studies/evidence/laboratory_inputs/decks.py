"""Meshes and devices: decks as programs write them, files of instruments by the libraries of these devices."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from outcome import Input, right_if

from idic.readers import Log, open_stack, read_mesh_file

CORNERS = [(0.0, 0.0), (2.0, 0.0), (4.0, 0.0), (0.0, 1.0), (2.0, 1.0), (4.0, 1.0)]
ABAQUS = """*Heading
 strip
*NODE{node}
{nodes}
*ELEMENT, TYPE={type}, ELSET=Body
10, 1, 2, 5, 4
11, 2, 3, 6, 5
*Nset, nset=Left
 1, 4
{more}"""
GRIDS = [f"GRID,{k},,{x},{y},0." for k, (x, y) in enumerate(CORNERS, 1)]
QUADS = ["CQUAD4,10,1,1,2,5,4", "CQUAD4,11,1,2,3,6,5"]


def rows(points, form: str = "{k}, {x}, {y}, 0.") -> str:
    """A row per node."""
    return "\n".join(form.format(k=k, x=x, y=y) for k, (x, y) in enumerate(points, 1))


def polar(points) -> list[tuple[float, float]]:
    """Radius and angle in degrees."""
    return [(float(np.hypot(x, y)), float(np.degrees(np.arctan2(y, x)))) for x, y in points]


def abaqus(points=CORNERS, node: str = "", kind: str = "CPS4", more: str = "", form: str = "{k}, {x}, {y}, 0.") -> str:
    return ABAQUS.format(node=node, nodes=rows(points, form), type=kind, more=more)


def bulk(*lines: str) -> str:
    return "\n".join(["SOL 101", "CEND", "BEGIN BULK", *lines, "ENDDATA"]) + "\n"


def assembly(step: str) -> str:
    """The strip as a part, an instance of which is moved back to its place."""
    part = abaqus([(x - 10.0, y) for x, y in CORNERS]).split("*NODE")[1]
    return (f"*Heading\n*Part, name=P\n*NODE{part}*End Part\n*Assembly, name=A\n*Instance, name=P-1, part=P\n{step}\n"
            "*End Instance\n*End Assembly\n")


def gmsh(second: str = "2 2 1 1 2 3 6 5", version: str = "2.2") -> str:
    """Two squares of a group, LEFT a group of lines."""
    nodes = "".join(f"{k} {x} {y} 0\n" for k, (x, y) in enumerate(CORNERS, 1))
    groups = '$PhysicalNames\n2\n1 2 "Left"\n2 1 "Body"\n$EndPhysicalNames\n'
    elements = f"$Elements\n3\n1 1 2 2 1 1 4\n2 3 2 1 1 1 2 5 4\n3 3 {second[2:]}\n$EndElements\n"
    return (f"$MeshFormat\n{version} 0 8\n$EndMeshFormat\n{groups}$Nodes\n6\n{nodes}$EndNodes\n{elements}")


DECKS: dict[str, tuple[str, str]] = {
    "Abaqus, flat": ("a.inp", abaqus()),
    "Abaqus, small letters": ("a.inp", abaqus().lower()),
    "Abaqus, cylindrical nodes": ("a.inp", abaqus(polar(CORNERS), ", SYSTEM=C")),
    "Abaqus, *SYSTEM": ("a.inp", abaqus([(x - 3.0, y - 1.0) for x, y in CORNERS]).replace(
        "*NODE", "*SYSTEM\n3., 1., 0., 4., 1., 0.\n3., 2., 0.\n*NODE")),
    "Abaqus, instance moved": ("a.inp", assembly("10., 0., 0.")),
    "Abaqus, *TRANSFORM": ("a.inp", abaqus(more="*TRANSFORM, NSET=Left, TYPE=C\n0.,0.,0., 0.,0.,1.\n")),
    "Abaqus, exponents of D": ("a.inp", abaqus(form="{k}, {x:.3f}D+0, {y:.3f}d0, 0.")),
    "Abaqus, comments and blank lines": ("a.inp", abaqus().replace("\n*ELEMENT", "\n**\n\n*ELEMENT")),
    "Abaqus, nodes in the plane only": ("a.inp", abaqus(form="{k},{x},{y}")),
    "Abaqus, *INCLUDE outside of the folder": ("a.inp", "*INCLUDE, INPUT=../secret.inp\n" + abaqus()),
    "Abaqus, *NGEN and *ELGEN": ("a.inp", """*Heading
*NODE
1, 0., 0.
3, 4., 0.
4, 0., 1.
6, 4., 1.
*NGEN
1, 3, 1
4, 6, 1
*ELEMENT, TYPE=CPS4
10, 1, 2, 5, 4
*ELGEN, ELSET=Body
10, 2, 1, 1
"""),
    "Abaqus, a triangle beside a square": ("a.inp", abaqus().replace("11, 2, 3, 6, 5", "11, 2, 3, 6, 6")),
    "Abaqus, a node that is missing": ("a.inp", abaqus().replace("11, 2, 3, 6, 5", "11, 2, 3, 60, 5")),
    "Abaqus, set by GENERATE": ("a.inp", abaqus().replace("*Nset, nset=Left\n 1, 4",
                                                               "*Nset, nset=Left, generate\n1, 4, 3")),
    "Nastran, CQUADR": ("a.bdf", bulk(*GRIDS, *[quad.replace("CQUAD4", "CQUADR") for quad in QUADS])),
    "Nastran, small fields": ("a.bdf", bulk(*["GRID    {:<8d}{:8s}{:<8.3f}{:<8.3f}{:<8.1f}".format(k, "", x, y, 0.0)
                                              for k, (x, y) in enumerate(CORNERS, 1)], *QUADS)),
    "Nastran, free": ("a.bdf", bulk(*GRIDS, *QUADS)),
    "Nastran, exponents without E": ("a.bdf", bulk(*[grid.replace("4.0", "4.+0").replace("2.0", "20.-1")
                                                     for grid in GRIDS], *QUADS)),
    "Nastran, long fields": ("a.bdf", bulk(*[f"GRID*   {k:<16d}{'':16s}{x:<16.6f}{y:<16.6f}*N{k}\n*N{k:<6d}{0.0:<16.1f}"
                                             for k, (x, y) in enumerate(CORNERS, 1)], *QUADS)),
    "Nastran, cylindrical CP": ("a.bdf", bulk("CORD2C,7,,0.,0.,0.,0.,0.,1.,", ",1.,0.,0.", *[
        f"GRID,{k},7,{r},{angle},0." for k, (r, angle) in enumerate(polar(CORNERS), 1)], *QUADS)),
    "Nastran, GRDSET": ("a.bdf", bulk("CORD2R,3,,10.,0.,0.,10.,0.,1.,", ",11.,0.,0.", "GRDSET,,3", *[
        f"GRID,{k},,{x - 10.0},{y},0." for k, (x, y) in enumerate(CORNERS, 1)], *QUADS)),
    "gmsh 2.2": ("a.msh", gmsh("3 2 1 1 2 3 6 5")),
    "gmsh, a square turned over": ("a.msh", gmsh("3 2 1 1 2 5 6 3")),
    "gmsh, a square that crosses itself": ("a.msh", gmsh("3 2 1 1 2 6 3 5")),
    "gmsh, cut off": ("a.msh", gmsh()[:-30])}


def mesh(name: str, text: str, folder: Path) -> tuple[str, str]:
    """Six nodes at their places, two elements of the right orientation, Left at x = 0 where the file has it."""
    folder.mkdir(parents=True)
    (folder / name).write_text(text, encoding="utf-8")
    read, notes = read_mesh_file(folder / name).to_mesh(2, 1.0)
    read.check_elements()
    places = sorted(map(tuple, np.round(read.nodes, 6)))
    left = next((read.nodes[nodes] for key, nodes in read.node_sets.items() if key.lower().endswith("left")), None)
    is_right = places == sorted(CORNERS) and read.n_elements == 2 and (left is None or np.ptp(left[:, 0]) < 1e-9)
    return right_if(is_right, (places, read.n_elements, notes))


def tdms(folder: Path) -> tuple[str, str]:
    """Channels of a machine, by the library of the format."""
    import nptdms
    folder.mkdir(parents=True)
    force = np.arange(9.0) ** 2
    with nptdms.TdmsWriter(folder / "a.tdms") as stream:
        stream.write_segment([nptdms.ChannelObject("test", "force", force, {
            "unit_string": "N", "wf_increment": 0.5, "wf_start_offset": 2.0})])
    log = Log.read(folder / "a.tdms")
    name = next(name for name in log.names if "force" in name)
    return right_if(np.allclose(log.column(name), force), (log.names, log.rows[:2]))


def heights(suffix: str, folder: Path) -> tuple[str, str]:
    """A map of a profilometer, by a library of such files; x along the columns, µm."""
    import surfalize
    folder.mkdir(parents=True)
    truth = 5.0 + np.random.default_rng(0).normal(0, 1, (24, 36))
    truth += np.linspace(0.0, 30.0, 36)
    surfalize.Surface(truth.copy(), 2.0, 2.0).save(folder / f"a{suffix}")
    stack = open_stack([folder / f"a{suffix}"], with_gaps=True)
    unit = {"m": 1e6, "mm": 1e3, "µm": 1.0, "um": 1.0, "nm": 1e-3}.get(stack.grid.height_unit or "um", np.nan)
    read = np.asarray(stack.frame(0), dtype=float) * unit
    pitch = stack.grid.pitch_mm
    is_right = read.shape == truth.shape and np.allclose(read - read.mean(), truth - truth.mean(), atol=0.01)
    return right_if(is_right and pitch is not None and np.allclose(pitch, 2e-3), (read.shape, pitch, unit))


def workbook(folder: Path) -> tuple[str, str]:
    """A log as a table of Excel, a line of units below the header."""
    import openpyxl
    folder.mkdir(parents=True)
    book = openpyxl.Workbook()
    for row in (["time_s", "force_N"], *([0.5 * k, 10.0 * k] for k in range(6))):
        book.active.append(row)
    book.save(folder / "a.xlsx")
    log = Log.read(folder / "a.xlsx")
    return right_if(np.allclose(log.column("force_N"), 10.0 * np.arange(6)), log.names)


def decks() -> Iterator[Input]:
    """All of them."""
    for name, (file, text) in DECKS.items():
        yield Input("decks and meshes", name, partial(mesh, file, text))
    instruments: dict[str, Callable] = {".tdms": tdms, ".xlsx": workbook,
                                        ".x3p": partial(heights, ".x3p"),
                                        ".sur": partial(heights, ".sur")}
    for name, judge in instruments.items():
        yield Input("devices", name, judge)
