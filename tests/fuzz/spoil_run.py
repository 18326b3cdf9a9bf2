"""Ways to spoil a RUN folder: its Zarr stores, its state, description and result."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from hypothesis import strategies as st
from spoil_toml import splices

SHAPES = [[], [0], [-1], [1, 2, 3, 4, 5], [10**12], [10**30], "3", None, [1.5], [3, 10**15]]
TYPES = ["float32", "int8", "uint64", "bool", "string", "variable_length_bytes", "complex128", "r16", "float63", 8,
         None,
         {"name": "numpy.datetime64", "configuration": {"unit": "s", "scale_factor": 1}},
         {"name": "fixed_length_utf32", "configuration": {"length_bytes": 8}}, {"name": "structured"}]  # fmt: skip
CODECS = [[], [{"name": "bytes"}], [{"name": "bytes", "configuration": {"endian": "big"}}, {"name": "crc32c"}],
          [{"name": "numcodecs.pickle"}], [{"name": "bytes"}, {"name": "numcodecs.pickle"}], [{"name": "vlen-utf8"}],
          [{"name": "bytes", "configuration": {"endian": "little"}}, {"name": "gzip", "configuration": {"level": 5}}],
          [{"name": "bytes"}, {"name": "zstd", "configuration": {"level": 0, "checksum": False}}], [{"name": "../x"}],
          [{"name": "bytes"}, {"name": "blosc", "configuration": {}}], [{"name": "crc32c"}], {"name": "bytes"}, "bytes",
          [{"name": "transpose", "configuration": {"order": [0]}}, {"name": "bytes"}, {"name": "crc32c"}],
          # fmt: skip
          [{"name": "sharding_indexed", "configuration": {"chunk_shape": [1], "codecs": [{"name": "bytes"}]}}]]
LEFT_OUT = "(left out)"
STRANGE = [None, 0, -1, 1e308, "", "x" * 3000, [], {}, [[]], True, "NaN", "../../etc/passwd", "\x1b[31m", "\ud800"]
ARRAY_KEYS = {"shape": SHAPES, "data_type": TYPES, "codecs": CODECS, "fill_value": STRANGE, "zarr_format": [2, 4, "3"],
              "chunk_grid": STRANGE
              + [{"name": "regular", "configuration": {"chunk_shape": shape}} for shape in SHAPES],
              "chunk_key_encoding": [{"name": "v2", "configuration": {"separator": "."}},
                                     {"name": "default", "configuration": {"separator": "../"}}, "default", None],
              # fmt: skip
              "node_type": ["group", "x"], "dimension_names": [["a", "b"], "a"], "storage_transformers": [[{}], "x"]}


@dataclass(frozen=True)
class Spoilt:
    """One thing done to a RUN: to the file or folder at a share of the list of those that it may be done to."""

    what: str
    where: float
    how: object = None

    def __call__(self, run: Path) -> Path:
        """Do it; returns what was touched."""
        pick, act = ACTIONS[self.what]
        there = pick(run)
        target = there[min(int(self.where * len(there)), len(there) - 1)]
        act(target, self.how)
        return target.relative_to(run)


# what there is ---------------------------------------------------------------------------------------
def files(run: Path) -> list[Path]:
    return sorted(path for path in run.rglob("*") if path.is_file() and path.name != "run.lock")


def texts(run: Path) -> list[Path]:
    """The descriptions; those of the run itself as often as those of arrays, of which there are many."""
    own = sorted(run.glob("*.json"))
    return sorted(run.rglob("zarr.json")) + own * 10


def chunks(run: Path) -> list[Path]:
    return [path for path in files(run) if path.suffix != ".json"]


def arrays(run: Path) -> list[Path]:
    return [path for path in sorted(run.rglob("zarr.json")) if json.loads(path.read_text())["node_type"] == "array"]


def groups(run: Path) -> list[Path]:
    return [path for path in sorted(run.rglob("zarr.json")) if json.loads(path.read_text())["node_type"] == "group"]


def folders(run: Path) -> list[Path]:
    return sorted(path for path in run.rglob("*") if path.is_dir())


# what is done ----------------------------------------------------------------------------------------
def splice(path: Path, how: Callable[[bytes], bytes]) -> None:
    path.write_bytes(how(path.read_bytes()))


def flip(path: Path, bit: int) -> None:
    content = bytearray(path.read_bytes() or b"\x00")
    content[(bit // 8) % len(content)] ^= 1 << (bit % 8)
    path.write_bytes(bytes(content))


def cut(path: Path, share: float) -> None:
    os.truncate(path, int(share * path.stat().st_size))


def remove(path: Path, _) -> None:
    shutil.rmtree(path) if path.is_dir() else path.unlink()


def put_another_kind(path: Path, _) -> None:
    """A file where a folder was, a folder where a file was."""
    was_folder = path.is_dir()
    remove(path, None)
    path.write_bytes(b"?") if was_folder else path.mkdir()


def link_to_itself(path: Path, _) -> None:
    remove(path, None)
    path.symlink_to(path.name)


def copy_over(path: Path, share: float) -> None:
    """Another file of the run with the same name: whole, but not the one that belongs here."""
    others = [other for other in sorted(path.parents[1].rglob(path.name)) if other.is_file() and other != path]
    if others:
        path.write_bytes(others[min(int(share * len(others)), len(others) - 1)].read_bytes())


def describe(path: Path, how: tuple[str, object, bool]) -> None:
    """Another value in the description of an array; `sealed`: with the checksum that its group keeps of it."""
    key, value, sealed = how
    content = json.loads(path.read_text())
    content[key] = value
    path.write_text(json.dumps(content))
    parent = path.parents[1] / "zarr.json"
    if sealed and parent.is_file():
        group = json.loads(parent.read_text())
        if path.parent.name in group.get("attributes", {}).get("descriptions", {}):
            group["attributes"]["descriptions"][path.parent.name] = hashlib.sha256(path.read_bytes()).hexdigest()
            parent.write_text(json.dumps(group))


def give_attributes(path: Path, how: tuple[str, object]) -> None:
    """Another value among the attributes of a group."""
    content = json.loads(path.read_text())
    attributes = content["attributes"]
    names = sorted(attributes) + ["identity"]
    attributes[names[int(how[0] * len(names)) % len(names)]] = how[1]
    path.write_text(json.dumps(content))


def sealed_texts(run: Path) -> list[Path]:
    """The files that hold their own checksum."""
    return [path for path in (run / "run.json", run / "state.json", run / "result.json") if path.is_file()]


def places(value: object, above: tuple = ()) -> list[tuple]:
    """The way to every value of a nested content."""
    pairs = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [above, *(place for key, item in pairs for place in places(item, (*above, key)))]


def forge(path: Path, how: tuple[float, object]) -> None:
    """Another value in a file with a checksum, which is written anew; `LEFT_OUT`: none."""
    document = json.loads(path.read_text())
    is_result = path.name == "result.json"
    content = document if is_result else document["state"]
    content.pop("sha256", None) if is_result else None
    ways = places(content)[1:]
    *way, key = ways[int(how[0] * len(ways))]
    target = content
    for step in way:
        target = target[step]
    if how[1] == LEFT_OUT:
        del target[key]
    else:
        target[key] = how[1]
    digest = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    document["sha256"] = digest
    path.write_text(json.dumps(document))
    if not is_result:  # nor does its copy help
        path.with_name(f"{path.stem}.copy.json").unlink(missing_ok=True)


ACTIONS = {
    "forge": (sealed_texts, forge),
    "splice text": (texts, splice), "splice chunk": (chunks, splice), "flip text": (texts, flip),
    "flip chunk": (chunks, flip), "cut text": (texts, cut), "cut chunk": (chunks, cut), "remove file": (files, remove),
    "remove folder": (folders, remove), "another kind of file": (files, put_another_kind),
    "another kind of folder": (folders, put_another_kind), "loop": (files, link_to_itself),
    # fmt: skip
    "exchange": (files, copy_over), "describe": (arrays, describe), "attributes": (groups, give_attributes)}

_share = st.floats(0, 1, exclude_max=True)
_described = st.sampled_from(sorted(ARRAY_KEYS)).flatmap(
    lambda key: st.tuples(st.just(key), st.sampled_from(ARRAY_KEYS[key]), st.booleans()))
_HOW = {"splice text": splices, "splice chunk": splices, "flip text": st.integers(0, 80_000),
        "flip chunk": st.integers(0, 80_000), "cut text": _share, "cut chunk": _share, "exchange": _share,
        "forge": st.tuples(_share, st.sampled_from([*STRANGE, LEFT_OUT, 10**30, 7, [1, 2], {"a": None}, "0x1p+3"])),
        "describe": _described, "attributes": st.tuples(_share, st.sampled_from(STRANGE))}  # fmt: skip


def _one(what: str):
    return st.builds(Spoilt, st.just(what), _share, _HOW.get(what, st.none()))


forged_runs = _one("forge")
spoilt_runs = st.sampled_from(sorted(ACTIONS) + ["describe", "describe", "flip text"]).flatmap(_one)


def forged(spoilt: Spoilt) -> bool:
    """Whether a checksum was written anew with it: who does that may put any numbers there."""
    return spoilt.what == "forge" or spoilt.what == "describe" and spoilt.how[2]
