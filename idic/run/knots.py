"""``knots = "evidence"``: a free function of most knots is identified in memory; its evidence chooses those of the run.

The experiment of the run has the chosen knots and smoothness in its tables (as ``--set`` would), starts where the first
identification has ended, and tells the evidence in a note.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from idic.errors import InputError
from idic.experiment_file import (
    BY_EVIDENCE, KIND as FREE_SURFACE, SPECTRUM, SPREAD, SURFACE, StatedCurve, locate, read_toml, with_overrides,
)
from idic.identification import (
    ChosenKnots, FreeCurve, FreeForm, FreeSpectrum, FreeSurface, Identification, identify, log_progress, scaled_system,
)
from idic.laws import RINGS, TERM
from idic.model import Experiment
from idic.parameters import ParameterSet, SmoothnessPrior
from idic.run.part import RunPart
from idic.run.prepared.context import experiments_of
from idic.run.prepared.in_memory import prepare_in_memory

Say = Callable[[str], None]


def with_chosen_knots(parts: Mapping[str, RunPart], say: Say = lambda text: None) -> dict[str, RunPart]:
    """The part of a run with the knots that the evidence leaves; those of an earlier process where there was one.

    Raises
    ------
    InputError
        Where several experiments share a material.
    """
    if len(parts) > 1:
        _refuse_evidence(part.experiment for part in parts.values())
    (name, part), = parts.items()
    if part.prepared:
        return {name: replace(part, overrides=dict(experiments_of(part.store.run)[0].overrides))}
    tables = with_overrides(read_toml(locate(part.path)), part.overrides)
    with threadpool_limits(1, user_api="blas"):
        return {name: replace(part, overrides=part.overrides | chosen_tables(part.experiment, tables, say))}


def _refuse_evidence(experiments: Iterable[Experiment]) -> None:
    for experiment in experiments:
        for curve in experiment.model.curves_by_evidence:
            raise InputError("knots by evidence work for one experiment only",
                             key=f"material.{curve.names[0].partition('.')[0]}", found=f'knots = "{BY_EVIDENCE}"',
                             expected="a number of knots where several experiments are identified together",
                             remedy="identify one of them alone, and write the knots and the smoothness of its report")


def chosen_tables(experiment: Experiment, tables: Mapping, say: Say = lambda text: None) -> dict[str, dict]:
    """Overrides ``material.SET`` with the chosen knots; none where the first identification finds no solution.

    Parameters
    ----------
    tables : of the experiment, composed laws with flat parameters

    Raises
    ------
    InputError
        A value of the curve that is not identified.
    """
    curves = experiment.model.curves_by_evidence
    for curve in curves:
        locked = [name for name in curve.names if not experiment.model.parameters[name].free]
        if locked:
            raise InputError("knots by evidence need values that are all identified", key=f"material.{locked[0]}",
                             expected="identify = true", found="a locked value",
                             remedy="identify it, or give a number of knots")
    most = ", ".join(f"{len(curve.names)} values of {curve.key}" for curve in curves)
    say(f"number of knots by evidence: a first identification with the most, {most}")
    prepared = prepare_in_memory(experiment, say)
    identification = identify(prepared.start, prepared.local, progress=log_progress(say), motion=prepared.motion,
                              searched=prepared.begin is not None)
    if identification.point is None or identification.point.system is None:
        return {}
    overrides: dict[str, dict] = {}
    for curve in curves:
        chosen = evidence_of(identification, curve)
        element_set = curve.names[0].partition(".")[0]
        key = f"material.{element_set}"
        table = overrides.get(key, tables["material"][element_set])
        overrides[key] = _with_knots(table, curve, chosen, identification.parameters)
        noun = {SPECTRUM: "relaxation times", SURFACE: "knots on a ring"}.get(curve.key, "knots")
        say(f"{element_set}.{curve.key}: {chosen.n} {noun}, smoothness {chosen.smoothness.strength:g}")
    return overrides


def evidence_of(identification: Identification, curve: StatedCurve) -> ChosenKnots:
    """Knots and smoothness of a curve where an identification has ended."""
    assert identification.point is not None and identification.point.system is not None
    parameters, system = identification.parameters, identification.point.system
    priors = [prior for prior in parameters.joint
              if not (isinstance(prior, SmoothnessPrior) and prior.names == curve.names)]
    names_of_form = curve.names if curve.key == SURFACE else ()  # the prior of every weight is one of the form
    without = ParameterSet((replace(p, prior_mean=None, prior_std=None) if p.name in names_of_form else p
                            for p in parameters.values()), priors)
    scaled = scaled_system(system, without, identification.point.reference_gram, identification.weights.image_noise)
    values = np.array([parameters[name].value for name in scaled.names])
    at = tuple(scaled.names.index(name) for name in curve.names)
    return ChosenKnots.of(scaled.M, scaled.b, values, scaled.slopes, _form_of(curve, at, parameters))


def _form_of(curve: StatedCurve, at: tuple[int, ...], parameters: ParameterSet) -> FreeForm:
    if curve.key == SURFACE:
        return FreeSurface(at, tuple(parameters[name].value for name in curve.names), curve.size, SPREAD)
    last_knot = parameters[curve.last_knot].value
    if curve.key == SPECTRUM:
        first = curve.last_knot.replace("longest", "shortest")
        return FreeSpectrum(at, parameters[first].value, last_knot, curve.size)
    return FreeCurve(at, last_knot, curve.size, curve.over)


def _with_knots(table: Mapping, curve: StatedCurve, chosen: ChosenKnots, parameters: ParameterSet) -> dict:
    """A material's table with the chosen knots of one of its free functions."""
    short = [name.partition(".")[2] for name in curve.names]
    chosen_table = {key: value for key, value in table.items() if key not in short[len(chosen.levels):]}
    chosen_table["law"] = _law_with(table["law"], curve, chosen.n)
    for name, key, level in zip(curve.names, short, chosen.levels, strict=False):
        if parameters[name].transform == "log" or curve.key in (SURFACE, SPECTRUM):  # the start of another is its scale
            entry = table[key] if isinstance(table[key], Mapping) else {}
            chosen_table[key] = {**entry, "value": float(level) / parameters[name].factor}
    smoothness = {"strength": chosen.smoothness.strength, "over": chosen.smoothness.over, "size": curve.size,
                  "evidence": {str(n): round(float(ln_z), 2) for n, ln_z in chosen.evidence.items()}}
    return chosen_table | {"smoothness": {**table["smoothness"], curve.key: smoothness}}


def _law_with(law: str, curve: StatedCurve, n: int) -> str:
    """The name of the law with n knots of one of its free functions."""
    if curve.key == SURFACE:
        return law.replace(f"{FREE_SURFACE}{len(curve.names) // RINGS}", f"{FREE_SURFACE}{n}")
    if curve.key == SPECTRUM:
        return f"{law.partition('(')[0]}({n})"
    if TERM.search(law):
        return law.replace(f"free{len(curve.names)}", f"free{n}")
    name, _, counts = law.rstrip(")").partition("(")
    numbers = counts.split("+")
    numbers[int(curve.key[-1]) - 1] = str(n)
    return f"{name}({'+'.join(numbers)})"
