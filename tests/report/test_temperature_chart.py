"""The temperature in the report, and alpha in the list of laws."""

import io
from dataclasses import replace

import numpy as np
from made_up_run import make_record
from rich.console import Console

from idic.cli.tables import laws_table
from idic.materials import get_law
from idic.report.figures import charts


def test_the_temperature_is_drawn_where_there_is_one():
    record = make_record()
    assert charts.temperature(record) is None
    frames = np.arange(record.n_frames)
    picture = charts.temperature(replace(record, temperature=np.stack([-0.1 * frames, frames, 3.0 * frames], axis=1)))
    assert picture.name == "temperature" and picture.png.startswith(b"\x89PNG")


def test_the_list_of_laws_says_that_every_law_expands():
    out = io.StringIO()
    Console(file=out, width=140).print(laws_table([get_law("elastic")]))
    (line,) = [line for line in out.getvalue().splitlines() if "alpha" in line]
    assert "every law" in line and "1/K" in line and " 0 " in line
