"""A report of a run that was interrupted shows its accepted point, or says what to do."""

from __future__ import annotations

import json
import shutil
import time
from dataclasses import replace

import numpy as np
import pytest
from test_damage import two_cameras
from virtual_tests.small_strip import write_small_strip

import idic
from idic.errors import InputError
from idic.run import BASE, RunStore, SerialRunner, group_name, write_array
from idic.run.prepared.session import Timing
from idic.run.postprocess import write_interrupted
from idic.run.prepared.session import open_session
from idic.run.reporting.write import load_record
from idic.run.store.state_file import load_state, save_state


def interrupted(finished, run):
    """A copy of a finished run as Ctrl-C leaves it after the last step: without residual maps and channels."""
    shutil.copytree(finished, run)
    store, state = RunStore(run), load_state(run)
    for group in ("channels", "final", "cameras/second/final"):
        store.remove(group)
    save_state(run, replace(state, status="running", end=None))
    write_interrupted(open_session(run, SerialRunner(), "direct"), replace(state, status="interrupted", end=None),
                      Timing(), time.perf_counter())
    assert json.loads((run / "result.json").read_text())["status"] == "interrupted"
    return store, state.accepted.number


def test_a_run_interrupted_before_its_end_has_a_report_with_its_channels(small, gallery, tmp_path):
    interrupted(small.run, tmp_path / "run")
    np.testing.assert_array_equal(load_record(tmp_path / "run").channels[0].simulated,
                                  gallery("strip").record.channels[0].simulated)


def test_channels_of_a_pause_are_not_shown_beside_later_parameters(small, gallery, tmp_path):
    store, number = interrupted(small.run, tmp_path / "run")
    own = gallery("strip").record.channels[0].simulated
    with store.building("channels", {"evaluation": number - 1}) as folder:
        for name in ("simulated", "measured"):
            write_array(folder, name, np.zeros((len(own), 1)))
    np.testing.assert_array_equal(load_record(tmp_path / "run").channels[0].simulated, own)
    np.testing.assert_array_equal(idic.load_result(tmp_path / "run").fields.simulated[:, 0], own)


def test_a_result_that_is_older_than_the_last_step_of_a_killed_run_says_how_to_finish_it(small, tmp_path):
    store, number = interrupted(small.run, tmp_path / "run")
    store.remove(group_name(number, BASE))
    for read in (load_record, lambda run: idic.load_result(run).fields.simulated):
        with pytest.raises(InputError, match="interrupted") as problem:
            read(tmp_path / "run")
        assert "idic identify" in problem.value.remedy and "--resume" in problem.value.remedy


def test_an_interrupted_run_of_two_cameras_has_a_report(tmp_path):
    two_cameras(write_small_strip(tmp_path / "test"))
    idic.identify(tmp_path / "test", tmp_path / "done", overrides={"options.max_iterations": 1})
    interrupted(tmp_path / "done", tmp_path / "run")
    record = load_record(tmp_path / "run")
    assert len(record.cameras) == 1 and record.channels
