"""The cases: what is run, and what of it is kept.

A case writes its inputs and runs commands of idic, nothing else: it outlives every move of a module.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from idic_studies.equality import external_strip, field_stages, spoiled
from idic_studies.equality.strips import PLASTIC, PLASTIC_START, Strip, strip_mesh, write_recorded
from idic_studies.equality.workshop import Workshop

HERE = ("--no-prefect", "--workers", "0")  # in this process: its computations are counted
NOT_CONVERGED = 3  # exit code
KILLED_AT_PASS = 40  # of the image: within an evaluation
PLASTIC_STRIP = Strip("strip that yields", PLASTIC, PLASTIC_START, ((0.0, 0.0), (5.0, 0.15), (6.0, 0.12)), 7)


@dataclass(frozen=True)
class Case:
    """A case; fast : a few seconds of CPU time, compared by the default tests."""

    name: str
    subject: str
    run: Callable[[Workshop], None]
    fast: bool = False


def demo(workshop: Workshop) -> None:
    workshop.idic("demo", "--out", "demo", *HERE)
    workshop.inputs.append("demo/experiment")
    workshop.outputs.append("demo/run")


def demo_two_workers(workshop: Workshop) -> None:
    workshop.idic("demo", "--out", "demo", "--workers", "2")
    workshop.inputs.append("demo/experiment")
    workshop.outputs.append("demo/run")


def joint(workshop: Workshop) -> None:
    write_recorded(workshop, "first", Strip("first"), seed=1)
    write_recorded(workshop, "second", Strip("second", program=((0.0, 0.0), (4.0, 0.2)), n_frames=7), seed=2)
    workshop.idic("identify", "first", "second", "--out", "run", *HERE, "--no-report")
    workshop.outputs.append("run")


def resumed(workshop: Workshop) -> None:
    write_recorded(workshop, "test", PLASTIC_STRIP, seed=3)
    words = ("identify", "test", "--out", "run", *HERE, "--no-report")
    workshop.killed_idic("image_passes", KILLED_AT_PASS, *words)
    workshop.idic(*words, "--resume")
    workshop.outputs.append("run")


def external(workshop: Workshop) -> None:
    external_strip.write_recorded(workshop, "test")
    workshop.idic("identify", "test", "--out", "run", *HERE, "--no-report", *external_strip.PERMISSION)
    workshop.outputs.append("run")


def stereo(workshop: Workshop) -> None:
    _identify_example(workshop, "stereo")


def height(workshop: Workshop) -> None:
    _identify_example(workshop, "bulge")


def polycarbonate(workshop: Workshop) -> None:
    """Ends before it has converged: so do tests, and words and exit code say so."""
    _identify_example(workshop, "polycarbonate", "--set", "options.max_iterations=3", exit_code=NOT_CONVERGED)


def _identify_example(workshop: Workshop, name: str, *options: str, exit_code: int = 0) -> None:
    workshop.idic("example", name, "--reduced", "--out", "test")
    workshop.idic("identify", "test", "--out", "run", *HERE, *options, exit_code=exit_code)
    workshop.inputs.append("test")
    workshop.outputs.append("run")


def field(workshop: Workshop) -> None:
    generator = np.random.default_rng(4)
    for number, table in enumerate(field_stages.stage_tables(generator)):
        workshop.write(f"test/stages/stage_{number}.csv", table)
    workshop.write("test/loads.csv", field_stages.log(generator))
    workshop.write("test/experiment.toml", field_stages.EXPERIMENT)
    workshop.idic("check", "test", "--no-picture")
    workshop.idic("identify", "test", "--out", "run", *HERE, "--no-report")
    workshop.inputs.append("test")
    workshop.outputs.append("run")


def design(workshop: Workshop) -> None:
    longer_test = replace(PLASTIC_STRIP, title="the same, pulled further",
                          program=((0.0, 0.0), (5.0, 0.25), (6.0, 0.2)))
    for name, strip in (("pulled", PLASTIC_STRIP), ("further", longer_test)):
        workshop.write(f"{name}/experiment.toml", strip.plan(strip.start))
        workshop.write(f"{name}/mesh.inp", strip_mesh(strip.mesh))
        workshop.inputs.append(name)
    workshop.idic("design", "pulled", "further", "--out", "plans", "--workers", "0")
    workshop.outputs.append("plans")


def systematic(workshop: Workshop) -> None:
    write_recorded(workshop, "test", Strip(), seed=5)
    workshop.idic("identify", "test", "--out", "run", *HERE, "--no-report")
    workshop.idic("systematic", "run", "--workers", "0")
    workshop.outputs.append("run")


def diagnosis_clean(workshop: Workshop) -> None:
    write_recorded(workshop, "test", spoiled.LONG_STRIP, seed=6)
    _diagnose(workshop)


def diagnosis_one_cause(workshop: Workshop) -> None:
    write_recorded(workshop, "test", replace(spoiled.LONG_STRIP, truth=spoiled.YIELDING), seed=7)
    _diagnose(workshop)


def diagnosis_two_causes(workshop: Workshop) -> None:
    write_recorded(workshop, "test", replace(spoiled.LONG_STRIP, truth=spoiled.YIELDING), seed=8)
    spoiled.illuminate_unevenly(workshop.path("test"))
    _diagnose(workshop)


def diagnosis_outside(workshop: Workshop) -> None:
    write_recorded(workshop, "test", spoiled.LONG_STRIP, seed=9)
    spoiled.see_through_haze(workshop.path("test"), np.random.default_rng(9))
    _diagnose(workshop)


def _diagnose(workshop: Workshop) -> None:
    workshop.idic("identify", "test", "--out", "run", *HERE, "--no-report")
    workshop.idic("diagnose", "run", *HERE)
    workshop.outputs.append("run")


CASES = {case.name: case for case in (
    Case("demo", "the whole main job", demo),
    Case("demo_two_workers", "the same as a flow, with two worker processes", demo_two_workers),
    Case("joint", "two experiments that share a material", joint, fast=True),
    Case("resumed", "an identification that was killed and resumed", resumed, fast=True),
    Case("external", "another program as the solver", external, fast=True),
    Case("stereo", "two cameras at an angle", stereo),
    Case("height", "height images of a bulge", height),
    Case("polycarbonate", "a glassy polymer that necks", polycarbonate),
    Case("field", "measured fields in place of images", field, fast=True),
    Case("design", "error bars before the test, of two plans", design, fast=True),
    Case("systematic", "what the error bars do not count", systematic),
    Case("diagnosis_clean", "diagnosis of a sound model", diagnosis_clean, fast=True),
    Case("diagnosis_one_cause", "diagnosis of one missing physics", diagnosis_one_cause),
    Case("diagnosis_two_causes", "diagnosis of two missing physics", diagnosis_two_causes),
    Case("diagnosis_outside", "diagnosis of what the library does not hold", diagnosis_outside),
)}
