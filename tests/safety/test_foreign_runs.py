"""What a stranger put into a RUN or a file of data leads nowhere: each promise of docs/safety.md with a link, a pipe
and a name."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import socket

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

from idic.cli.app import app
from idic.errors import InputError
from idic.run import folders_of, open_run, read_result
from idic.readers import FieldSeries, read_mesh_file

SECRET = "what lies outside"
COMMANDS = {"report": ["report", "{run}"], "clean": ["clean", "{run}"],
            "resume": ["identify", "{test}", "--out", "{run}", "--resume", "--no-prefect", "--workers", "0",
                       "--no-report", "--set", "options.max_iterations=1"],
            "diagnose": ["diagnose", "{run}", "--no-prefect", "--workers", "0"],
            "compare": ["compare", "{run}", "{run}", "--out", "{out}"]}
PLACES = {"report": ("report.html", "tables", "figures", "run.lock", "result.json", "run.json", "run.zarr/prepared"),
          "clean": ("run.lock",),  # another link is deleted, see tests/store/test_clean.py
          "resume": ("log.txt", "run.lock", "state.json", "run.json", "joint.json", "run.zarr/evaluations",
                     "run.zarr/zarr.json", "run.zarr"),
          "diagnose": ("diagnosis", "diagnosis.json", "run.lock", "run.json"),
          "compare": ("result.json", "joint.json")}
CASES = [(command, place) for command, places in PLACES.items() for place in places]


@pytest.fixture
def copied(gallery, tmp_path):
    """A RUN of its own, beside a file and a folder that are none of its business."""
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "secret.txt").write_text(SECRET)
    finished = gallery("step").copied(tmp_path)
    return finished, tmp_path / "outside"


def _refused(command, finished, out):
    """The command ends with exit code 2 and one message."""
    words = [word.format(run=finished.run, test=finished.experiment, out=out) for word in COMMANDS[command]]
    answer = CliRunner().invoke(app, words)
    assert answer.exit_code == 2, (answer.output, answer.exception)
    assert "what to do" in answer.output and "internal error" not in answer.output
    return answer.output


def _put(place, make):
    """Something else in the place of a file or folder of the RUN."""
    if place.is_dir():
        shutil.rmtree(place)
    else:
        place.unlink(missing_ok=True)
    make(place)


@pytest.mark.parametrize(("command", "place"), CASES)
def test_a_link_in_a_run_is_followed_by_no_command(copied, tmp_path, command, place):
    finished, outside = copied
    is_folder = "." not in place.rpartition("/")[2]
    _put(finished.run / place, lambda path: path.symlink_to(outside if is_folder else outside / "secret.txt"))
    assert "a symbolic link" in _refused(command, finished, tmp_path / "out")
    assert (outside / "secret.txt").read_text() == SECRET and len(list(outside.iterdir())) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("command", "place"), [
    ("report", "result.json"), ("report", "run.json"), ("report", "run.zarr/zarr.json"), ("clean", "run.lock"),
    ("report", "run.zarr/prepared/zarr.json"), ("resume", "state.json"), ("resume", "log.txt"),
    ("resume", "run.zarr/zarr.json"), ("compare", "result.json")])
def test_no_command_waits_for_a_pipe_in_a_run(copied, tmp_path, command, place):
    finished, _ = copied
    _put(finished.run / place, os.mkfifo)
    assert "a pipe" in _refused(command, finished, tmp_path / "out")


def _write_names(run, names):
    """A joint.json of several experiments with a right checksum."""
    state = {"names": names}
    digest = hashlib.sha256(json.dumps(state, sort_keys=True).encode()).hexdigest()
    (run / "joint.json").write_text(json.dumps({"schema": "idic.joint/1", "sha256": digest, "state": state}))


@pytest.mark.parametrize("names", [["../../other", "a"], ["/tmp/other", "a"], ["a", "a"], ["a"], [1, 2], [".", ".."]])
def test_names_of_experiments_lead_to_no_other_run(tmp_path, names):
    _write_names(tmp_path, names)
    with pytest.raises(InputError, match="does not hold what idic writes"):
        folders_of(tmp_path)


def test_an_experiment_of_several_is_no_link(tmp_path, copied):
    finished, outside = copied
    run = tmp_path / "joint"
    (run / "experiments" / "a").mkdir(parents=True)
    (run / "experiments" / "b").symlink_to(finished.run)
    _write_names(run, ["a", "b"])
    with pytest.raises(InputError, match="a symbolic link"):
        folders_of(run)
    assert read_result(finished.run)


def test_a_run_below_the_data_of_a_worker_names_no_experiment_outside(copied, tmp_path, monkeypatch):
    finished, outside = copied
    monkeypatch.setenv("IDIC_DATA_ROOT", str(finished.run))
    with pytest.raises(InputError, match="outside of the data of this worker"):
        open_run(str(finished.run))
    monkeypatch.setenv("IDIC_DATA_ROOT", "/")
    assert open_run(str(finished.run)).experiment


@pytest.mark.parametrize("value", ["NaN", "-Infinity", "[" * 5000 + "]" * 5000])
@pytest.mark.parametrize(("name", "command"), [("run.json", "report"), ("state.json", "resume")])
def test_a_number_that_is_none_is_refused(copied, tmp_path, name, command, value):
    finished, _ = copied
    file = finished.run / name
    document = json.loads(file.read_text())
    document["state"]["more"] = 0
    file.write_text(json.dumps(document).replace('"more": 0', f'"more": {value}'))
    (finished.run / name.replace(".", ".copy.")).unlink(missing_ok=True)
    assert "the checkpoint cannot be used" in _refused(command, finished, tmp_path / "out")


def test_a_run_names_no_other_file_as_its_experiment(copied, tmp_path):
    """Found by the campaign: the file was read, and its first line stood in the message."""
    finished, outside = copied
    file = finished.run / "run.json"
    document = json.loads(file.read_text())
    document["state"]["experiment"] = str(outside / "secret.txt")
    digest = hashlib.sha256(json.dumps(document["state"], sort_keys=True).encode()).hexdigest()
    file.write_text(json.dumps(document | {"sha256": digest}))
    said = _refused("report", finished, tmp_path / "out")
    assert "not an experiment file" in said and SECRET not in said


@pytest.mark.parametrize(("change", "words"), [
    ({"discrepancy": {"significant": True, "likelihood_ratio": 9.0, "std": {}, "motion_px": {}}}, "without its size"),
    ({"cracks": {"edge": {"frames": [0, 1], "why_not": ""} | dict.fromkeys(
        ("length_mm", "length_mm_std", "K_I", "K_II", "J", "K_I_std", "K_II_std", "J_std"), [1.0])}},
     "not one value per frame"),
    ({"discrepancy": {"significant": True, "likelihood_ratio": None, "motion_px": {"a": 0.1}}}, "without its size"),
    ({"discrepancy": {"significant": True, "likelihood_ratio": 9.0, "std": {"motion": None}, "motion_px": {"a": 0.1}}},
     "without its size"),
    ({"title": "\ud800"}, "half of a surrogate pair")])
def test_a_result_that_no_page_can_show_is_refused(copied, tmp_path, change, words):
    """Found by the campaign."""
    finished, _ = copied
    content = json.loads((finished.run / "result.json").read_text()) | change
    del content["sha256"]
    digest = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    (finished.run / "result.json").write_text(json.dumps(content | {"sha256": digest}))
    assert words in _refused("report", finished, tmp_path / "out")


@pytest.mark.parametrize(("command", "label", "ident"), [
    ("report", "system", {}), ("report", "system", {"generalised": False, "predicts": "no", "increments": 0}),
    ("resume", "discrepancy", {"reason": [1]}), ("resume", "discrepancy", {"reason": "", "motion_px": {"a": "b"}})])
def test_attributes_of_a_group_that_are_of_other_types_are_refused(copied, tmp_path, command, label, ident):
    """Found by the campaign."""
    finished, _ = copied
    if command == "resume":
        (finished.run / "result.json").unlink()
    number = json.loads((finished.run / "state.json").read_text())["state"]["accepted"]["number"]
    file = finished.run / "run.zarr" / "evaluations" / f"{number:03d}" / label / "zarr.json"
    content = json.loads(file.read_text())
    content["attributes"]["ident"] = ident
    file.write_text(json.dumps(content))
    assert "does not hold what idic writes" in _refused(command, finished, tmp_path / "out")


@pytest.mark.parametrize("content", ["[" * 200_000, "[]", '{"pid": [1]}', json.dumps({
    "host": socket.gethostname(), "pid": os.getpid(), "process_started": "now"})],
    ids=["nested", "list", "pids", "a time in words"])
def test_a_lock_that_says_nothing_stops_no_command(copied, content):
    finished, _ = copied
    (finished.run / "run.lock").write_text(content)
    answer = CliRunner().invoke(app, ["clean", str(finished.run)])
    assert answer.exit_code == 0, (answer.output, answer.exception)


@pytest.mark.parametrize("content", [
    "[" * 200_000, "[]", '{"refits": 1}', '{"refits": [{"name": [], "edits": "", "values": {}}]}', '{"set": 3}',
    '{"refits": [{"name": "a", "edits": "", "values": {"E": "x"}}]}', '{"indistinguishable": [4]}',
    '{"refits": [{"name": "a", "edits": "", "values": {"E": 1e400}}]}', '{"named": null}',
    '{"refits": [{"name": "a", "edits": "=", "values": {}}]}'])
def test_a_diagnosis_of_other_types_is_refused(copied, tmp_path, content):
    finished, _ = copied
    (finished.run / "diagnosis.json").write_text(content)
    answer = CliRunner().invoke(app, ["design", str(finished.experiment), "--separate", str(finished.run), "--out",
                                      str(tmp_path / "out")])
    assert answer.exit_code == 2, (answer.output, answer.exception)
    assert "diagnosis.json" in answer.output and not (tmp_path / "out").exists()


# files of data ----------------------------------------------------------------------------------------
def _linked(path, outside):
    with h5py.File(outside / "other.h5", "w") as file:
        file["x"] = np.arange(3.0)
    with h5py.File(path, "w") as file:
        file["data_dic_save"] = h5py.ExternalLink(str(outside / "other.h5"), "/x")


def _stored(path, outside):
    with h5py.File(path, "w") as file:
        file.create_dataset("data_dic_save/x", shape=(4,), dtype="u1", external=[(str(outside / "secret.txt"), 0, 4)])


def _virtual(path, outside):
    layout = h5py.VirtualLayout(shape=(3,), dtype="f8")
    layout[:] = h5py.VirtualSource(str(outside / "other.h5"), "x", shape=(3,))
    with h5py.File(path, "w") as file:
        file.create_virtual_dataset("data_dic_save", layout)


@pytest.mark.parametrize("make", [_linked, _stored, _virtual])
@pytest.mark.parametrize("suffix", [".mat", ".med", ".cgns"])
def test_hdf5_takes_no_data_from_another_file(tmp_path, make, suffix):
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "secret.txt").write_text(SECRET)
    path = tmp_path / f"file{suffix}"
    make(path, tmp_path / "outside")
    read = (lambda: FieldSeries.open([path])) if suffix == ".mat" else (lambda: read_mesh_file(path))
    with pytest.raises(InputError, match="takes data from another file"):
        read()


@pytest.mark.parametrize("name", ["../outside/other.h5", "/tmp/other.h5", "linked.h5"])
def test_xdmf_names_no_file_elsewhere(tmp_path, name):
    (tmp_path / "linked.h5").symlink_to(tmp_path / "elsewhere.h5")
    (tmp_path / "part.xdmf").write_text(
        '<Xdmf Version="3.0"><Domain><Grid><Geometry GeometryType="XYZ"><DataItem DataType="Float" Dimensions="4 3" '
        f'Format="HDF" Precision="8">{name}:/x</DataItem></Geometry></Grid></Domain></Xdmf>')
    with pytest.raises(InputError, match=r"another file|leads out"):
        read_mesh_file(tmp_path / "part.xdmf")
