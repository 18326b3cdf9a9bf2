"""An experiment and a result as a notebook shows them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from html import escape

from idic.model import Column, Constant, Controlled, Drive, Experiment, Model, Parametrised
from idic.notebook.estimates import Estimates, estimates_html
from idic.parameters import Parameter
from idic.report import overlay, result_headline, with_std

PICTURE_PX = 480  # width


def experiment_html(experiment: Experiment) -> str:
    """What was recorded, what is identified, the mesh on the reference image, notes."""
    model, recording = experiment.model, experiment.recording
    facts = [recording.in_words().replace(" x ", " × "),
             f"{model.mesh.n_elements} elements, {model.mesh.n_nodes} nodes",
             model.kind.replace("_", " ")]
    if model.thickness is not None:
        facts.append(f"{model.thickness:g} {model.length_unit} thick")
    facts.append("noise to be measured" if recording.noise.std_gv is None
                 else f"noise {recording.noise.std_gv:.3g} {escape(recording.value_unit)}")
    drives = [f"{entry.nodes}: u{entry.component} {_drive(entry.drive, model.length_unit)}"
              for entry in model.prescribed]
    drives += [f"{load.edges}: {load.kind} {_drive(load.drive, '')}" for load in model.loads]
    channels = [f"{channel.column}: {channel.kind} of {channel.nodes}" for channel in model.channels]
    picture = "" if recording.stack is None else (
        f"<img alt='mesh on the reference image' style='max-width:100%;width:{PICTURE_PX}px' "
        f"src='{overlay(experiment).data_uri}'>")
    return (f"<div><b>{escape(experiment.title)}</b><p>{', '.join(facts)}</p>{_start_values(model)}"
            f"{_listed('Boundaries', drives)}{_listed('Channels', channels)}{_listed('Notes', experiment.notes)}"
            f"{picture}</div>")


def result_html(content: Mapping, estimates: Estimates, failure: str | None = None) -> str:
    """What was found, in sentences and as a table; locked parameters are left out. failure : of the last simulation"""
    first, *sentences = [*result_headline(content), *([failure] if failure else [])]
    identified = [estimate for estimate in estimates.values() if estimate.free]
    return (f"<div><b>{escape(content.get('title') or 'Result')}</b><p>{escape(first)}</p>{estimates_html(identified)}"
            f"{''.join(f'<p>{escape(sentence)}</p>' for sentence in sentences)}</div>")


def _start_values(model: Model) -> str:
    rows = "".join(f"<tr><td style='text-align:left'>{escape(p.name)}</td>"
                   f"<td>{escape(with_std(p.shown, None, p.unit))}</td>"
                   f"<td style='text-align:left'>{_role(p)}</td></tr>" for p in model.parameters.values())
    return (f"<table><thead><tr><th "
            f"style='text-align:left'>parameter</th><th>start</th><th></th></tr></thead><tbody>{rows}</tbody></table>")


def _role(parameter: Parameter) -> str:
    return "identified" if parameter.free else "fixed"


def _drive(drive: Drive, unit: str) -> str:
    if isinstance(drive, Constant):
        return f"= {drive.value:g} {unit}".rstrip()
    if isinstance(drive, Column):
        return f"from column {drive.column}"
    if isinstance(drive, Controlled):
        return f"as the gauge of column {drive.column} asks"
    return f"as {drive.modes} × {drive.time_modes} modes" if isinstance(drive,
                                                                        Parametrised) else "measured from the images"


def _listed(title: str, entries: Iterable[str]) -> str:
    items = "".join(f"<li>{escape(entry)}</li>" for entry in entries)
    return f"<p style='margin-bottom:0'>{title}</p><ul style='margin-top:0'>{items}</ul>" if items else ""
