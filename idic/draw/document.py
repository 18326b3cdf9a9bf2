"""experiment.toml of a plan: the same tables that a person would type."""

from __future__ import annotations

import json
import os
import tomllib
from pathlib import Path

from idic.draw.plan import Plan, Sketch
from idic.errors import InputError
from idic.experiment_file import EXPERIMENT_FILE, ExperimentFolder, read_toml, validated
from idic.inside import is_inside, read_inside, replace_inside, write_inside
from idic.laws import get_law
from idic.model import Experiment

KEPT = "experiment.toml.before"  # the file that was replaced; later ones: .before-2, -3 …
THROUGH = ("through_mm", "layers")  # of a solid: the page has the thickness in a field of its own
MATERIAL = "SPECIMEN"
_HEAD = "# An idic experiment, drawn with  idic draw . It may be edited: idic check  tells what is wrong.\n"


def text_of(plan: Plan) -> str:
    """The content of experiment.toml.

    Raises
    ------
    InputError
        An unknown law or parameter, an unknown edge name, no edge that is held or moved, or a force without a scale.
    """
    _check_scale(plan)
    return "\n".join([_HEAD, *_experiment(plan), "", *_camera(plan), "", *_material(plan), *_boundaries(plan),
                      *_channel(plan)])


def _check_scale(plan: Plan) -> None:
    """A force is stress times width and thickness in mm; a logged motion is in mm."""
    logged = any(motion.kind == "column" for motion in plan.motions.values())
    if plan.pixel_size_mm is None and (plan.force is not None or logged):
        raise InputError("a force or a logged motion needs the scale", key="pixel_size_mm",
                         expected="the size of a pixel in mm",
                         found="none",
                         remedy="set two points at a known distance, or choose no force and no logged motion")
    if plan.thickness_mm is None and (plan.force is not None or plan.kind == "solid"):
        user, alternative = ("a solid", "a plane model") if plan.kind == "solid" else ("a force", "no force")
        raise InputError(f"{user} needs the thickness", key="thickness_mm", expected="the thickness in mm",
                         found="none", remedy=f"give the thickness, or choose {alternative}")


def tables_of(plan: Plan) -> dict:
    """The tables of that text."""
    return tomllib.loads(text_of(plan))


def _experiment(plan: Plan) -> list[str]:
    lines = ["[experiment]", f"title = {_text(plan.title)}", f"images = {_patterns(plan.images)}"]
    if plan.loads is not None:
        lines.append(f"loads = {_text(plan.loads)}")
    if plan.frame_interval_s is not None:
        lines.append(f"frame_interval_s = {plan.frame_interval_s!r}")
    lines.append(f"kind = {_text(plan.kind)}")
    if plan.kind == "solid":
        return [*lines, 'surface = "FRONT"', f"mesh = {mesh_text(plan.sketch, plan.thickness_mm)}"]
    if plan.thickness_mm is not None:
        lines.append(f"thickness_mm = {plan.thickness_mm!r}")
    return [*lines, f"mesh = {mesh_text(plan.sketch)}"]


def mesh_text(sketch: Sketch, through_mm: float | None = None) -> str:
    """The value of ``mesh`` in [experiment]: one line, as TOML wants it; through_mm : thickness of a solid."""
    parts = [f"outline_px = {_numbers(sketch.outline)}"]
    if sketch.holes:
        parts.append(f"holes_px = {_numbers(sketch.holes)}")
    parts += [f"element_px = {sketch.element_px:.6g}", f"elements = {_text(sketch.elements)}"]
    if sketch.edge_names:
        names = ", ".join(f"{name} = {json.dumps(numbers)}" for name, numbers in sketch.edge_names.items())
        parts.append(f"edge_names = {{ {names} }}")
    if through_mm is not None:
        parts.append(f"through_mm = {through_mm!r}")
    if sketch.mesher != "idic":
        parts.append(f"mesher = {_text(sketch.mesher)}")
    return f"{{ {', '.join(parts)} }}"


def _camera(plan: Plan) -> list[str]:
    lines = ["[camera]"]
    if plan.pixel_size_mm is not None:
        lines.append(f"pixel_size_mm = {plan.pixel_size_mm!r}")
    lines += [f"origin_px = {_numbers(list(plan.origin_px))}", f"axes = {json.dumps(list(plan.axes))}"]
    return [*lines, f"rotation_deg = {plan.rotation_deg!r}"] if plan.rotation_deg else lines


def _material(plan: Plan) -> list[str]:
    units = {entry.name: entry.unit for entry in get_law(plan.law).parameters}
    lines = [f"[material.{MATERIAL}]", f"law = {_text(plan.law)}"]
    for name, start in plan.parameters.items():
        if name not in units:
            raise InputError("no such parameter", key=f"material.{MATERIAL}", expected=", ".join(units), found=name,
                             remedy="choose the law again")
        unit = f', unit = "{units[name]}"' if units[name] not in ("", "-") else ""
        identify = ", identify = true" if start.identify else ""
        lines.append(f"{name} = {{ value = {start.value!r}{unit}{identify} }}")
    return lines


def _boundaries(plan: Plan) -> list[str]:
    lines: list[str] = []
    end_along_z = next((name for name, motion in plan.motions.items() if motion.kind in ("fixed", "column")), None)
    for name, motion in plan.motions.items():
        edges = [*plan.sketch.edge_names, "OUTER", *(f"HOLE{k + 1}" for k in range(len(plan.sketch.holes)))]
        if name not in edges:
            raise InputError("no edge has this name", key="boundary", expected=", ".join(edges),
                             found=name, remedy="name an edge of the drawing")
        lines += ["", "[[boundary]]"]
        if motion.kind == "pressure":
            lines.append(f"pressure = {{ column = {_text(motion.column)}, edges = {_text(name)}, follower = true }}")
            continue
        lines.append(f"nodes = {_text(name)}")
        if motion.kind == "measured":
            lines.append('u = "measured"')
        elif motion.kind == "fixed":
            lines += ["ux = 0.0", "uy = 0.0"]
        else:
            transverse = {"x": "y", "y": "x"}[motion.component]
            lines += [f"u{motion.component} = {{ column = {_text(motion.column)} }}", f"u{transverse} = 0.0"]
        if plan.kind == "solid" and name == end_along_z:
            lines.append("uz = 0.0")
    if all(motion.kind == "pressure" for motion in plan.motions.values()):
        raise InputError("nothing holds or moves the specimen", key="boundary", expected="a motion of one edge or more",
                         found="pressure only" if lines else "none",
                         remedy="choose what moves the ends: the images, the log, or held")
    return lines


def _channel(plan: Plan) -> list[str]:
    if plan.force is None:
        return [""]
    noise = [f"noise_std = {plan.force.noise_std!r}"] if plan.force.noise_std is not None else []
    return ["", "[[channel]]", f"column = {_text(plan.force.column)}",
            f'simulated = {{ reaction = "{plan.force.edge}", component = "{plan.force.component}" }}', *noise, ""]


def _patterns(name: str) -> str:
    """The patterns of a group of images, by its name in the listing of the folder."""
    try:
        several = json.loads(name) if name.startswith('["') else name
    except (ValueError, RecursionError):
        several = name
    return json.dumps(several, ensure_ascii=False)


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False)


def _numbers(value: object) -> str:
    """Numbers and lists of numbers, a hundredth of a pixel apart."""
    if isinstance(value, list):
        return f"[{', '.join(_numbers(entry) for entry in value)}]"
    return f"{round(float(value), 2):g}" if abs(value) < 1e5 else repr(float(value))


def loaded(folder: Path, plan: Plan) -> Experiment:
    """The experiment that the plan describes; nothing is written.

    Raises
    ------
    InputError
        As `idic check` finds it.
    """
    file, tables = folder / EXPERIMENT_FILE, tables_of(plan)
    return ExperimentFolder(file, folder.resolve(), validated(tables, file), tables).experiment()


def write(folder: Path, plan: Plan, replace: bool, drawn_text: str = "") -> str:
    """Write experiment.toml after everything in it was read and checked; returns its content.

    Parameters
    ----------
    replace : bool
        An existing experiment.toml is kept as experiment.toml.before; False: it is an error.
    drawn_text : str
        What the page wrote last: a file with this content is not kept.

    Raises
    ------
    InputError
        The plan does not work, or there is an experiment.toml already; nothing is written then.
    """
    target, text = folder / EXPERIMENT_FILE, text_of(plan)
    is_taken = os.path.lexists(target)
    present_text = read_inside(folder, EXPERIMENT_FILE).decode(errors="replace") if is_inside(
        folder, EXPERIMENT_FILE) else None
    if not replace and is_taken:
        raise InputError("the folder has an experiment already", file=target, key="replace",
                         expected="no experiment.toml",
                         found="an experiment.toml", remedy=f"replace it (the old one is kept as {KEPT})")
    if present_text == text:
        return text
    loaded(folder, plan)
    if is_taken and (present_text is None or present_text != drawn_text):
        replace_inside(folder, EXPERIMENT_FILE, _free(folder))
    write_inside(folder, EXPERIMENT_FILE, text)
    return text


def _free(folder: Path) -> str:
    names = (KEPT, *(f"{KEPT}-{k}" for k in range(2, 1000)))
    return next(name for name in names if not os.path.lexists(folder / name))


def drawn_before(folder: Path) -> dict | None:
    """The drawing of the folder's experiment.toml, as the page draws it; None where there is none or it is another
    mesh."""
    try:
        table = read_toml(folder / EXPERIMENT_FILE).get("experiment", {}).get("mesh", {})
    except (InputError, OSError):
        return None
    if not isinstance(table, dict) or "outline_px" not in table:
        return None
    field_of_key = {"outline_px": "outline", "holes_px": "holes"}
    try:
        return Sketch.model_validate({field_of_key.get(key, key): value for key, value in table.items()
                                      if key not in THROUGH}).model_dump()
    except ValueError:
        return None
