"""A plate with a hole, pulled, unloaded and pressed back, computed by CalculiX; the experiment of a user who saw it."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "twins"))
import open_hole as plate  # noqa: E402
from strip_twin import write_recording, write_rest  # noqa: E402
from test_material_cards import pulled_by_calculix  # noqa: E402
from warm_strip import THIN, solved  # noqa: E402

import idic  # noqa: E402
from idic.materials import compile, get_law, point  # noqa: E402
from idic.run.systematic import systematic  # noqa: E402
from idic.virtual_tests.meshes import strip_with_hole, write_inp  # noqa: E402
from idic.workers.runner import SerialRunner  # noqa: E402

TRUE = {"around": 4, "radial": 4, "beside": 2, "grading": 1.5}  # nowhere the nodes of the user
MOST_GROWTH = 2.0  # of an increment over the last
USER = {"around": 3, "radial": 4, "beside": 2}
DECK = """*INCLUDE, INPUT=mesh.inp
*MATERIAL, NAME=SHEET
{card}*SOLID SECTION, ELSET=sheet, MATERIAL=SHEET
{thickness}
*BOUNDARY
LEFT, 1, 2
RIGHT, 2, 2
*AMPLITUDE, NAME=GRIP, TIME=TOTAL TIME
{grip}
*TIME POINTS, NAME=ENDS, TIME=TOTAL TIME
{ends}
{before}"""
# one for each interval between two frames: the shortest increment of CalculiX is a millionth of its step
STEP = """*STEP, NLGEOM, INC=100000
{procedure}
{first:.9g}, {length:.9g}, 1e-9, {most:.9g}
*BOUNDARY, AMPLITUDE=GRIP
RIGHT, 1, 1, 1
{loads}*NODE PRINT, NSET=ALL, TIME POINTS=ENDS
U
*NODE PRINT, NSET=RIGHT, TOTALS=ONLY, TIME POINTS=ENDS
RF
{prints}*END STEP
"""


def table(first: float, slope: float, temperature: str = "") -> str:
    """A straight flow curve as rows of *PLASTIC; temperature : ends every row."""
    return "".join(f"{first + slope * p:.9g}, {p}{temperature}\n" for p in (0.0, 0.5))


def course(times, values) -> str:
    """Rows of *AMPLITUDE."""
    return "\n".join(f"{t:.9g}, {v:.9g}" for t, v in zip(times, values, strict=True))


def ends_of(times, increments: int, grip=None) -> np.ndarray:
    """Ends of the increments: at least so many in every interval between two of `times` (s).

    CalculiX begins an increment with the velocity of the last one: none is much longer than the last, and they begin
    short where `grip` turns.
    """
    ends, last = [times[0]], np.inf
    slopes = np.zeros(len(times) - 1) if grip is None else np.sign(np.diff(grip))
    for k, (start, end) in enumerate(zip(times[:-1], times[1:], strict=True)):
        now = start
        if k > 0 and slopes[k] * slopes[k - 1] < 0.0:
            last = (end - start) / (128.0 * MOST_GROWTH)
        while now < end:
            wanted = min(MOST_GROWTH * last, (end - start) / increments)
            last = (end - now) / np.ceil((end - now) / wanted - 1e-6)
            now = end if last > 0.999 * (end - now) else now + last
            ends.append(now)
    return np.array(ends)


def mesh_of(folder: Path):
    """The true mesh, of elements with four points, and its file."""
    mesh = strip_with_hole(plate.LENGTH, plate.WIDTH, plate.RADIUS, "quad8", **TRUE)
    write_inp(mesh, folder / "mesh.inp", "plate")
    text = (folder / "mesh.inp").read_text()
    everything = f"*NSET, NSET=ALL, GENERATE\n1, {mesh.n_nodes}\n"
    (folder / "mesh.inp").write_text(text.replace("TYPE=CPS8", "TYPE=CPS8R") + everything)
    return mesh


def truth_by_calculix(folder: Path, card: str, times, grip, increments=4, procedure="*STATIC", **more):
    """Mesh, motion (n_frames, n_nodes, 2) mm and force (n_frames,) N at `times` (s) of a plate pulled by `grip` (mm).

    card : lines of the material; more : ``before``, ``loads`` and ``prints`` of the step
    """
    mesh, ends = mesh_of(folder), ends_of(times, increments, grip)
    steps, loads = "", more.get("loads", "")
    for start, end in zip(times[:-1], times[1:], strict=True):
        own = np.diff(ends[(ends >= start) & (ends <= end)])
        steps += STEP.format(procedure=procedure, first=own[0], length=end - start, most=own.max(), loads=loads,
                             prints=more.get("prints", ""))
        loads = ""  # they go on
    (folder / "plate.inp").write_text(DECK.format(
        card=card, thickness=plate.THICKNESS / THIN, grip=course(times, grip), before=more.get("before", ""),
        ends="\n".join(f"{t:.9g}" for t in ends[1:])) + steps)
    u, force = solved(folder, "plate", mesh.n_nodes)
    assert len(u) == len(ends)
    frames = np.searchsorted(ends, times)
    return mesh, u[frames], force[frames]


def fitted_to_one_element(folder: Path, law: str, card: str, values: dict, free, strain, **more) -> dict[str, float]:
    """The `free` parameters with which the law follows one element of CalculiX best, whose card has `values`.

    Not those of the card: CalculiX has the Cauchy stress in the yield condition, and convects its back stress.
    strain : course of tension along x; more : ``times`` (s) and ``procedure`` of `pulled_by_calculix`
    """
    names = get_law(law).parameter_names
    found, places = np.array([values[name] for name in names]), [names.index(name) for name in free]
    times = more.get("times")
    theirs = pulled_by_calculix(folder, card, strain, **more)
    for _ in range(6):  # Gauss and Newton
        curve = point.uniaxial(compile(law), found, strain, times=times)
        slopes = curve.dP[1:, places, 0, 0] * found[places]
        found[places] *= 1.0 + np.linalg.lstsq(slopes, theirs - curve.P[1:, 0, 0], rcond=None)[0]
    return {names[k]: float(found[k]) for k in places}


def write_folder(folder: Path, truth, material: str, times, grip, seed: int = 0) -> Path:
    """The experiment of a user with a mesh and a `material` (lines of experiment.toml) of his own."""
    mesh, u, force = truth
    rng = np.random.default_rng(50 + seed)
    sensed = write_recording(folder, mesh, u, plate.CAMERA, plate.SHAPE, plate.NOISE, rng, texture_px=420.0)
    noise = plate.FORCE_NOISE * rng.standard_normal(len(force))
    text = plate.TOML.replace("NOISE", f"{sensed:.4f}", 1)
    user = strip_with_hole(plate.LENGTH, plate.WIDTH, plate.RADIUS, "quad8", **USER)
    return write_rest(folder, user, text[:text.index("[material.sheet]")] + material, np.asarray(times, dtype=float),
                      {"force_N": force + noise, "grip_mm": np.asarray(grip)})


def judged(folder: Path) -> dict[str, dict]:
    """What is identified from the experiment in `folder` and the bias of its mesh: ``parameters`` of `systematic`."""
    result = idic.identify(str(folder / "test"), out=str(folder / "run"))
    assert result.status == "converged"
    return systematic(folder / "run", SerialRunner(), spread=False)["parameters"]
