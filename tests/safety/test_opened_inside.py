"""Files of a folder that somebody else filled are opened there: no link, no pipe, no name leads elsewhere."""

from __future__ import annotations

import ast
import os

import pytest
from quality.called import called
from quality.sources import modules

from idic import inside
from idic.errors import InputError
from idic.inside import (
    folder_inside, is_inside, open_inside, read_inside, refuse_special_files, remove_inside, replace_inside,
    way_inside, write_inside,
)

SECRET = "what lies outside"


@pytest.fixture(params=[True, False], ids=["handles", "paths"])
def folder(tmp_path, monkeypatch, request):
    """A folder to work in, beside a file that is none of its business; with and without handles of folders."""
    if request.param and not inside.HANDLES:
        pytest.skip("this system has no handles of folders")
    monkeypatch.setattr(inside, "HANDLES", request.param)
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "secret.txt").write_text(SECRET)
    (tmp_path / "run" / "figures").mkdir(parents=True)
    return tmp_path / "run"


OPERATIONS = {
    "read": read_inside, "write": lambda run, name: write_inside(run, name, "new"),
    "append": lambda run, name: open_inside(run, name, "a").close(),
    "empty": lambda run, name: open_inside(run, name, "w").close(),
    "lock": lambda run, name: open_inside(run, name, "a+b").close(),
    "change": lambda run, name: open_inside(run, name, "r+").close()}


@pytest.mark.parametrize("operation", OPERATIONS)
@pytest.mark.parametrize("name", ["log.txt", "figures/log.txt", "linked/secret.txt"])
def test_no_operation_follows_a_link(folder, operation, name):
    outside = folder.parent / "outside"
    (folder / "linked").symlink_to(outside)
    for place in ("log.txt", "figures/log.txt"):
        (folder / place).symlink_to(outside / "secret.txt")
    with pytest.raises(InputError, match="a symbolic link"):
        OPERATIONS[operation](folder, name)
    assert [path.name for path in outside.iterdir()] == ["secret.txt"]
    assert (outside / "secret.txt").read_text() == SECRET


@pytest.mark.parametrize("operation", OPERATIONS)
def test_a_pipe_is_refused_at_once(folder, operation):
    os.mkfifo(folder / "result.json")
    with pytest.raises(InputError, match="a pipe"):
        OPERATIONS[operation](folder, "result.json")


@pytest.mark.parametrize("operation", OPERATIONS)
@pytest.mark.parametrize("name", ["../outside/secret.txt", "figures/../../outside/secret.txt", "/etc/hostname", "", ".",
                                  "figures//x", "a\0b"])
def test_no_name_leads_out(folder, operation, name):
    with pytest.raises(InputError, match="leads out of its folder"):
        OPERATIONS[operation](folder, name)


def test_files_are_written_whole_read_replaced_and_removed(folder):
    write_inside(folder, "figures/a.txt", "ä\n", lasting=True)
    assert read_inside(folder, "figures/a.txt") == "ä\n".encode() and is_inside(folder, "figures/a.txt")
    with open_inside(folder, "figures/a.txt", "a") as stream:
        stream.write("b\n")
    with open_inside(folder, "figures/a.txt", "r") as stream:
        assert stream.read() == "ä\nb\n"
    write_inside(folder, "figures/a.txt", b"c")
    replace_inside(folder, "figures/a.txt", "b.txt")
    assert sorted(path.name for path in folder.rglob("*")) == ["b.txt", "figures"]
    assert folder_inside(folder, "new/deep") == folder / "new" / "deep" and (folder / "new" / "deep").is_dir()
    for name in ("b.txt", "new", "nothing"):
        remove_inside(folder, name)
    assert [path.name for path in folder.iterdir()] == ["figures"]
    with pytest.raises(FileNotFoundError) as problem:
        read_inside(folder, "b.txt")
    assert problem.value.filename == str(folder / "b.txt")


def test_folders_are_neither_made_nor_removed_through_a_link(folder):
    outside = folder.parent / "outside"
    (folder / "tables").symlink_to(outside)
    for refuse in (folder_inside, way_inside):
        with pytest.raises(InputError, match="a symbolic link where idic opens folders"):
            refuse(folder, "tables")
    with pytest.raises(InputError, match="a symbolic link"):
        folder_inside(folder, "tables/deep")
    assert not is_inside(folder, "tables/secret.txt")
    remove_inside(folder, "tables")
    assert (outside / "secret.txt").read_text() == SECRET and not os.path.lexists(folder / "tables")


def test_links_and_pipes_in_a_folder_are_named_but_for_links_that_idic_made(folder):
    (folder / "enriched").mkdir()
    (folder / "enriched" / "images").symlink_to(folder.parent / "outside")
    refuse_special_files(folder, except_in=("enriched",))
    with pytest.raises(InputError, match="a symbolic link"):
        refuse_special_files(folder)
    os.mkfifo(folder / "figures" / "pipe")
    with pytest.raises(InputError, match="a pipe"):
        refuse_special_files(folder, except_in=("enriched",))


# the source -----------------------------------------------------------------------------------------
# Modules that write by themselves, and why nobody else's link can be there.
WRITERS = {
    "idic.inside": "the door itself",
    "idic": "a temporary folder that it has made",
    "idic.run.store.run_store": "in RUN/run.zarr, which Zarr opens by path: looked through when it is claimed",
    "idic.run.store.mirror.mirror": "a folder that a worker has made for one command",
    "idic.run.store.mirror.objects": "the storage that the user names",
    "idic.run.workers.exchange": "the same, of the driver",
    "idic.run.workers.served_objects": "the same, of the driver",
    "idic.run.prepared.warm_start": "groups of a new RUN that is claimed",
    "idic.run.diagnosis.enriched": "links and copies in a folder made a moment ago",
    "idic.run.workers.prefect_server": "idic's folder in the user's home, a temporary one",
    "idic.run.workers.working_folder": "idic's folder in the user's home, a temporary one",
    "idic.virtual_tests": "new folders of virtual tests",
    "idic.notebook": "new folders of saved experiments",
    "idic.fe.external": "RUN/scratch: folders with a random name, made for one simulation",
    "idic.model.black_box": "a temporary folder",
    "idic.experiment_file.tables.temperatures": "a folder made a moment ago",
    "idic.report.figures.law_curve": "the file that the user names", "idic.report.evidence.check": "the same",
    "idic.cli.identify_commands": "the folders of an earlier demo",
    "idic.cli.outcomes": "the null device in the place of a closed pipe",
}
CHANGES = {"write_text", "write_bytes", "mkdir", "touch", "symlink_to", "hardlink_to", "rename", "rmdir", "unlink",
           "savefig", "makedirs", "removedirs"}
FUNCTIONS = {f"shutil.{name}" for name in ("rmtree", "copy", "copy2", "copyfile", "copytree", "move")} | {
    f"os.{name}" for name in ("open", "replace", "rename", "renames", "remove", "unlink", "rmdir", "mkdir", "makedirs",
                              "link", "symlink", "truncate")} | {"replace_file"}
READS = {"read_text", "read_bytes"}
ONLY_INSIDE = ("idic.run", "idic.draw", "idic.cli", "idic.report", "idic_flows")  # rooms that read no input
READERS = {  # modules of these rooms that read by themselves
    "idic.run.store.run_store": "in RUN/run.zarr", "idic.run.store.mirror": "manifests of a claimed RUN",
    "idic.run.workers": "what this computer states of itself, the objects of a command, a token of the driver",
    "idic.run.store.image_files": "images of the experiment", "idic.run.batch.entries": "the list that the user names",
    "idic.draw.server": "files of the package",
    "idic.cli.identify_commands": "the truth of a demo",
    "idic.report.evidence.cost": "what this computer states of itself"}


def _bare(text, changes):
    """Calls that write (or read) at a path without the door."""
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.Call):
            continue
        name = called(node)
        method = node.func.attr if isinstance(node.func, ast.Attribute) else name
        mode = "".join(str(value.value) for value in [*node.args, *(word.value for word in node.keywords)]
                       if isinstance(value, ast.Constant) and isinstance(value.value, str) and len(value.value) <= 3)
        opens = method == "open" and name not in ("os.open", "FrameArrays.open", "Image.open", "webbrowser.open")
        writes = opens and set(mode) & set("wax+")
        if changes and (method in CHANGES or name in FUNCTIONS or writes):
            yield ast.unparse(node)
        if not changes and (method in READS or (opens and not writes)):
            yield ast.unparse(node)


def _entry(name, table):
    return next((entry for entry in table if name == entry or "." in entry and name.startswith(f"{entry}.")), None)


def test_every_room_writes_through_the_door():
    product = {name: file.read_text(encoding="utf-8") for name, file in modules().items()
               if not name.startswith("idic_studies")}
    bare = {name: list(_bare(text, True)) for name, text in product.items()}
    reads = {name: list(_bare(text, False)) for name, text in product.items() if name.startswith(ONLY_INSIDE)}
    for calls, table in ((bare, WRITERS), (reads, READERS)):
        assert {name: wrong for name, wrong in calls.items() if wrong and not _entry(name, table)} == {}
        used = {_entry(name, table) for name, wrong in calls.items() if wrong}
        assert set(table) <= used, "an exception that nothing needs any more"


@pytest.mark.parametrize("text", ["open(run / 'log.txt', 'a')", "(run / 'a').write_text('b')", "os.replace(a, b)",
                                  "path.mkdir(exist_ok=True)", "shutil.rmtree(folder)", "path.open('wb')"])
def test_the_reader_of_the_source_finds_a_bare_write(text):
    assert list(_bare(text, True)) and not list(_bare("open_inside(run, 'log.txt', 'a')", True))
    assert list(_bare("path.read_bytes()", False)) and list(_bare("open(path)", False))
