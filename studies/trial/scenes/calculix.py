"""Motion and force of a scene by CalculiX, with its own laws, independent of the mechanics of the tool.

CalculiX expands plane elements to solids; 1/100 of the thickness keeps the stress plane. A solid scene has bricks over
half its real thickness, and finite strains. Otherwise the kinematics are those of
the built-in law of the same name. Linear elasticity of small strains takes one step per frame; every other law one step
with the frames as time points, at least two increments between them. A law with a memory is simulated with twice as
many, too, and extrapolated (`idic_studies.trial.scenes.solve.has_memory`).
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from idic.errors import InputError, NotConverged
from idic.fe import Mesh, ExpectedOutput, gathered, inp_text
from idic_studies.trial.scenes.scene import Scene
from idic_studies.trial.scenes.solve import Motion, element_factors, end_dofs, has_memory, true_mesh
from idic_studies.trial.scenes.specimens import bricks, partners_of

try:
    import resource
except ImportError:  # Windows: without a limit of processor time
    resource = None

THICKNESS_DIVISOR = 100.0
MAX_CPU_S = 600
MAX_INCREMENT_SHARE = 0.5  # of the shortest time between frames
JOB = "scene"


def calculix() -> str:
    """The program.

    Raises
    ------
    InputError
        If it is not installed.
    """
    program = shutil.which("ccx")
    if program is None:
        raise InputError("CalculiX is not installed", key="ccx", expected="the program ccx", found="none",
                         remedy="install it (Debian: calculix-ccx), or leave those trials out (--only)")
    return program


def solve_with_calculix(scene: Scene, mesh: Mesh | None = None) -> Motion:
    """Simulate a scene by CalculiX, on the true mesh or on another one.

    Raises
    ------
    InputError
        If it is not installed, or knows no such law.
    NotConverged
        If it gave up, or wrote too little.
    """
    program, mesh = calculix(), true_mesh(scene) if mesh is None else mesh
    if not has_memory(scene):
        return _solved(program, scene, mesh, MAX_INCREMENT_SHARE)
    coarser, halved = (_solved(program, scene, mesh, share * MAX_INCREMENT_SHARE) for share in (1.0, 0.5))
    return coarser.without_time_error(halved)


def _solved(program: str, scene: Scene, mesh: Mesh, share: float) -> Motion:
    """Motion with increments of at most a share of the shortest time between frames."""
    with tempfile.TemporaryDirectory(prefix="scene-") as folder:
        path = Path(folder)
        (path / f"{JOB}.inp").write_text(deck(scene, mesh, share), encoding="ascii")
        process = subprocess.run([program, "-i", JOB], cwd=path, capture_output=True, text=True, check=False,
                              preexec_fn=None if resource is None else _limited)
        if process.returncode != 0:
            raise NotConverged(f"CalculiX ended with exit code {process.returncode} (it has {MAX_CPU_S} s of processor "
                               f"time): {process.stdout[-400:]}")
        start = scene.times[0]
        force = f"RIGHT.{scene.along}"
        request = ExpectedOutput(mesh.node_labels, 2, scene.times[1:] - start, (force,), mesh.node_sets,
                                scene.geometry.length)
        outputs = gathered("calculix_dat", path, JOB, request)
    return Motion(mesh, outputs.u, (2.0 if scene.solid else THICKNESS_DIVISOR) * outputs.forces[force])


def _limited() -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (MAX_CPU_S, MAX_CPU_S))


def deck(scene: Scene, mesh: Mesh, share: float = MAX_INCREMENT_SHARE) -> str:
    """The input file; share : of the shortest time between frames, the longest increment"""
    times = scene.times - scene.times[0]
    factors = element_factors(scene, mesh)
    body = bricks(mesh, 0.5 * scene.thickness) if scene.solid else mesh
    lines = [inp_text(body, "scene", {"quad8": "CPS8"}).rstrip()]
    lines += ["*ORIENTATION, NAME=GRAIN", _orientation(scene)] if scene.law == "orthotropic" else []
    for k, factor in enumerate(np.unique(factors)):
        labels = mesh.element_labels[factors == factor]
        lines += [f"*ELSET, ELSET=PART{k}", *(f"{label}," for label in labels), f"*MATERIAL, NAME=M{k}",
                  *_material(scene, factor)]
        turned = ", ORIENTATION=GRAIN" if scene.law == "orthotropic" else ""
        depth = "" if scene.solid else f"{scene.thickness / THICKNESS_DIVISOR:.9g}"
        lines += [f"*SOLID SECTION, ELSET=PART{k}, MATERIAL=M{k}{turned}", *([depth] if depth else [])]
    dofs, courses = end_dofs(scene, mesh)
    histories, place = np.unique(courses, axis=1, return_inverse=True)
    for j, course in enumerate(histories.T):
        lines += [f"*AMPLITUDE, NAME=A{j}, TIME=TOTAL TIME",
                  *(f"{t:.9g}, {u:.12g}" for t, u in zip(times, course, strict=True))]
    if scene.warmth is not None:
        course = scene.warmth(np.zeros((1, 2)))[:, 0]
        lines += ["*INITIAL CONDITIONS, TYPE=TEMPERATURE", "ALL, 0.", "*AMPLITUDE, NAME=WARM, TIME=TOTAL TIME",
                  *(f"{t:.9g}, {w:.12g}" for t, w in zip(times, course, strict=True))]
    boundary_lines = ["*BOUNDARY", "MIDDLE, 3, 3", "LEFT, 3, 3", "RIGHT, 3, 3"] if scene.solid else []
    through = partners_of(mesh) if scene.solid else [np.arange(mesh.n_nodes)]
    for j in range(histories.shape[1]):
        boundary_lines += [f"*BOUNDARY, AMPLITUDE=A{j}"]
        boundary_lines += [f"{body.node_labels[plane[dof // 2]]}, {dof % 2 + 1}, {dof % 2 + 1}, 1."
                 for dof in dofs[place.ravel() == j] for plane in through if plane[dof // 2] >= 0]
    if scene.warmth is not None:
        boundary_lines += ["*TEMPERATURE, AMPLITUDE=WARM", "ALL, 1."]
    lines += _linear_steps(times, boundary_lines) if _linear(scene) else _one_step(scene, times, boundary_lines, share)
    return "\n".join(lines) + "\n"


def _linear(scene: Scene) -> bool:
    return scene.law in ("elastic", "orthotropic") and scene.kinematics != "finite" and not scene.solid


def _linear_steps(times: np.ndarray, boundary_lines: list[str]) -> list[str]:
    lines = []
    for span in np.diff(times):
        lines += ["*STEP", "*STATIC", f"{span:.9g}, {span:.9g}", *boundary_lines, "*NODE PRINT, NSET=ALL", "U",
                  "*NODE PRINT, NSET=RIGHT, TOTALS=ONLY", "RF", "*END STEP"]
        boundary_lines = []
    return lines


def _one_step(scene: Scene, times: np.ndarray, boundary_lines: list[str], share: float) -> list[str]:
    step = share * np.diff(times).min()
    return ["*TIME POINTS, NAME=FRAMES", *(f"{t:.9g}," for t in times[1:]),
            "*STEP, INC=10000" + (", NLGEOM" if scene.has_finite_strains else ""),
            "*VISCO, CETOL=1e-4" if scene.law == "creep" else "*STATIC",
            f"{0.5 * step:.9g}, {times[-1]:.9g}, 1e-8, {step:.9g}", *boundary_lines,
            "*NODE PRINT, NSET=ALL, TIME POINTS=FRAMES", "U",
            "*NODE PRINT, NSET=RIGHT, TOTALS=ONLY, TIME POINTS=FRAMES", "RF", "*END STEP"]


def _orientation(scene: Scene) -> str:
    angle = np.deg2rad(scene.values["angle"])
    c, s = np.cos(angle), np.sin(angle)
    return f"{c:.12g}, {s:.12g}, 0., {-s:.12g}, {c:.12g}, 0."


def _material(scene: Scene, factor: float) -> list[str]:
    """The lines of *MATERIAL; stiffnesses times the factor."""
    v = scene.values
    if scene.law in ("neo_hookean", "mooney_rivlin"):
        C01 = factor * v.get("C01", 0.0)
        return ["*HYPERELASTIC, MOONEY-RIVLIN",
                f"{factor * v['C10']:.9g}, {C01:.9g}, {2.0 / (factor * v['kappa']):.9g}"]
    if scene.law == "orthotropic":
        E1, E2, G = factor * v["E1"], factor * v["E2"], factor * v["G12"]
        nu = v["nu12"]  # the third direction does not matter in plane stress but for its own strain
        return ["*ELASTIC, TYPE=ENGINEERING CONSTANTS",
                f"{E1:.9g}, {E2:.9g}, {E2:.9g}, {nu:.9g}, {nu:.9g}, {nu:.9g}, {G:.9g}, {G:.9g},", f"{G:.9g}"]
    lines = ["*ELASTIC", f"{factor * v['E']:.9g}, {v['nu']:.9g}"]
    if scene.warmth is not None:
        lines += ["*EXPANSION", "1."]
    if scene.law == "creep":  # Norton: rate (sigma / stress)^n per s
        lines += ["*CREEP", f"{v['rate'] / v['stress'] ** v['n']:.9g}, {v['n']:.9g}, 0."]
    elif scene.law in ("j2_linear", "j2_voce"):
        lines += ["*PLASTIC", *_curve(v)]
    elif scene.law == "j2_kinematic":  # the isotropic part as cyclic hardening, the back stress as the curve
        p = np.array([0.0, 1.0])
        lines += ["*PLASTIC, HARDENING=COMBINED",
                  *(f"{v['yield_stress'] + v['C'] * x:.9g}, {x:.9g}" for x in p)]
        lines += ["*CYCLIC HARDENING", *(f"{v['yield_stress'] + v['hardening_modulus'] * x:.9g}, {x:.9g}" for x in p)]
    elif scene.law != "elastic":
        raise InputError("CalculiX has no such law", key="law", expected="a law of this generator", found=scene.law,
                         remedy="choose a law that this generator writes")
    return lines


def _curve(values) -> list[str]:
    """Flow stress over plastic strain, Voce with a linear part."""
    p = np.unique(np.concatenate([np.linspace(0.0, 0.05, 101), np.linspace(0.05, 0.5, 46)]))
    if "Q" not in values:
        p = np.array([0.0, 1.0])
    flow = values["yield_stress"] + values["hardening_modulus"] * p
    if "Q" in values:
        flow = flow + values["Q"] * (1.0 - np.exp(-values["b"] * p))
    return [f"{s:.9g}, {x:.9g}" for s, x in zip(flow, p, strict=True)]

