"""Forged and damaged RUNs, read by every command that opens one."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import socket
from collections.abc import Callable
from pathlib import Path

import idic
from idic.cli.app import exit_code
from idic.report import render_page
from idic.run import open_source
from idic.run.batch.entries import BatchRun
from idic.run.batch.store import Batch
from idic.run.reporting.write import load_record, write_numbers
from idic.run.separation.members import diagnosed
from idic_studies.evidence.hostile.bases import Base
from idic_studies.evidence.hostile.counting import Case, Scene, command, copied

UNFINISHED_SHARE = 0.1  # of the RUNs: their resumption computes again, which takes seconds
DIGEST = "sha256"


# what reads a RUN -------------------------------------------------------------------------------------
def _resume(scene: Scene, base: Base, run: Path) -> str:
    result = idic.identify(base.experiment, run, resume=True, overrides=base.overrides)
    return exit_code(result["status"]) and "not converged"


def _numbers(scene: Scene, base: Base, run: Path) -> str:
    """A report without its figures, which take twenty times as long."""
    record = load_record(run)
    write_numbers(run, record, paraview=bool(scene.rng.integers(2)))
    render_page(record, ())
    return "numbers"


def _diagnose(scene: Scene, base: Base, run: Path) -> str:
    """What a diagnosis starts from."""
    open_source(run)
    return "source"


def _compare(scene: Scene, base: Base, run: Path) -> str:
    return command("compare", run, base.run, "--out", scene.work / "compared")


def _fields(scene: Scene, base: Base, run: Path) -> str:
    return command("fields", run, "--out", scene.work / "fields")


def _clean(scene: Scene, base: Base, run: Path) -> str:
    return command("clean", run)


def _separate(scene: Scene, base: Base, run: Path) -> str:
    """What `idic design --separate` reads: a diagnosis between two candidates, spoilt."""
    candidates = [{"name": name, "edits": f"[boundary_{name}]\nvalue = 0.5\n", "values": {"E": 7e4, "nu": None}}
                  for name in ("slip", "seating")]
    content: object = {"refits": candidates, "indistinguishable": [["slip", "seating"]], "named": ["slip"]}
    for _ in range(int(scene.rng.integers(0, 3))):
        content = _changed(scene, content)
    (run / "diagnosis.json").write_text(json.dumps(content))
    if scene.rng.integers(8) == 0:
        _deep(scene, run / "diagnosis.json")
    diagnosed(run)
    return "diagnosed"


def _lock(scene: Scene, base: Base, run: Path) -> str:
    """The lock of a process that ended, spoilt; then a command that takes it."""
    holder = {"host": socket.gethostname(), "pid": os.getpid(), "process_started": 0.0, "locked": "now"}
    (run / "run.lock").write_text(json.dumps(_changed(scene, holder)))
    if scene.rng.integers(8) == 0:
        _deep(scene, run / "run.lock")
    return command("clean", run)


def _batch(scene: Scene, base: Base, run: Path) -> str:
    """A batch whose summary is spoilt, taken up again; its RUN is whole, so that nothing is computed."""
    folder = scene.work / "batch"
    folder.mkdir()
    run.rename(folder / "a")
    row = {"name": "a", "experiment": str(base.experiment.resolve()), "set": {}, "run": "a", "status": "converged",
           "reason": "", "iterations": 2, "image_chi2_dof": 1.0, "wall_s": 1.0,
           "parameters": {"E": {"value": 1.0, "std": 0.1, "unit": "MPa", "start": 1.0}}}
    (folder / "batch.json").write_text(json.dumps(_changed(scene, {"schema": "idic.batch/1", "runs": [row]})))
    if scene.rng.integers(8) == 0:
        _deep(scene, folder / "batch.json")
    batch = Batch(folder, [BatchRun("a", str(base.experiment.resolve()), {})])
    with batch.claim(True):
        batch.write("finished", page=True)
    return "batch"


READERS: tuple[Callable[[Scene, Base, Path], str], ...] = (_resume, _numbers, _diagnose, _compare, _fields, _clean,
                                                                _separate, _lock, _batch)


def _read(scene: Scene, base: Base, run: Path) -> str:
    reader = READERS[int(scene.rng.integers(len(READERS)))]
    if reader is _resume and scene.rng.random() < UNFINISHED_SHARE:
        (run / "result.json").unlink(missing_ok=True)
    return reader(scene, base, run) or "done"


# right checksums, wrong contents --------------------------------------------------------------------
def forged(base: Base) -> Case:
    """RUNs whose files state other values, with checksums that fit."""
    def case(scene: Scene) -> str:
        run = copied(base.run, scene.work / "run")
        for _ in range(int(scene.rng.integers(1, 4))):
            FORGERIES[int(scene.rng.integers(len(FORGERIES)))](scene, run)
        return _read(scene, base, run)
    return case


def _forge_sealed(scene: Scene, run: Path) -> None:
    """Another value in result.json, state.json or run.json, sealed again; copies go."""
    names = [name for name in ("result.json", "state.json", "run.json") if (run / name).is_file()]
    file = run / names[int(scene.rng.integers(len(names)))]
    document = json.loads(file.read_text())
    content = document if file.name == "result.json" else document["state"]
    content.pop(DIGEST, None)
    content = _changed(scene, content)
    if file.name == "result.json":
        if not isinstance(content, dict):
            file.write_text(json.dumps(content))
            return
        document = content
    else:
        document["state"] = content
    document[DIGEST] = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    file.write_text(json.dumps(document))
    file.with_name(f"{file.stem}.copy.json").unlink(missing_ok=True)


def _forge_group(scene: Scene, run: Path) -> None:
    """Other attributes of a group of run.zarr."""
    groups = _descriptions(run, "group")
    if groups:
        file = groups[int(scene.rng.integers(len(groups)))]
        content = json.loads(file.read_text())
        content["attributes"] = _changed(scene, content.get("attributes", {}))
        file.write_text(json.dumps(content))


def _forge_array(scene: Scene, run: Path) -> None:
    """Another description of an array, with the checksum that its group keeps of it."""
    arrays = _descriptions(run, "array")
    if not arrays:
        return
    file = arrays[int(scene.rng.integers(len(arrays)))]
    file.write_text(json.dumps(_changed(scene, json.loads(file.read_text()))))
    parent = file.parents[1] / "zarr.json"
    if parent.is_file():
        group = json.loads(parent.read_text())
        descriptions = group.get("attributes", {})
        if isinstance(descriptions, dict) and isinstance(descriptions.get("descriptions"), dict):
            descriptions["descriptions"][file.parent.name] = hashlib.sha256(file.read_bytes()).hexdigest()
            parent.write_text(json.dumps(group))


def _descriptions(run: Path, kind: str) -> list[Path]:
    """Descriptions of groups or arrays that an earlier forgery has left as such."""
    contents = {path: json.loads(path.read_text()) for path in sorted(run.rglob("zarr.json"))}
    return [path for path, content in contents.items()
            if isinstance(content, dict) and content.get("node_type") == kind]


FORGERIES = (_forge_sealed, _forge_sealed, _forge_sealed, _forge_group, _forge_array)


def _changed(scene: Scene, content: object) -> object:
    """A content with another value at a random place, or without it, or with one more."""
    content = json.loads(json.dumps(content))
    ways = list(_places(content))[1:]
    if not ways:
        return strange(scene)
    *way, key = ways[int(scene.rng.integers(len(ways)))]
    holder = content
    for step in way:
        holder = holder[step]
    choice = scene.rng.integers(6)
    if choice == 0:
        del holder[key]
    elif choice == 1 and isinstance(holder, dict):
        holder[str(strange(scene))[:200]] = strange(scene)
    elif choice == 2 and isinstance(holder, list):
        holder.insert(key, strange(scene))
    elif choice == 3:
        holder[key] = of_another_type(scene, holder[key])
    else:
        holder[key] = strange(scene)
    return content


def _places(value: object, above: tuple = ()):
    yield above
    pairs = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in pairs:
        yield from _places(item, (*above, key))


def strange(scene: Scene) -> object:
    """A value against the schema: extreme numbers, other types, names of files outside."""
    values = [None, True, 0, -1, 10**30, 2**63, 1e308, -1e-320, float("nan"), float("inf"), "", "x" * 5000, "NaN", "\0",
              "\x1b[31m", "\ud800", [], {}, [[]], [[[[1]]]], {"": None}, "0x1p+3", "../../secret/secret.txt",
              str(scene.secret / "secret.txt"), str(scene.secret), "..", "/", "file:///etc/passwd", "frame_000.tif",
              [1, 2, 3], {"a": {"b": [None]}}, "2.0", -0.0, 3.5, 1]
    return values[int(scene.rng.integers(len(values)))]


def of_another_type(scene: Scene, value: object) -> object:
    """The same content in another type."""
    if isinstance(value, dict):
        return list(value.items()) or ""
    if isinstance(value, list):
        return {str(k): item for k, item in enumerate(value)} if scene.rng.integers(2) else value * 3
    if isinstance(value, str):
        return [value] if scene.rng.integers(2) else len(value)
    return str(value) if scene.rng.integers(2) else [value]


# damage -----------------------------------------------------------------------------------------------
def damaged(base: Base) -> Case:
    """RUNs and experiments with damaged files, or with something else in their place."""
    def case(scene: Scene) -> str:
        if scene.rng.integers(3) == 0:
            folder = copied(base.experiment, scene.work / "experiment")
            _damage(scene, folder)
            return command("check", folder, "--no-picture")
        run = copied(base.run, scene.work / "run")
        for _ in range(int(scene.rng.integers(1, 3))):
            _damage(scene, run)
        return _read(scene, base, run)
    return case


def _damage(scene: Scene, folder: Path) -> None:
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and not path.is_symlink()]
    names = [path for path in files if path.suffix in (".json", ".toml", ".csv", ".inp")]
    files = names if names and scene.rng.integers(3) == 0 else files
    file = files[int(scene.rng.integers(len(files)))]
    DAMAGES[int(scene.rng.integers(len(DAMAGES)))](scene, file)


def _bits(scene: Scene, file: Path) -> None:
    content = bytearray(file.read_bytes() or b"\0")
    for _ in range(int(scene.rng.integers(1, 9))):
        content[int(scene.rng.integers(len(content)))] ^= 1 << int(scene.rng.integers(8))
    file.write_bytes(bytes(content))


def _cut(scene: Scene, file: Path) -> None:
    os.truncate(file, int(scene.rng.random() * file.stat().st_size))


def _longer(scene: Scene, file: Path) -> None:
    file.write_bytes(file.read_bytes() + scene.rng.bytes(int(scene.rng.integers(1, 5000))))


def _noise(scene: Scene, file: Path) -> None:
    file.write_bytes(scene.rng.bytes(max(1, file.stat().st_size)))


def _block(scene: Scene, file: Path) -> None:
    content = bytearray(file.read_bytes())
    start = int(scene.rng.integers(len(content) + 1))
    content[start : start + int(scene.rng.integers(1, 200))] = scene.rng.bytes(int(scene.rng.integers(0, 200)))
    file.write_bytes(bytes(content))


def _text(scene: Scene, file: Path) -> None:
    """A word of a text exchanged."""
    words = file.read_bytes().split(b" ")
    pool = (b"nan", b"-1", b"1e400", b"", b"\xff\xfe", b"'", b'"', b"[[", b"../secret/secret.txt", b"9" * 400, b"=")
    words[int(scene.rng.integers(len(words)))] = pool[int(scene.rng.integers(len(pool)))]
    file.write_bytes(b" ".join(words))


def _link(scene: Scene, file: Path) -> None:
    file.unlink()
    if scene.work / "experiment" in file.parents:  # links of an experiment are followed: docs/safety.md
        return
    targets = (scene.secret / "secret.txt", scene.secret, file, scene.secret / "nothing", Path(os.devnull))
    file.symlink_to(targets[int(scene.rng.integers(len(targets)))])


def _pipe(scene: Scene, file: Path) -> None:
    file.unlink()
    os.mkfifo(file)


def _folder(scene: Scene, file: Path) -> None:
    file.unlink()
    file.mkdir()


def _folder_link(scene: Scene, file: Path) -> None:
    """The folder of a file becomes a link to one outside."""
    if file.parent.parent in (scene.work, scene.work.parent):
        return
    folder = file.parent
    shutil.rmtree(folder)
    if scene.work / "experiment" not in folder.parents:
        folder.symlink_to(scene.secret)


def _exchange(scene: Scene, file: Path) -> None:
    others = [path for path in sorted(file.parent.rglob("*")) if path.is_file() and path != file]
    if others:
        file.write_bytes(others[int(scene.rng.integers(len(others)))].read_bytes())


def _without(scene: Scene, file: Path) -> None:
    file.unlink()


def _deep(scene: Scene, file: Path) -> None:
    """Brackets that no reader follows to the end."""
    mark = (b"[", b'{"a":', b"(")[int(scene.rng.integers(3))]
    file.write_bytes(mark * int(scene.rng.choice((900, 5_000, 200_000))))


DAMAGES = (_bits, _bits, _cut, _longer, _noise, _block, _text, _without, _link, _pipe, _folder, _folder_link, _exchange,
           _deep)
