"""A flipped bit and a missing chunk in every array of a RUN, in its descriptions: computed anew or said, never used.

Runs of two cameras, of virtual boundaries and of measured edges keep arrays of their own, so they are damaged too.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from fault_runs import command_line, finish, outcome, stored_system

import idic
from idic.errors import InputError
from idic.identification.step.state import ParallelTrial
from idic.run.recovery.recover import recover
from idic.run.store.arrays import Damaged
from idic.run import FrameArrays, RunStore, SerialRunner, read_array
from idic.run.store.state_file import load_state, save_state

SHARE = float(
    os.environ.get("IDIC_DAMAGE_SHARE", "0.01")
)  # of the arrays in the default tests; all of them with -m slow


def flip(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 4
    file.write_bytes(content)


def cut(file: Path) -> None:
    os.truncate(file, file.stat().st_size // 2)


DAMAGE = {"flipped": flip, "missing": Path.unlink, "cut": cut, "empty": lambda file: os.truncate(file, 0)}


def chunks(run: Path) -> list[Path]:
    """The middle chunk of every array."""
    found = []
    for description in sorted((run / "run.zarr").rglob("zarr.json")):
        if json.loads(description.read_text())["node_type"] == "array":
            files = (
                sorted(file for file in (description.parent / "c").rglob("*") if file.is_file())
                if (description.parent / "c").is_dir()
                else [description.parent / "c"]
            )
            found += files[len(files) // 2 :][:1]
    return [file for file in found if file.is_file()]


def two_cameras(folder: Path) -> Path:
    """The strip seen by a second camera: the same images, calibrated as the first."""
    shutil.copytree(folder / "images", folder / "again")
    file = folder / "experiment.toml"
    text = file.read_text()
    camera = text[text.index("[camera]") : text.index("[material.sheet]")]
    more = camera.replace("[camera]", '[[camera]]\nname = "second"\nimages = "again/*.tif"')
    file.write_text(text.replace(camera, camera.replace("[camera]", '[[camera]]\nname = "first"') + more))
    return folder


def virtual_boundaries(folder: Path, motion: str = '{ virtual = "dic", modes = 2, time_modes = 3 }') -> Path:
    """The right grip's motion unknown: three modes in space and in time."""
    file = folder / "experiment.toml"
    text = file.read_text()
    start = text.index('nodes = "RIGHT"')
    end = text.index("[[channel]]")
    drive = f'nodes = "RIGHT"\nu = {motion}\n\n'
    file.write_text(text[:start] + drive + text[end:].replace("[options]", "[options]\nmax_iterations = 4"))
    return folder


def measured_edges(folder: Path) -> Path:
    """The same with every node of the grip free in every frame."""
    return virtual_boundaries(folder, '"measured"')


CHANGES = {"two cameras": two_cameras, "virtual boundaries": virtual_boundaries, "measured edges": measured_edges}


@pytest.fixture(scope="module")
def kinds(small, tmp_path_factory):
    """A function: the finished run of a kind of experiment, made once."""

    @lru_cache
    def of(kind: str) -> SimpleNamespace:
        if kind == "one camera":
            return small
        folder = tmp_path_factory.mktemp("kind")
        shutil.copytree(small.experiment, folder / "experiment")
        CHANGES[kind](folder / "experiment")
        idic.identify(folder / "experiment", folder / "run")
        return SimpleNamespace(
            experiment=folder / "experiment",
            run=folder / "run",
            result=outcome(folder / "run"),
            system=stored_system(folder / "run"),
        )

    return of


def damaged_run(whole, tmp_path, number: int, damage: str, finished: bool) -> Path:
    run = tmp_path / "run"
    shutil.rmtree(run, ignore_errors=True)
    shutil.copytree(whole.run, run)
    if not finished:
        (run / "result.json").unlink()
    DAMAGE[damage](chunks(run)[number])
    return run


def assert_computed_anew(whole, run: Path) -> None:
    result = idic.identify(whole.experiment, run, resume=True)
    assert result["status"] == whole.result["status"]
    assert outcome(run) == whole.result
    assert stored_system(run) == whole.system
    assert unreadable(run) == []


def unreadable(run: Path) -> list[str]:
    """Arrays with a chunk that is missing or does not fit its checksum."""
    found = []
    for description in sorted((run / "run.zarr").rglob("zarr.json")):
        if json.loads(description.read_text())["node_type"] == "array":
            array = description.parent
            try:
                stored = FrameArrays.open(array.parent, array.name)
                if stored.missing():
                    raise Damaged("missing", file=array)
                read_array(array.parent, array.name)
            except Damaged as damage:
                found.append(f"{array.relative_to(run)}: {damage.found}")
    return found


@pytest.mark.parametrize("kind", ["one camera", pytest.param("two cameras", marks=pytest.mark.slow)])
def test_damaged_channels_are_computed_anew(kinds, tmp_path, kind):
    """They come into being at the end of a run and are read for its report alone."""
    whole, run = kinds(kind), tmp_path / "run"
    channels = run / "run.zarr" / "channels"
    shutil.copytree(whole.run, run, dirs_exist_ok=True)
    flip(next(file for file in sorted((channels / "simulated" / "c").rglob("*")) if file.is_file()))
    assert len(unreadable(run)) == 1
    assert_computed_anew(whole, run)
    shutil.rmtree(channels)
    assert_computed_anew(whole, run)
    assert channels.exists()


@pytest.mark.parametrize("which", [0, 1])
def test_a_damaged_simulation_of_a_parallel_trial_is_computed_anew(small, tmp_path, which):
    """With trial_steps = 2; `which` of the two trials is damaged."""
    run = tmp_path / "run"
    shutil.copytree(small.run, run)
    store, state = RunStore(run), load_state(run)
    values, number = dict(state.accepted.values), state.evaluations + which
    state = replace(state, status="running", end=None,
                    trial=replace(state.trial, values=values, parallel=(ParallelTrial(values, 0.1, 1),)))
    save_state(run, state)
    for evaluation in (state.evaluations, state.evaluations + 1):
        for label in ("start", "base"):
            store.repeat(f"evaluations/{evaluation:03d}/{label}", {},
                         store.group(f"evaluations/{state.accepted.number:03d}/{label}"))
    base = f"evaluations/{number:03d}/base"
    flip(next(file for file in sorted((store.path / base / "u" / "c").rglob("*")) if file.is_file()))
    with store.claim(store.identity()):
        found = recover(store, small.experiment, SerialRunner())
    assert found == [f"{base} is damaged: it is computed again"] and store.finished(base) is None
    store.remove(f"evaluations/{number:03d}/start")
    with store.claim(store.identity()):
        found = recover(store, small.experiment, SerialRunner())
    assert len(found) == 1 and "starts over" in found[0], "where a trial starts does not follow from the state"


def cases(whole, share: float) -> list[tuple[int, str, bool]]:
    """(array, damage, whether the run had ended): the first two damages for every array, all of them in turn."""
    arrays, kinds = len(chunks(whole.run)), list(DAMAGE)
    every = [
        (k, damage, (k + j) % 2 == 0) for k in range(arrays) for j, damage in enumerate(kinds[:2] + [kinds[2 + k % 2]])
    ]
    keep = np.random.default_rng(4).permutation(len(every))[: max(2, int(share * len(every)))]
    return [every[k] for k in sorted(keep)]


@pytest.mark.slow  # two runs; test_resume.py damages two arrays
def test_damage_to_some_arrays_is_computed_anew(kinds, tmp_path):
    whole = kinds("one camera")
    assert len(chunks(whole.run)) > 20
    for number, damage, finished in cases(whole, SHARE):
        assert_computed_anew(whole, damaged_run(whole, tmp_path, number, damage, finished))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["one camera", *CHANGES])
def test_damage_to_every_array_is_computed_anew(kinds, tmp_path, kind):
    whole = kinds(kind)
    if kind == "two cameras":
        assert any("cameras" in str(file) for file in chunks(whole.run))
    if kind == "virtual boundaries":
        assert any("shapes" in str(file) for file in chunks(whole.run))
    for number, damage, finished in cases(whole, 1.0):
        assert_computed_anew(whole, damaged_run(whole, tmp_path, number, damage, finished))


@pytest.mark.slow
@pytest.mark.parametrize("kind", CHANGES)
@pytest.mark.parametrize("seed", range(3))
def test_other_kinds_of_runs_go_on_after_kills(kinds, tmp_path, kind, seed):
    from test_kills import campaign

    whole = kinds(kind)
    campaign(whole, tmp_path, seed, kills=3, ways=("plain", "workers"))


def spoilt_text(text: str, generator) -> str:
    """One character of a description changed to another of its kind, or a piece cut off."""
    k = int(generator.integers(len(text)))
    if generator.integers(4) == 0:
        return text[:k]
    pool = "0123456789" if text[k].isdigit() else 'abcdef,:}]"' if text[k] != "\n" else " "
    return text[:k] + pool[int(generator.integers(len(pool)))] + text[k + 1 :]


@pytest.mark.parametrize("seed", [pytest.param(k, marks=pytest.mark.slow) if k else k for k in range(40)])
def test_spoilt_descriptions_are_computed_anew_or_reported(kinds, tmp_path, seed):
    """zarr.json of arrays and groups, state.json, run.json, result.json."""
    whole, generator = kinds("one camera"), np.random.default_rng(seed)
    run = tmp_path / "run"
    shutil.copytree(whole.run, run)
    files = sorted(file for file in run.rglob("*.json"))
    file = files[int(generator.integers(len(files)))]
    file.write_text(spoilt_text(file.read_text(), generator))
    try:
        idic.identify(whole.experiment, run, resume=True)
    except InputError as problem:
        assert problem.what and problem.remedy, file
        return
    final = outcome(run)
    assert final["parameters"] == whole.result["parameters"] and final["status"] == whole.result["status"], file


# the disk ------------------------------------------------------------------------------------------------------
LIMITED = """
import resource, signal, sys
if __name__ == "__main__":
    import typer
    import idic
    from idic.cli.outcomes import outcome
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[3]), int(sys.argv[3])))
    try:
        with outcome():
            idic.identify(sys.argv[1], sys.argv[2], resume=True)
    except typer.Exit as end:
        sys.exit(end.exit_code)
"""


def limited(experiment: Path, folder: Path, run: Path, size: int) -> subprocess.CompletedProcess:
    """A run in another process that ends as the command does; `size` in bytes limits every file.

    It writes no compiled modules: CPython 3.11 leaves one that was cut off at the limit, and no later process can
    import it (https://github.com/python/cpython/issues/126606).
    """
    script = folder / "limited.py"
    script.write_text(LIMITED)
    return subprocess.run([sys.executable, str(script), str(experiment), str(run), str(size)], capture_output=True,
                          text=True, timeout=600, env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"})


def test_files_that_may_not_grow_end_a_run_with_a_message_and_resume_goes_on(small, tmp_path):
    """RLIMIT_FSIZE: every file above 20 kB fails to be written, as over a quota."""
    answer = limited(small.experiment, tmp_path, tmp_path / "run", 20_000)
    assert answer.returncode == 2, answer.stderr
    assert "File too large" in answer.stderr and "what to do" in answer.stderr and "Traceback" not in answer.stderr
    assert idic.identify(small.experiment, tmp_path / "run", resume=True)["status"] == "converged"
    assert outcome(tmp_path / "run") == small.result


@pytest.mark.slow  # two commands; files that may not grow: above
@pytest.mark.skipif(os.name != "posix" or os.geteuid() != 0, reason="mounts a small file system")
def test_a_full_disk_ends_a_run_with_a_message_and_resume_goes_on(small, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", disk], capture_output=True).returncode:
        pytest.skip("may not mount")
    try:
        arguments = ("identify", small.experiment, "--out", disk / "run", "--no-report", "--no-prefect")
        code, said = finish(command_line(*arguments))
        assert code == 2 and "No space left" in said and "Traceback" not in said, said
        assert said.rstrip().endswith("--no-prefect --resume")  # how to go on
        subprocess.run(["mount", "-o", "remount,size=200m", disk], check=True)
        code, said = finish(command_line(*arguments, "--resume"))
        assert code == 0, said
        assert outcome(disk / "run") == small.result
    finally:
        subprocess.run(["umount", disk], check=True)


def test_a_folder_that_may_not_be_written_is_said(small, tmp_path):
    """/proc stands for it: root may write into folders whose rights say otherwise."""
    before = sorted(tmp_path.iterdir())
    code, said = finish(command_line("identify", small.experiment, "--out", "/proc/idic-run", "--no-prefect"))
    assert code == 2 and "/proc/idic-run" in said and "Traceback" not in said and "--resume" not in said, said
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.slow  # an identification
def test_a_finished_run_keeps_no_influence_of_a_measured_edge(kinds):
    """It is larger than the images, and only further steps read it; the sensitivities stay for the report."""
    stored = {description.parent.name for description in (kinds("measured edges").run / "run.zarr").rglob("zarr.json")}
    assert "du" in stored and "local_du" not in stored
