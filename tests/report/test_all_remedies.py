"""No remedy names a key that the experiment cannot have: every remedy of the product, over every kind of experiment."""

from __future__ import annotations

import ast
import json
import re
import tomllib
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import tifffile
from report.experiment_kinds import KINDS

import idic
from idic.experiment_file import load_experiment
from idic.model import Remedies

PACKAGE = Path(idic.__file__).parent
ROOMS_THAT_ADVISE = ("measure", "identification", "diagnose", "report", "run")
POSE = [[1, 0, 0], [0, -1, 0], [0, 0, -1]]
VALUES = {  # key -> table, value; "camera": of the camera whose view it is
    "mask": ("experiment", "mask.tif"), "still_frames": ("experiment", [0, 1]), "exclude_frames": ("experiment", [2]),
    "image_times": ("experiment", "times.csv"), "frame_interval_s": ("experiment", 1.0),
    "fields_noise_um": ("experiment", 1.0), "mesh_unit": ("experiment", "mm"),
    "roi_px": ("experiment.mesh", [11, 10, 49, 40]),
    "outline_px": ("experiment.mesh", [[10, 10], [50, 10], [50, 40]]),
    "holes_px": ("experiment.mesh", [[30.0, 25.0, 8.0]]),
    "holes_mm": ("experiment.mesh", [[2.0, 1.5, 0.9]]),
    "pixel_size_mm": ("camera", 0.1), "matrix_px_per_unit": ("camera", [[10.0, 0.0], [0.0, -10.0]]),
    "origin_px": ("camera", [11.0, 40.0]), "origin_mm": ("camera", [0.0, 0.0]),
    "noise_std_gv": ("camera", 1.0), "voxel_mm": ("camera", 0.02), "calibration": ("camera", "cal.json"),
    "identify_calibration": ("camera", True), "translation_mm": ("camera", [-2.0, 1.5, 301.0]),
    "alignment": ("camera", {"points_mm": [[0, 0], [4, 0], [4, 3], [0, 3]],
                             "points_px": [[10, 40], [50, 40], [50, 10], [10, 10]]}),
    "noise_std": ("channel.0", 0.1), "lowpass_px": ("options", 1.0), "element_order": ("options", "as_given"),
    "axes": ("camera", None), "time_modes": ("boundary", None)}
DECIDED_ELSEWHERE = {  # file: what decides there
    "words.py": "the quantity that was measured, by result.json",
    "remedies.py": "settings that were tried on the images",
    "repeats.py": "`exclusion`, of the experiment", "outline.py": "the mesh is the outline of points",
    "caution_texts.py": "the mesh is the outline of points", "chain.py": "the mesh is the outline of points",
    "free_model.py": "a motion that the images may give in the place of a column"}
REFUSALS = {"InputError", "refuse"}  # of a key that the file has already
NOT_REMEDIES = {  # sentences that name a key which the experiment has, or an option that was tried on it
    "edge_margin_px": "the margin that was taken", "max_iterations": "every experiment has this limit",
    "step_limit": "every experiment has this limit", "estimator": "every experiment has an estimator"}


@pytest.fixture(scope="module", params=KINDS)
def kind(request, tmp_path_factory):
    """The folder of a kind and its experiment."""
    folder = KINDS[request.param](tmp_path_factory.mktemp("kinds") / request.param)
    experiment = load_experiment(folder)
    shape = experiment.recording.image_shape
    tifffile.imwrite(folder / "mask.tif", np.full(shape, 255, np.uint8))
    (folder / "times.csv").write_text("time_s\n" + "".join(f"{t}\n" for t in experiment.model.times))
    return folder, experiment


def trees(pattern, rooms=(".",)):
    """Files of the product in which the pattern occurs, and their syntax; rooms : only of these."""
    for file in sorted(file for room in rooms for file in (PACKAGE / room).rglob("*.py")):
        text = file.read_text(encoding="utf-8")
        if pattern.search(text):
            yield file, ast.parse(text)


def text_of(node):
    """A string, the values of an f-string left out; None of anything else."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(part.value if isinstance(part, ast.Constant) else "…" for part in node.values)
    return None


def calls(tree, names):
    return [node for node in ast.walk(tree) if isinstance(node, ast.Call)
            and getattr(node.func, "id", getattr(node.func, "attr", "")) in names]


@cache
def remedies():
    """Every text that the product gives to `possible`."""
    return sorted({text for _, tree in trees(re.compile(r"\bpossible\(")) for call in calls(tree, {"possible"})
                   for text in map(text_of, call.args) if text is not None})


def camera_table(folder, number):
    raw = tomllib.loads((folder / "experiment.toml").read_text())
    if "scanner" in raw:
        return "scanner"
    return f"camera.{number}" if isinstance(raw.get("camera"), list) else "camera"


def edits_with(folder, experiment, key, number):
    """The file with this key, as overrides."""
    table, value = VALUES[key]
    if table == "camera":
        table = camera_table(folder, number)
    if key == "axes":
        names = {"volume": ["+col", "+row", "+slice"], "displacement": ["+x", "+y"]}
        value = names.get(experiment.recording.quantity, ["+col", "-row"])
    if key == "voxel_mm":
        value = float(experiment.model.camera.voxel_mm[0])
    if key == "exclude_frames":
        value = json.loads(Remedies(experiment).exclusion([2]))
    if key == "holes_mm" and experiment.recording.points is not None:
        value = [[10.0, 0.0, 2.5]]
    if key == "origin_px" and experiment.recording.quantity == "volume":
        value = [10.0, 9.0, 7.0]
    if key == "time_modes":
        return {f"boundary.{i}.{c}": {"virtual": "bspline", "modes": 2, "time_modes": 2}
                for i, c in driven(folder)}
    edits = {f"{table}.{key}": value}
    if key == "translation_mm":
        edits[f"{table}.rotation"] = POSE
    return edits



def driven(folder):
    """Entries of [[boundary]] and their components that follow a column."""
    raw = tomllib.loads((folder / "experiment.toml").read_text())
    return [(i, name) for i, table in enumerate(raw["boundary"]) for name, value in table.items()
            if isinstance(value, dict) and "column" in value]


def test_every_remedy_that_is_told_can_be_written(kind):
    folder, experiment = kind
    assert len(remedies()) > 15  # else the walk has lost them
    for number, view in enumerate(experiment.views):
        for key in sorted({key for remedy in remedies() if Remedies(view).possible(remedy)
                           for key in Remedies.keys_in(remedy)}):
            if key == "still_frames" and number:
                continue  # a further camera has a pattern of files
            load_experiment(folder, edits_with(folder, view, key, number))


def test_the_motion_of_an_end_may_come_from_the_measurement(kind):
    """What `free_model` of the diagnosis proposes in the place of a column."""
    folder, experiment = kind
    if Remedies(experiment).can_have("time_modes"):
        load_experiment(folder, edits_with(folder, experiment, "time_modes", 0))


def test_scale_and_place_are_named_by_keys_of_this_camera(kind):
    _, experiment = kind
    for view in experiment.views:
        possible = Remedies(view)
        for words in (possible.scale, possible.place):
            assert words and all(possible.can_have(key) for key in possible.keys_in(words))


def test_a_log_is_matched_by_times_that_it_can_have(kind):
    folder, experiment = kind
    if "experiment.loads" not in experiment.written:
        assert Remedies(experiment).times_of_images == ""
    for key in Remedies.keys_in(Remedies(experiment).times_of_images):
        load_experiment(folder, edits_with(folder, experiment, key, 0))


def test_every_key_that_only_some_can_have_is_tried():
    words = " ".join([*remedies(), *schema_keys(), "mask axes calibration alignment"])
    of_other_tables = {"noise_std", "time_modes"}  # [[channel]], [[boundary]]
    assert set(Remedies.keys_in(words)) | of_other_tables == set(VALUES)


def schema_keys():
    """Keys of [experiment], [camera], [scanner] and [options] whose names are no common words."""
    from idic.experiment_file import ExperimentFile
    tables = [ExperimentFile.model_fields[name].annotation for name in ("experiment", "camera", "scanner", "options")]
    models = [getattr(table, "__args__", (table,))[0] for table in tables]
    return {key for model in models for key in model.model_fields if "_" in key}


def test_no_sentence_names_a_key_past_the_one_place_that_decides():
    """Advice outside of `possible` is for every kind: it names no key that only some can have."""
    pattern = re.compile(rf"(?<![\w.])({'|'.join(schema_keys())})(?!\w)")
    past = []
    for file, tree in trees(pattern, ROOMS_THAT_ADVISE):
        if "design" in file.stem or "plan" in str(file):
            continue
        inside = {id(node) for call in calls(tree, {"possible", *REFUSALS}) for node in ast.walk(call)}
        inside |= {id(node.body[0].value) for node in ast.walk(tree)
                   if isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef)
                   and isinstance(node.body[0], ast.Expr)}
        inside |= {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
        for node in ast.walk(tree):
            text = text_of(node)
            if text is not None and id(node) not in inside and " " in text.strip():
                past += [(file.name, key, text) for key in pattern.findall(text) if key not in NOT_REMEDIES]
    assert not [entry for entry in past if entry[0] not in DECIDED_ELSEWHERE], past
