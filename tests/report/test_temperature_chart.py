"""The temperature in the report, and alpha in the list of laws."""

import io
from dataclasses import replace

import numpy as np
import pytest
from experiment_file.small_experiment import TOML, load_experiment, write_experiment
from made_up_run import make_record
from rich.console import Console

from idic.cli.tables import laws_table
from idic.laws import get_law
from idic.report.figures import charts
from idic.run.reporting.write import _temperature


def test_the_temperature_is_drawn_where_there_is_one():
    record = make_record()
    assert charts.temperature(record) is None
    frames = np.arange(record.n_frames)
    picture = charts.temperature(replace(record, temperature=np.stack([-0.1 * frames, frames, 3.0 * frames], axis=1)))
    assert picture.name == "temperature" and picture.png.startswith(b"\x89PNG")


def test_an_identified_course_of_the_temperature_is_drawn_with_its_knots(tmp_path):
    warm = 'nu = 0.3\nalpha = 1e-5\n[[boundary]]\ntemperature = { course = "free", knots = 2 }\n'
    experiment = load_experiment(write_experiment(tmp_path / "test", TOML.replace("nu = 0.3\n", warm)))
    accepted = experiment.model.parameters.with_values({"temperature_knot[2]": 6.0, "temperature_knot[3]": -3.0})
    assert _temperature(experiment.model, accepted) == pytest.approx(np.outer([0.0, 3.0, 6.0, -3.0], np.ones(3)))
    record = replace(make_record(), temperature=np.zeros((make_record().n_frames, 3)))
    assert "identified" in charts.temperature(record).caption


def test_the_list_of_laws_says_that_every_law_expands():
    out = io.StringIO()
    Console(file=out, width=140).print(laws_table([get_law("elastic")]))
    (line,) = [line for line in out.getvalue().splitlines() if "alpha" in line]
    assert "every law" in line and "1/K" in line and " 0 " in line
