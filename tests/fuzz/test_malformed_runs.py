"""RUN folders spoilt in stores and descriptions: computed anew, read as they were, or refused with one message."""

from __future__ import annotations

import csv
import json
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from base_experiments import base_folder
from commands import assert_fair, campaign, contents, copy_of, idic, within_outcome
from hypothesis import strategies as st
from scratch import lasting_folder
from spoil_run import describe, flip, forged, forged_runs, spoilt_runs

from idic import identify
from idic.cli.app import exit_code
from idic.cli.outcomes import BAD_INPUT, DONE
from idic.errors import InputError
from idic.report.fields.viewer import viewer_data
from idic.report import render_page
from idic.run import RESULT_FILE, open_run, open_source, read_result, write_report
from idic.run.judgement.accepted_point import channels_of
from idic.run.reporting.write import load_record, write_numbers

BASES = ("cameras", "grips")
OVERRIDES = {"options.weighting": "noise"}  # a diagnosis weighs by it


@cache
def whole_run(base: str) -> Path:
    """The RUN of a base experiment; copied, never changed."""
    run = lasting_folder("run") / base
    identify(base_folder(base), run, overrides=OVERRIDES)
    return run


@cache
def whole_tables(base: str) -> dict[str, list]:
    """The CSV tables of its report."""
    with copy_of(whole_run(base)) as run:
        _write_numbers(run)
        return tables(run)


def tables(run: Path) -> dict[str, list]:
    return {path.name: list(csv.reader(path.read_text().splitlines())) for path in sorted(run.glob("tables/*.csv"))}


def parameters(run: Path) -> dict:
    return read_result(run)["parameters"]


def assert_the_same(found: dict, base: str) -> None:
    """Values, standard deviations and all that is said of the parameters, to the last bit."""
    assert found == parameters(whole_run(base))


# what reads a RUN -------------------------------------------------------------------------------------
def resume(run: Path, base: str, sure: bool) -> None:
    again = {"resume": True, "overrides": OVERRIDES}
    answer = within_outcome(lambda: exit_code(identify(base_folder(base), run, **again)["status"]))
    usual = exit_code(read_result(whole_run(base))["status"])
    assert_fair(answer, (usual, BAD_INPUT))
    if sure and answer.code == usual:
        assert_the_same(parameters(run), base)


def compare(run: Path, base: str, sure: bool) -> None:
    with tempfile.TemporaryDirectory(prefix="idic-fuzz-") as out:
        answer = idic("compare", whole_run(base), run, "--out", Path(out) / "page")
        assert_fair(answer, (DONE, BAD_INPUT))
        if answer.code == BAD_INPUT:
            assert not (Path(out) / "page").exists()
        elif sure:
            for row in json.loads((Path(out) / "page" / "compare.json").read_text())["parameters"]:
                first, second = row["values"]
                assert first == second


def diagnose(run: Path, base: str, sure: bool) -> None:
    """What `idic diagnose` starts from; the rest of it rests on nothing else."""
    found = []
    answer = within_outcome(lambda: found.append(open_source(run)) or DONE)
    assert_fair(answer, (DONE, BAD_INPUT))
    if sure and answer.code == DONE:
        (_, there), (_, truth) = found[0], open_source(whole_run(base))
        assert there.parameters.as_values() == truth.parameters.as_values()
        for name in ("M", "b", "spread"):
            np.testing.assert_array_equal(getattr(there.point.system, name), getattr(truth.point.system, name))
        np.testing.assert_array_equal(there.local, truth.local)


def report(run: Path, base: str, sure: bool) -> None:
    answer = idic("report", run)
    assert_fair(answer, (DONE, BAD_INPUT))
    if sure and answer.code == DONE:
        assert tables(run) == whole_tables(base)


def numbers(run: Path, base: str, sure: bool) -> None:
    """A report without its figures, which are drawn from the record alone and take twenty times as long."""
    answer = within_outcome(lambda: _write_numbers(run))
    assert_fair(answer, (DONE, BAD_INPUT))
    if sure and answer.code == DONE:
        assert tables(run) == whole_tables(base)


def _write_numbers(run: Path) -> int:
    record = load_record(run)
    write_numbers(run, record, paraview=True)
    viewer_data(record)
    render_page(record, ())
    return DONE


READERS = {"resume": resume, "compare": compare, "diagnose": diagnose, "numbers": numbers, "report": report}


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("reader", [*list(READERS)[:-1], pytest.param("report", marks=pytest.mark.slow)])  # it draws
def test_whole_runs_are_read(base, reader):
    with copy_of(whole_run(base)) as run:
        READERS[reader](run, base, True)


def a_spoilt_run(base, spoilt, reader):
    with copy_of(whole_run(base)) as run:
        spoilt(run)
        before = contents(run)
        READERS[reader](run, base, not forged(spoilt))
        if reader in ("compare", "diagnose"):
            assert contents(run) == before, "something was written"


@pytest.mark.parametrize("reader", ["compare", "diagnose", "report"])
def test_a_digit_that_somebody_changed_in_a_result_is_refused(reader):
    with copy_of(whole_run("cameras")) as run:
        text = (run / RESULT_FILE).read_text()
        value = f'"value": {parameters(run)["SPECIMEN.E"]["value"]!r}'
        assert text.count(value) == 1
        (run / RESULT_FILE).write_text(text.replace(value, value[:-1] + str((int(value[-1]) + 1) % 10)))
        answer = within_outcome(lambda: open_source(run) and DONE) if reader == "diagnose" else idic(
            reader, run, *([run] if reader == "compare" else []))
        assert answer.code == BAD_INPUT and "was altered" in answer.said and "--resume" in answer.said


def test_a_report_of_a_damaged_description_says_nothing_but_the_refusal():
    """Found by the campaign: the name of a stage came first."""
    with copy_of(whole_run("grips")) as run:
        for described in sorted(run.glob("run.zarr/evaluations/*/base/zarr.json")):
            flip(described, 654)
        assert_fair(idic("report", run), (BAD_INPUT,))


def test_channels_of_a_damaged_description_are_computed_again():
    """Of the simulation of the accepted point, which is sealed, too."""
    with copy_of(whole_run("grips")) as run:
        context, result = open_run(str(run)), json.loads((run / RESULT_FILE).read_text())
        before = channels_of(context, result)
        flip(run / "run.zarr" / "channels" / "zarr.json", 654)
        assert context.store.finished("channels") is None
        np.testing.assert_array_equal(channels_of(context, result), before)


def test_a_damaged_frame_is_told_before_the_figures_are_drawn():
    """The motion of a frame in the middle of the test: only ParaView's files hold it."""
    stages: list[str] = []
    with copy_of(whole_run("grips")) as run:
        chunks = sorted(path for path in run.glob("run.zarr/evaluations/000/base/u/c/**/*") if path.is_file())
        flip(chunks[len(chunks) // 2], 323)
        with pytest.raises(InputError, match="missing or damaged"):
            write_report(run, stages.append, paraview=True)
    assert not [stage for stage in stages if "figures" in stage]


def test_a_fill_value_beyond_the_type_of_its_array_is_refused():
    """Found by the campaign: Zarr overflows."""
    with copy_of(whole_run("cameras")) as run:
        described = next(run.glob("run.zarr/evaluations/000/system/frame_frame/zarr.json"))
        describe(described, ("fill_value", 1e308, True))
        assert_fair(within_outcome(lambda: _write_numbers(run)), (BAD_INPUT,))


@pytest.mark.parametrize("array", ["images/stack", "evaluations/000/system/frame_frame"])
def test_an_array_of_more_chunks_than_a_disk_holds_is_damage(array):
    """Found by the campaign: the names of 10^12 chunks took the memory."""
    with copy_of(whole_run("cameras")) as run:
        found = sorted(run.glob(f"run.zarr/{array}/zarr.json")) or sorted(run.glob("run.zarr/*/*/zarr.json"))
        describe(found[0], ("shape", [1_000_000_000_000], True))
        resume(run, "cameras", True)


@pytest.mark.parametrize("chunk", [0, -1, 1_000_000_000_000, 0.5])
@pytest.mark.parametrize("reader", ["resume", "numbers"])
def test_chunks_of_an_impossible_size_are_damage(reader, chunk):
    """Found by the campaign: division by zero."""
    with copy_of(whole_run("grips")) as run:
        described = next(run.glob("run.zarr/channels/*/zarr.json"))
        length = len(json.loads(described.read_text())["shape"])
        grid = {"name": "regular", "configuration": {"chunk_shape": [chunk] * length}}
        describe(described, ("chunk_grid", grid, True))
        READERS[reader](run, "grips", True)


@pytest.mark.parametrize("identity", [1e308, -1, True, [], {}, "x" * 3000])
def test_a_run_whose_identity_is_no_identity_is_refused(identity):
    """Found by the campaign: a number has no first characters."""
    with copy_of(whole_run("cameras")) as run:
        described = run / "run.zarr" / "zarr.json"
        content = json.loads(described.read_text())
        content["attributes"]["identity"] = identity
        described.write_text(json.dumps(content))
        answer = within_outcome(lambda: exit_code(identify(
            base_folder("cameras"), run, resume=True, overrides=OVERRIDES)["status"]))
        assert_fair(answer, (BAD_INPUT,))
        assert "belongs to another experiment" in answer.said


def test_a_point_that_describes_itself_as_a_number_is_refused():
    with copy_of(whole_run("cameras")) as run:
        for described in run.glob("run.zarr/evaluations/*/*/zarr.json"):
            content = json.loads(described.read_text())
            described.write_text(json.dumps(content | {"attributes": content["attributes"] | {"ident": 0}}))
        answer = within_outcome(lambda: open_source(run) and DONE)
        assert_fair(answer, (BAD_INPUT,))


test_a_spoilt_run, test_many_spoilt_runs = campaign(
    8,
    a_spoilt_run,
    base=st.sampled_from(BASES),
    spoilt=spoilt_runs,
    reader=st.sampled_from(["resume", "resume", "compare", "diagnose"]),
)
test_numbers_of_a_spoilt_run, test_many_numbers_of_spoilt_runs = campaign(
    2, a_spoilt_run, base=st.sampled_from(BASES), spoilt=spoilt_runs, reader=st.just("numbers")
)
test_a_forged_run, test_many_forged_runs = campaign(
    12, a_spoilt_run, base=st.sampled_from(BASES), spoilt=forged_runs,
    reader=st.sampled_from(["resume", "compare", "diagnose", "numbers"])
)
_, test_many_reports_of_spoilt_runs = campaign(
    1, a_spoilt_run, share=0.01, base=st.sampled_from(BASES), spoilt=spoilt_runs, reader=st.just("report")
)
