"""A plain strip whose solver is a script that idic knows nothing of (`strip_solver`)."""

from __future__ import annotations

from pathlib import Path

from idic_studies.equality.strips import FORCE, RECORDED, Strip, strip_mesh, strip_nodes
from idic_studies.equality.workshop import Workshop

PROGRAM = "python3"
PERMISSION = ("--allow-external", PROGRAM)
CELLS = (6, 4)
SOLVER, DECK_FILE, NODES = "strip_solver.py", "strip.deck.template", "nodes.txt"
DECK = """E {BODY.E}
nu {BODY.nu:.9e}
{TABLE.boundary.RIGHT.x}
"""
TRUTH = """[material.BODY]
law = "external"
E = { value = 2000, unit = "MPa", identify = true }
nu = { value = 0.35, identify = true }
"""
START = TRUTH.replace("2000", "1500").replace("0.35", "0.28")
TABLES = f"""[[boundary]]
nodes = "RIGHT"
ux = {{ column = "grip_mm" }}
{FORCE}[solver]
kind = "external"
template = "{DECK_FILE}"
files = ["{NODES}", "{SOLVER}"]
command = ["{PROGRAM}", "-S", "{SOLVER}", "{{deck}}"]
reader = "csv"
"""


def write_recorded(workshop: Workshop, name: str) -> None:
    """The experiment folder `name`, recorded by `idic simulate` with the same solver."""
    strip = Strip("strip of another solver", n_frames=5)
    plan = f"{name}-plan"
    _write_folder(workshop, plan, strip.head("") + TRUTH + TABLES + strip.design())
    workshop.idic("simulate", plan, "--out", name, *PERMISSION)
    _write_folder(workshop, name, strip.head(RECORDED) + START + TABLES)
    workshop.inputs.append(name)


def _write_folder(workshop: Workshop, name: str, experiment: str) -> None:
    workshop.write(f"{name}/experiment.toml", experiment)
    workshop.write(f"{name}/mesh.inp", strip_mesh(CELLS, waist=0.0))
    workshop.write(f"{name}/{NODES}", _node_table())
    workshop.write(f"{name}/{DECK_FILE}", DECK)
    workshop.write(f"{name}/{SOLVER}", Path(__file__).with_name(SOLVER).read_text(encoding="utf-8"))


def _node_table() -> str:
    nodes, _ = strip_nodes(CELLS, waist=0.0)
    return "".join(f"{label} {x!r} {y!r}\n" for label, (x, y) in enumerate(nodes.tolist(), 1))
