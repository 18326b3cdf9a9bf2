"""Files are data: nothing in an experiment folder or a RUN is run, unpickled, or leads out of the folder."""

from __future__ import annotations

import ast
import json
import os
import pickle
from pathlib import Path

import numpy as np
import pytest
import zarr
from PIL import Image
from quality.called import called
from quality.sources import modules

from idic.errors import InputError
from idic.path_names import path_inside
from idic.readers import existing_file, matching_files, open_stack, read_mesh_file
from idic.run import FrameArrays, read_array, write_array

ROOT = Path(__file__).parents[2]
SOURCES = [*modules().values(), *sorted((ROOT / "deploy").rglob("*.py"))]
STARTS_PROGRAMS = {  # each knows what it starts; the external solver: only with the user's leave, see docs/safety.md
    "idic/run/workers/prefect_server.py", "idic/fe/external/process.py", "idic/fe/external/guard.py",
    "idic/run/workers/precompiling.py",  # idic's own compiler
    "idic/run/reporting/second_process.py",  # idic itself, for figures
    "idic/draw/watch.py",  # idic itself, on a folder that the user has opened
    "deploy/slurm_cluster.py",
    "studies/trial/scenes/calculix.py", "studies/examples/scanned_bar.py",  # ccx on decks of our own
    "studies/equality/case_process.py",  # idic itself
    "studies/mutants/mutants.py",  # the tests of a copy of idic
    "studies/trial/seal.py"}  # git, for the commit that the tool is sealed at
OWN_PIPES = {"idic/run/reporting/second_process.py"}  # pickles between this process and its own child
FORBIDDEN = {"cloudpickle", "dill", "marshal", "shelve", "joblib", "pty", "code"}
BAD_CALLS = {"eval", "exec", "os.system", "os.popen", "np.load", "numpy.load", "yaml.load", "yaml.unsafe_load",
             "pickle.load", "pickle.loads", "pickle.Unpickler"}  # pickle.dumps harms nobody
PIPES = {"process.stdout", "sys.stdin.buffer"}
OFFENDERS = ["eval('1')", "np.load('a.npy')", "f(a, shell=True)", "np.savez(a, allow_pickle=True)", "pickle.loads(b)"]
LEAVING = ["../x", "a/../../x", "..", "/etc/passwd", "\\\\server\\x", "..\\x", "C:\\x", "C:/x", ""]


class Trap:
    """An object whose pickle leaves a mark where it is read."""

    def __init__(self, mark):
        self.mark = str(mark)

    def __reduce__(self):
        return os.mkdir, (self.mark,)


# the source -----------------------------------------------------------------------------------------
def test_no_module_unpickles_evaluates_or_starts_untrusted_content():
    wrong = {file.relative_to(ROOT).as_posix(): _offences(file) for file in SOURCES}
    assert {name: found for name, found in wrong.items() if found} == {}


def _offences(file):
    """What a source file holds that it must not."""
    name, wrong = file.relative_to(ROOT).as_posix(), []
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else [node.module or ""]
            wrong += [n for n in names if n.split(".")[0] in FORBIDDEN]
            wrong += ["from pickle"] if isinstance(node, ast.ImportFrom) and node.module == "pickle" else []
            wrong += [n for n in names if n == "subprocess" and name not in STARTS_PROGRAMS]
        elif isinstance(node, ast.Call):
            own = name in OWN_PIPES and called(node) == "pickle.load" and ast.unparse(node.args[0]) in PIPES
            wrong += [] if own else _bad_call(node)
    return wrong


def _bad_call(node):
    """What is called in this node that must not be."""
    name = called(node)
    shell = any(word.arg == "shell" for word in node.keywords)
    pickles = any(word.arg == "allow_pickle" and ast.unparse(word.value) != "False" for word in node.keywords)
    plain = name in ("np.load", "numpy.load") and any(
        word.arg == "allow_pickle" and ast.unparse(word.value) == "False" for word in node.keywords)
    bad = (name in BAD_CALLS and not plain) or name.startswith("os.exec")
    return [ast.unparse(node)] if bad or shell or pickles else []


@pytest.mark.parametrize("text", OFFENDERS)
def test_the_reader_of_the_source_finds_an_offender(text):
    assert _bad_call(ast.parse(text).body[0].value)


# stored arrays --------------------------------------------------------------------------------------
def test_an_array_of_pickled_objects_is_refused_before_it_is_read(tmp_path):
    mark = tmp_path / "mark"
    folder = tmp_path / "group" / "M"
    folder.mkdir(parents=True)
    (folder / ".zarray").write_text(json.dumps({
        "zarr_format": 2, "shape": [1], "chunks": [1], "dtype": "|O", "order": "C", "fill_value": None,
        "compressor": None, "filters": [{"id": "pickle", "protocol": 4}]}))
    trap = np.empty(1, dtype=object)
    trap[0] = Trap(mark)
    (folder / "0").write_bytes(pickle.dumps(trap))
    pickle.loads((folder / "0").read_bytes())
    assert mark.exists(), "the trap works"
    mark.rmdir()
    for read in (read_array, FrameArrays.open):
        with pytest.raises(InputError):
            read(tmp_path / "group", "M")
    assert not mark.exists()


@pytest.mark.parametrize("change", [
    {"codecs": [{"name": "bytes", "configuration": {"endian": "little"}},
                {"name": "gzip", "configuration": {"level": 1}}]},
    {"codecs": [{"name": "bytes"}, {"name": "numcodecs.pickle", "configuration": {}}]},
    {"data_type": "string", "fill_value": "", "codecs": [{"name": "vlen-utf8"}]}])
def test_a_codec_or_a_type_that_idic_does_not_write_is_refused(tmp_path, change):
    write_array(tmp_path, "M", np.eye(2))
    file = tmp_path / "M" / "zarr.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | change))
    with pytest.raises(InputError):
        read_array(tmp_path, "M")


def test_files_written_by_idic_are_read(tmp_path):
    for number, values in enumerate((np.eye(2), np.arange(3), np.array([True]), np.zeros((2, 0)), np.uint8([[1]]))):
        write_array(tmp_path, f"A{number}", values)
        assert np.array_equal(read_array(tmp_path, f"A{number}"), values)
    zarr.create_array(store=str(tmp_path / "z"), shape=(1,), dtype="f8")[...] = 1.0  # compressed: not ours
    with pytest.raises(InputError, match="not written by idic"):
        read_array(tmp_path, "z")


# images and meshes ----------------------------------------------------------------------------------
def test_a_file_that_is_only_called_png_does_not_reach_another_program(tmp_path):
    file = tmp_path / "a.png"
    Image.new("L", (8, 8)).save(tmp_path / "a.eps")  # Pillow hands EPS to Ghostscript
    file.write_bytes((tmp_path / "a.eps").read_bytes() + b"IEND")
    with pytest.raises(InputError):
        open_stack([file])


def test_a_mesh_does_not_pull_in_other_files(tmp_path):
    (tmp_path / "mesh.inp").write_text("*INCLUDE, INPUT=/etc/passwd\n")
    with pytest.raises(InputError, match="leaves the experiment folder"):
        read_mesh_file(tmp_path / "mesh.inp")


# paths ----------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", LEAVING)
def test_a_path_that_leaves_the_experiment_folder_is_refused(tmp_path, name):
    for read in (path_inside, existing_file):
        with pytest.raises(InputError, match="leaves the experiment folder"):
            read(tmp_path, name, file="experiment.toml", key="experiment.loads")
    with pytest.raises(InputError, match="leaves the experiment folder"):
        matching_files(tmp_path, [name], file="experiment.toml", key="experiment.images")


def test_a_link_that_the_user_has_laid_is_followed(tmp_path):
    """The documented way to data that lie elsewhere: who can lay a link can read the file anyway."""
    (tmp_path / "disk").mkdir()
    (tmp_path / "disk" / "a.tif").write_bytes(b"x")
    (tmp_path / "test").mkdir()
    (tmp_path / "test" / "images").symlink_to(tmp_path / "disk")
    found = matching_files(tmp_path / "test", ["images/*.tif"], file="f", key="k")
    assert [path.name for path in found] == ["a.tif"]
