"""A mesh and a log from a stranger: names of sets and columns that look like paths stay names."""

import json

import pytest
from virtual_tests.small_strip import write_small_strip

import idic
from idic.run import write_report
from idic.virtual_tests import DemoSize

SMALL = DemoSize(0.2, (60, 110), (3, 3, 4), (2, 2, 1), (2, 2, 1), 1)
SET, COLUMN = "../../../../../elsewhere/s", "Force/top_N"


@pytest.fixture
def folder(tmp_path):
    folder = write_small_strip(tmp_path / "laboratory" / "test", SMALL)
    for name, pairs in {"experiment.toml": ((".sheet]", f'."{SET}"]'), ('"sheet.', f'"{SET}.'), ("force_N", COLUMN)),
                        "mesh.inp": (("sheet", SET),), "loads.csv": (("force_N", COLUMN),)}.items():
        file = folder / name
        text = file.read_text()
        for old, new in pairs:
            text = text.replace(old, new)
        file.write_text(text)
    assert SET in (folder / "mesh.inp").read_text() and COLUMN in (folder / "loads.csv").read_text()
    return folder


def test_nothing_is_written_outside_the_run_and_the_report_is_made(folder, tmp_path):
    run = tmp_path / "laboratory" / "run"
    before = {file for file in tmp_path.rglob("*") if not file.is_relative_to(run)}
    few = {"options.max_iterations": 1}
    result = idic.identify(folder, run, sensitivity="perturbed", overrides=few)
    assert f"{SET}.E" in result["parameters"]
    assert COLUMN in json.loads((run / "result.json").read_text())["residual"]["channel_rms"]
    write_report(run)
    assert list((run / "figures").glob("channel_Force_2Ftop_N*")) and COLUMN in (run / "report.html").read_text()
    assert {file for file in tmp_path.rglob("*") if not file.is_relative_to(run)} == before
    again = idic.identify(folder, run, sensitivity="perturbed", resume=True, overrides=few)
    assert again["parameters"] == result["parameters"]
