"""Power cuts: whatever the disk was not asked to hold is gone, and a run goes on from there with the same bits.

The RUN lies on a file system in a file. What that file holds at some instant is what a disk would hold after a power
cut at that instant: everything that was synchronised, and of the rest what the system happened to write back.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from fault_runs import evaluations, finish, is_at, kill, outcome, plain_run, stored_system

pytestmark = pytest.mark.skipif(os.name != "posix" or os.geteuid() != 0, reason="mounts file systems")
SIZE = 64 << 20  # bytes
# ext4 at its least forgiving: nothing is written back unasked
OPTIONS = "loop,commit=300,data=writeback,noauto_da_alloc"


def call(*words) -> None:
    subprocess.run([str(word) for word in words], check=True, capture_output=True)


@pytest.fixture
def disk(tmp_path):
    """An empty file system in a file."""
    if not all(map(shutil.which, ("mkfs.ext4", "losetup"))):
        pytest.skip("no mkfs.ext4 or losetup")
    file = tmp_path / "disk.img"
    file.touch()
    os.truncate(file, SIZE)
    call("mkfs.ext4", "-q", "-F", "-E", "lazy_itable_init=0,lazy_journal_init=0", file)
    try:
        with mounted(file, tmp_path / "trial"):
            pass
    except subprocess.CalledProcessError as problem:
        pytest.skip(f"may not mount: {problem.stderr.decode().strip()}")
    return file


@contextmanager
def mounted(file: Path, at: Path):
    at.mkdir(exist_ok=True)
    call("mount", "-t", "ext4", "-o", OPTIONS, file, at)
    try:
        yield at
    finally:
        call("umount", at)


def content_after_a_cut(file: Path, copy: Path) -> None:
    """What the disk holds now; read twice, since nobody stops the system from writing meanwhile."""
    for _ in range(20):
        shutil.copyfile(file, copy)
        if copy.read_bytes() == file.read_bytes():
            return
    raise AssertionError("the disk does not come to rest")


def cut(small, disk: Path, at: Path, share: float) -> Path | None:
    """The disk as a power cut after a share of a run leaves it; None where the run was over before."""
    with mounted(disk, at):
        process = plain_run(small.experiment, at / "run", 0)
        if not is_at(at / "run", process, share, evaluations(small.run)):
            finish(process)
            shutil.rmtree(at / "run")
            return None
        process.send_signal(signal.SIGSTOP)
        content_after_a_cut(disk, disk.with_name("after.img"))
        kill(process)
    return disk.with_name("after.img")


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 12))])
def test_a_run_goes_on_after_a_power_cut_with_the_same_bits(small, disk, tmp_path, seed):
    share, at, after = np.random.default_rng(seed).uniform(0.3, 1.0), tmp_path / "mounted", None
    while after is None:
        after, share = cut(small, disk, at, share), 0.7 * share
    with mounted(after, at):
        state = at / "run" / "state.json"
        assert not state.exists() or "sha256" in json.loads(state.read_text()), "half a checkpoint"
        code, said = finish(plain_run(small.experiment, at / "run", 0))
        assert code == 0, said
        assert outcome(at / "run") == small.result
        assert stored_system(at / "run") == small.system
        for description in (at / "run").rglob("zarr.json"):  # every level, so that any reader of Zarr finds its way
            json.loads(description.read_text())


def test_what_was_not_synchronised_is_lost_on_this_disk(disk, tmp_path):
    """That the tests above can fail: of two files the one that nobody synchronised is empty or not there."""
    at = tmp_path / "mounted"
    with mounted(disk, at):
        for name in ("lost", "kept"):
            with open(at / name, "w") as file:
                file.write("words" * 1000)
                if name == "kept":
                    file.flush()
                    os.fsync(file.fileno())
        time.sleep(0.1)
        content_after_a_cut(disk, disk.with_name("after.img"))
    with mounted(disk.with_name("after.img"), at):
        assert (at / "kept").read_text() == "words" * 1000
        assert not (at / "lost").exists() or (at / "lost").read_bytes() != b"words" * 1000
