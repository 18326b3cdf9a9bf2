"""`idic study` on a LocalCluster, killed and resumed; its records hold what `identify` finds."""

import json
import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from one_thread import ONE_THREAD

from idic.errors import InputError
from idic.identification import identify
from idic_studies.cases.case import case_experiment
from idic_studies.cases.registry import make_study
from idic_studies.cases.store import StudyStore

# 30 s of CPU time; the parts of a study by default: test_study_parts.py
pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("shared_server")]
SECONDS = 400.0  # the two runs take 30 s on a quiet machine
FIRST, SECOND = "guess/110", "noise/010"
DRIVE = """
import sys
from idic_studies.flows.study import run_study
if __name__ == "__main__":
    print(run_study("bulge", sys.argv[1], "sketch", ["reference", *sys.argv[2:]], workers=1, resume=True))
"""


def study(script, out):
    return subprocess.Popen([sys.executable, script, out, FIRST, SECOND], env=dict(os.environ) | ONE_THREAD,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)


def record_of(out, key):
    return out / "study.zarr" / "cases" / key / "zarr.json"


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A study killed after its first identification and taken up again: its folder, and when that was written."""
    folder = tmp_path_factory.mktemp("study")
    script, out = folder / "drive.py", folder / "out"
    script.write_text(DRIVE)
    process, end = study(script, out), time.monotonic() + SECONDS
    try:
        while not record_of(out, FIRST).exists():
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < end, "the study did not get so far"
            time.sleep(0.01)
    finally:
        os.kill(process.pid, signal.SIGKILL)
        process.communicate()
    assert not (out / "study.html").exists()
    written = record_of(out, FIRST).stat().st_mtime_ns
    again = study(script, out)
    said = again.communicate(timeout=SECONDS)
    assert again.returncode == 0, said
    return out, written


def test_finished_cases_are_kept_and_missing_ones_done(finished):
    out, written = finished
    assert record_of(out, FIRST).stat().st_mtime_ns == written
    assert record_of(out, SECOND).exists() and record_of(out, "reference/simulation").exists()


def test_the_store_holds_the_result_of_a_direct_identification(finished):
    out, _ = finished
    store, plan = StudyStore(out), make_study("bulge", "sketch")
    for key in (FIRST, SECOND):
        case = next(case for case in plan.cases if case.key == key)
        direct = identify(case_experiment(store, plan.rendering(case.images), case))
        record = store.read_case(key)
        names = direct.experiment.model.parameters.free
        assert record.names == names and record.facts["status"] == direct.state.status == "converged"
        assert np.array_equal(record.arrays["value"], [direct.parameters[name].shown for name in names])
        assert np.array_equal(record.arrays["std"], [direct.result["parameters"][name]["std"] for name in names])
        assert np.array_equal(record.arrays["start"] / record.arrays["truth"] > 1.04, [True] * 5)


def test_the_page_and_its_figures_are_written(finished):
    out, _ = finished
    page = (out / "study.html").read_text(encoding="utf-8")
    figures = sorted(file.stem for file in (out / "figures").iterdir())
    assert figures == ["fig13_displacements", "fig14_sensitivities", "fig17_guess_and_noise"]
    assert page.count("data:image/webp;base64,") == len(figures)
    letters = re.sub("base64,[A-Za-z0-9+/=]+", "", page.split("</style>")[1])  # four letters of a picture may be "http"
    assert "http" not in letters
    assert "3 of " in page and "cases are finished" in page
    goals = json.loads((out / "goals.json").read_text())
    assert [goal["got"] for goal in goals] == ["right from 110 %"]


def test_the_noise_of_a_case_is_in_its_images_and_in_its_error_bars(finished):
    store = StudyStore(finished[0])
    quiet, noisy = store.read_case(FIRST), store.read_case(SECOND)
    assert noisy.facts["noise"] == pytest.approx(np.hypot(0.015, 3e-4))
    assert noisy.facts["noise_units"] == pytest.approx(1.0, abs=0.05)  # spline: less than two images' noise, by 2 %
    assert (noisy.arrays["std"] > 30.0 * quiet.arrays["std"]).all()
    assert (np.abs(noisy.normalised_error) < 4.0).all()


def test_another_size_is_refused_in_the_same_folder(finished):
    store = StudyStore(finished[0])
    with pytest.raises(InputError, match="another experiment"), store.claim("study bulge full"):
        pass
