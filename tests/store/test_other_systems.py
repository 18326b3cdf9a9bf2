"""What differs between Linux, macOS and Windows: locks, files that others hold open, separators, modules that are not
there."""

from __future__ import annotations

import ast
import ntpath
import os
import re
import subprocess
import sys
from functools import cache
from pathlib import Path, PurePosixPath, PureWindowsPath

import numpy as np
import pytest

import idic
from idic.errors import InputError
from idic.readers import natural_key
from idic.run.diagnosis.enriched import way_to
from idic import inside
from idic.run.store import run_lock
from idic.run import group_name
from idic.path_names import ignores_case, path_name, refuse_names_that_are_one
from idic.run.store.run_lock import RunBusy
from idic.run.workers import peak_memory

ONLY_SOMEWHERE = {"fcntl", "grp", "msvcrt", "pwd", "resource", "termios", "winreg"}
# of the module os
ONLY_POSIX = {"fork", "getuid", "killpg", "pread", "pwrite", "sched_getaffinity", "setsid", "waitid"}


class LockOfWindows:
    """``msvcrt.locking`` as documented: a byte that one descriptor has locked is refused to the others."""

    LK_NBLCK = 2

    def __init__(self):
        self.locked: set[tuple[int, int]] = set()

    def locking(self, descriptor: int, mode: int, n_bytes: int) -> None:
        place = (os.fstat(descriptor).st_ino, os.lseek(descriptor, 0, os.SEEK_CUR))
        if place in self.locked:
            raise PermissionError(13, "Permission denied")
        self.locked.add(place)


def test_without_posix_locks_the_lock_of_windows_keeps_others_out(tmp_path, monkeypatch):
    system = LockOfWindows()
    monkeypatch.setattr(run_lock, "fcntl", None)
    monkeypatch.setattr(run_lock, "msvcrt", system)
    with run_lock.run_lock(tmp_path):
        assert run_lock.is_held(tmp_path)  # the holder's number is readable beside the locked byte
        with pytest.raises(RunBusy, match=str(os.getpid())), run_lock.run_lock(tmp_path):
            pass
    system.locked.clear()  # as the system does when the file is closed
    with run_lock.run_lock(tmp_path):
        assert (tmp_path / run_lock.LOCK_NAME).stat().st_size < 1000  # the locked byte lies beyond the end


def test_a_file_that_another_program_holds_open_is_replaced_when_it_lets_go(tmp_path, monkeypatch):
    refused, given = [1, 1], os.replace
    monkeypatch.setattr(os, "replace", lambda a, b, **_: given(a, b) if not refused else held(refused))
    (tmp_path / "new").write_text("new", encoding="utf-8")
    (tmp_path / "old").write_text("old", encoding="utf-8")
    inside.replace_file(tmp_path / "new", tmp_path / "old", patience_s=10.0)
    assert (tmp_path / "old").read_text(encoding="utf-8") == "new" and not refused
    refused.append(1)
    with pytest.raises(PermissionError):
        inside.replace_file(tmp_path / "old", tmp_path / "new", patience_s=0.0)


def held(refused):
    refused.pop()
    raise PermissionError(13, "Permission denied")


@pytest.mark.parametrize("label", ["Force/N", "a\\b", "sheet: left", "con", "LPT1.x", "end.", "what?", "..", "C:"])
def test_a_name_of_the_user_is_one_part_of_a_path_on_every_system(label):
    name = path_name(label)
    for kind in (PurePosixPath, PureWindowsPath):
        assert kind("run", name).parts == ("run", name)
    assert not PureWindowsPath(name).drive and not name.endswith((".", " "))


def test_two_names_that_are_one_on_a_disk_without_capitals_are_refused_there(tmp_path):
    run = tmp_path / "Runs" / "first"  # not there yet
    assert not ignores_case(run)  # this disk tells them apart
    refuse_names_that_are_one(["sheet.E", "SHEET.E"], run)
    (tmp_path / "rUNS").mkdir()
    (tmp_path / "Runs").symlink_to(tmp_path / "rUNS")  # what such a disk answers: both names, one folder
    assert ignores_case(run)
    refuse_names_that_are_one(["sheet.E", "sheet.nu"], run)
    with pytest.raises(InputError, match="sheet.E, SHEET.E"):
        refuse_names_that_are_one(["sheet.E", "sheet.nu", "SHEET.E"], run)


def test_groups_of_a_run_are_the_same_folders_under_either_separator():
    name = group_name(7, "SPECIMEN.E")
    assert PureWindowsPath("run.zarr", name).as_posix() == PurePosixPath("run.zarr", name).as_posix()


def test_files_have_the_same_order_under_either_separator():
    files = ["a/10.tif", "a/9.tif", "a1/1.tif", "a-b/1.tif", "B/1.tif"]
    orders = [sorted(files, key=lambda file, kind=kind: natural_key(kind(file).as_posix()))
              for kind in (PurePosixPath, PureWindowsPath)]
    assert orders[0] == orders[1]


def test_peak_memory_is_known_without_the_resource_module(monkeypatch):
    """psutil tells the peak on Windows alone, so that a stand-in has its name here."""
    known = peak_memory.peak_memory_mb(children=False)
    assert known > 10.0  # an interpreter with NumPy

    class Process:
        def memory_info(self):
            return type("Memory", (), {"peak_wset": int(known * 1e6)})

    monkeypatch.setattr(peak_memory, "resource", None)
    monkeypatch.setattr(peak_memory.psutil, "Process", Process)
    assert peak_memory.peak_memory_mb() == pytest.approx(known)


@pytest.mark.skipif(not peak_memory.STATUS.exists(), reason="not Linux")
def test_the_peak_of_a_process_does_not_count_the_memory_of_the_one_that_started_it():
    """The kernel hands the peak on: a notebook of 6 GB made every run that it started say 6 GB."""
    large = np.ones(60_000_000)  # 480 MB
    code = "from idic.run.workers.peak_memory import peak_memory_mb; print(peak_memory_mb())"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert 1.0 < float(found.stdout) < large.nbytes / 2e6


@cache
def sources() -> list[tuple[Path, ast.Module]]:
    """The files that hold one of these names."""
    root = Path(idic.__file__).parent
    texts = {file: file.read_text(encoding="utf-8")
             for file in sorted([*root.rglob("*.py"), *(root.parent / "flows").rglob("*.py")])}
    asked_for = re.compile(rf"\b({'|'.join(sorted(ONLY_SOMEWHERE | ONLY_POSIX))})\b")
    return [(file, ast.parse(text)) for file, text in texts.items() if asked_for.search(text)]


def test_modules_of_one_system_alone_are_imported_where_their_absence_is_caught():
    found = []
    for file, tree in sources():
        caught = {id(line) for block in ast.walk(tree) if isinstance(block, ast.Try) for line in block.body}
        for line in ast.walk(tree):
            names = [a.name for a in line.names] if isinstance(line, ast.Import) else [line.module] if isinstance(
                line, ast.ImportFrom) else []
            if ONLY_SOMEWHERE & set(names) and id(line) not in caught:
                found.append(f"{file.name}:{line.lineno}")
    assert not found


def test_functions_of_posix_alone_stand_behind_a_question():
    """In a function that asks for the system (``os.name``), for the function (``hasattr``) or catches its absence."""
    found = []
    for file, tree in sources():
        for function in [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]:
            used = [node.attr for node in ast.walk(function) if isinstance(node, ast.Attribute)
                    and node.attr in ONLY_POSIX
                    and isinstance(node.value, ast.Name) and node.value.id == "os"]
            if used and not any(asked in ast.unparse(function) for asked in ("os.name", "hasattr", "AttributeError")):
                found.append(f"{file.name}: {function.name} {used}")
    assert not found


def test_texts_are_written_and_read_as_utf_8():
    """Also by ruff: without `encoding` they are in the code page of the system, which is none of every German
    letter's."""
    command = [sys.executable, "-m", "ruff", "check", "--isolated", "--preview", "--select", "PLW1514", "--no-cache",
               str(Path(idic.__file__).parent)]
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=False)
    assert done.returncode == 0, done.stdout


def test_files_on_another_drive_are_named_by_their_whole_path():
    assert way_to("D:\\tests\\one\\images", "D:\\runs\\first\\enriched", ntpath) == "..\\..\\..\\tests\\one\\images"
    assert way_to("C:\\tests\\one\\images", "D:\\runs\\first\\enriched", ntpath) == "C:\\tests\\one\\images"


def test_where_nothing_may_be_written_kernels_are_kept_for_the_length_of_a_command(tmp_path):
    """/proc takes no files, not even from root; without a folder numba refuses every function with a cache."""
    code = ("import os, idic; idic.keep_compiled_somewhere(['/proc/nowhere', '/proc/cache'], os.environ); "
            "print(os.environ['NUMBA_CACHE_DIR'])")
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True,
                            env={**os.environ, "NUMBA_CACHE_DIR": "", "TMPDIR": str(tmp_path)})
    folder = Path(answer.stdout.strip())
    assert folder.parent == tmp_path and not folder.exists()
    environment = {}
    idic.keep_compiled_somewhere(["/proc/nowhere", str(tmp_path / "new" / "cache")], environment)
    assert environment == {}
