"""The equality bench: this version gives the bits, words and counts that are recorded; the bench sees what changes."""

from __future__ import annotations

import copy
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from idic_studies.equality.case_process import record_cases
from idic_studies.equality.cases import CASES
from idic_studies.equality.comparison import compared, read_record
from idic_studies.equality.contents import array_record
from idic_studies.equality.counting import COUNTED, Counter, MissingPlace, existing

RECORDED = Path(__file__).parents[2] / "studies" / "equality" / "recorded"
FAST = [name for name, case in CASES.items() if case.fast]
SLOW = [name for name in CASES if name not in FAST]
MAX_RECORD_BYTES = 150_000  # of a committed record


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    """The folder of this version's records of the fast cases."""
    out, lines = tmp_path_factory.mktemp("records"), []
    assert record_cases(FAST, out, say=lines.append), "\n".join(lines)
    return out


@pytest.fixture(scope="module")
def record():
    """A committed record."""
    return read_record(RECORDED / "diagnosis_clean.json")


def changes(base, head):
    return [str(difference) for difference in compared(base, head).differences]


@pytest.mark.parametrize("name", FAST)
def test_this_version_equals_the_recorded_one(records, name):
    comparison = compared(read_record(RECORDED / f"{name}.json"), read_record(records / f"{name}.json"))
    assert comparison.equal, "\n".join(map(str, comparison.differences[:20]))


@pytest.mark.slow  # each takes up to two minutes
@pytest.mark.parametrize("name", SLOW)
def test_a_case_gives_the_same_record_twice(tmp_path, name):
    for folder in ("first", "second"):
        assert record_cases([name], tmp_path / folder)
    comparison = compared(*(read_record(tmp_path / folder / f"{name}.json") for folder in ("first", "second")))
    assert comparison.exact and comparison.equal, "\n".join(map(str, comparison.differences[:20]))


def test_the_committed_records_are_those_of_the_fast_cases_and_small():
    files = sorted(RECORDED.iterdir())
    assert [file.stem for file in files] == sorted(FAST)
    assert all(file.stat().st_size <= MAX_RECORD_BYTES for file in files)


def test_a_record_names_no_place_of_this_machine(records):
    for file in records.glob("*.json"):
        text = file.read_text(encoding="utf-8")
        for place in (sys.prefix, "idic-equality-", f"{Path.home()}/"):
            assert place not in text, (file.name, place)


# what a comparison sees --------------------------------------------------------------------------------------
def test_a_record_equals_itself(record):
    comparison = compared(record, copy.deepcopy(record))
    assert comparison.exact and comparison.equal


def test_the_last_bit_of_a_value_is_reported(record):
    head = copy.deepcopy(record)
    parameter = head["documents"]["run/result.json"]["parameters"]["BODY.E"]
    parameter["value"] = float(np.nextafter(parameter["value"], np.inf))
    (line,) = changes(record, head)
    assert line.startswith("run/result.json parameters BODY.E value: ")


def test_a_word_of_a_page_is_reported(record):
    head = copy.deepcopy(record)
    page = head["texts"]["run/diagnosis.html"]
    number = next(k for k, text in enumerate(page) if "residual" in text)
    page[number] = page[number].replace("residual", "remainder")
    removed, added = changes(record, head)
    assert removed.startswith("run/diagnosis.html: -") and "remainder" in added


def test_one_more_forward_run_is_reported(record):
    head = copy.deepcopy(record)
    counts = head["commands"][-1]["counts"]
    counts["forward_runs"] += 1
    assert changes(record, head) == [
        f"command 2 (diagnose run) forward_runs: {counts['forward_runs'] - 1} -> {counts['forward_runs']}"]


def test_a_bit_of_an_array_is_reported_with_its_size(record):
    base, head = copy.deepcopy(record), copy.deepcopy(record)
    arrays = [np.linspace(0.0, 1.0, 6).reshape(2, 3) for _ in range(2)]
    arrays[1][1, 0] += 0.25
    for content, array in zip((base, head), arrays, strict=True):
        content["arrays"] = {"u": array_record(array)}
    assert changes(base, head)[0].startswith("u: other bits; rms ")
    (difference,) = compared(base, head, {"u": arrays[0]}, {"u": arrays[1]}).differences
    assert str(difference) == "u: largest difference 0.25 at [1, 0], of 1"


@pytest.mark.parametrize("part", ["documents", "texts", "arrays", "inputs"])
def test_what_is_gone_is_reported(record, part):
    head = copy.deepcopy(record)
    name = next(iter(head[part]))
    del head[part][name]
    assert changes(record, head) == [f"{part}: {name} is gone"]


def test_a_lost_file_and_another_exit_code_are_reported(record):
    head = copy.deepcopy(record)
    head["files"].pop(0)
    head["commands"][1]["exit_code"] = 3
    assert changes(record, head) == ["command 1 (identify test): exit code 0 -> 3",
                                     f"files: {record['files'][0]} is gone"]


# another machine ---------------------------------------------------------------------------------------------
@pytest.fixture
def foreign(record):
    """The same record of another processor."""
    head = copy.deepcopy(record)
    head["fingerprint"]["processor"] = "another one"
    return head


def test_between_machines_rounding_is_no_difference(record, foreign):
    parameter = foreign["documents"]["run/result.json"]["parameters"]["BODY.E"]
    parameter["value"] *= 1.0 + 1e-8
    parameter["std"] *= 1.0 + 1e-5
    for content in foreign["arrays"].values():
        content["sha256"] = "another one"
    foreign["texts"]["run/diagnosis.html"] = [text.replace("1", "2") for text in foreign["texts"]["run/diagnosis.html"]]
    comparison = compared(record, foreign)
    assert not comparison.exact and comparison.equal, comparison.differences[:5]


def test_between_machines_a_value_a_word_and_a_count_are_reported(record, foreign):
    foreign["documents"]["run/result.json"]["parameters"]["BODY.E"]["value"] *= 1.0 + 1e-5
    foreign["texts"]["run/diagnosis.html"][0] += " or so"
    foreign["commands"][1]["counts"]["image_passes"] += 1
    assert len(changes(record, foreign)) == 4  # a changed line counts twice
    name = next(name for name, content in foreign["arrays"].items() if content.get("rms", 0.0) > 1.0)
    foreign["arrays"][name]["rms"] *= 1.01
    assert len(changes(record, foreign)) == 5


# counts ------------------------------------------------------------------------------------------------------
def test_every_counted_function_exists():
    for name, places in COUNTED.items():
        assert callable(existing(name, places)[2])


def test_a_function_is_counted_wherever_it_was_imported(tmp_path):
    (tmp_path / "counted_home.py").write_text("def work(x):\n    return x + 1\n")
    (tmp_path / "counted_guest.py").write_text("from counted_home import work as effort\n")
    code = ("import counted_guest, counted_home\n"
            "from idic_studies.equality.counting import Counter\n"
            "counter = Counter({'work': ('gone:work', 'counted_home:gone', 'counted_home:work')})\n"
            "assert counted_guest.effort(1) + counted_home.work(2) == 5\n"
            "print(counter.numbers)\n"
            "counter.kill_at('work', 2)\n"
            "print(counted_home.work(0), flush=True)\n"
            "counted_home.work(0)\n")
    answer = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert answer.stdout.splitlines() == ["{'work': 2}", "1"], answer.stderr
    assert answer.returncode == -9


def test_a_function_that_has_moved_is_asked_for():
    with pytest.raises(MissingPlace, match="write its new place"):
        Counter({"work": ("idic.nowhere:work", "idic.cli:nothing")})


# the commands ------------------------------------------------------------------------------------------------
def test_the_command_compares_folders_and_says_so_by_its_exit_code(record, tmp_path):
    head = copy.deepcopy(record)
    head["documents"]["run/diagnosis.json"]["verdict"] = "single"
    for folder, content in (("base", record), ("same", record), ("head", head)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "diagnosis_clean.json").write_text(json.dumps(content))

    def compare(*folders):
        return subprocess.run([sys.executable, "-m", "idic_studies.equality", "compare", *folders], cwd=tmp_path,
                              capture_output=True, text=True, check=False)

    equal, different, empty = compare("base", "same"), compare("base", "head"), compare("base", "none")
    assert equal.returncode == 0 and equal.stdout.split() == ["diagnosis_clean", "equal"]
    assert different.returncode == 1 and "verdict: 'none' -> 'single'" in different.stdout
    assert empty.returncode == 1 and "no record" in empty.stdout
