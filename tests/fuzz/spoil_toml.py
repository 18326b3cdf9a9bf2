"""Changed experiment files: keys, types, values, names in wrong places, and spoilt text."""

from __future__ import annotations

import copy
from dataclasses import dataclass

from hypothesis import strategies as st

from base_experiments import BASES, base_tables
from idic.experiment_file import to_toml

NUMBERS = [
    0,
    -1,
    1,
    2,
    0.0,
    -0.0,
    0.5,
    -3.7,
    1e-320,
    1e-12,
    1e12,
    1e308,
    -1e308,
    float("nan"),
    float("inf"),
    float("-inf"),
    2**31,
    2**63,
    -(2**70),
    10**400,
    1e-300,
    1e59,
    1e-59,
]
WORDS = [
    "",
    " ",
    "\t",
    "\x00",
    "a\x00b",
    "\x1b[31mred",
    "x" * 3000,
    "‮gnihton",
    "☃",
    "ß",
    "nan",
    "None",
    "true",
    "__import__('os')",
    "{",
    "%s%n",
    "-",
    "--out",
    "*",
    "**",
    "**/*",
    "[",
    "[!",
    "images/[0-9",
    "?",
    "~",
    "$HOME",
    "NUL",
]
PATHS = [
    "..",
    ".",
    "/",
    "../mesh.inp",
    "/etc/passwd",
    "images",
    "images/../mesh.inp",
    "C:\\x",
    "\\\\host\\share",
    "images\\frame_000.tif",
    "file:///etc/passwd",
    "experiment.toml",
    "loads.csv",
    "mesh.inp",
    "mask.tif",
    "images/frame_000.tif",
    "right/*.tif",
    "./mesh.inp",
    "mesh.inp/",
    "mesh.inp/x",
    "x" * 300,
    "deck.inp.template",
    "a**b/*.tif",
    "²",
]
NAMES = [
    "BOTTOM",
    "TOP",
    "RIGHT",
    "LAST",
    "FRONT",
    "LEFT",
    "SPECIMEN",
    "EDGE",
    "force_kN",
    "grip_um",
    "time_s",
    "frame",
    "x",
    "y",
    "z",
    "all",
    "outer",
    "measured",
    "elastic",
    "j2_linear",
    "neo_hookean",
    "egp",
    "maxwell",
    "external",
    "MPa",
    "GPa",
    "mm",
    "um",
    "px",
    "s",
    "1/K",
    "C",
    "kN",
    "height",
    "solid",
    "plane_strain",
    "camera.k1",
    "camera.tilt_x",
    "SPECIMEN.E",
    "SPECIMEN.nu",
    "geometry.thickness",
    "geometry.hole_x",
    "time.offset",
    "boundary.TOP.y.slip",
    "channel.force_kN.offset",
    "channel.force_kN.drift",
    "right.rotation_deg",
    "frame_001.tif",
    "3",
    "y < 1",
    "x*y > 1e400",
    "x > 1 and",
    "((((x > 1))))",
    "not x",
    "x == y == z",
    "exp(x) > 1",
    "x / 0 > 1",
    "0 ** -1 > x",
    "(0 - 8) ** 0.5 > x",
    ",",
    ".",
]
KEYS = sorted(
    {key for name in BASES for key in base_tables(name)}
    | {
        "value",
        "column",
        "measured",
        "virtual",
        "unit",
        "nodes",
        "edges",
        "ux",
        "uy",
        "uz",
        "u",
        "pressure",
        "traction",
        "force",
        "temperature",
        "law",
        "kinematics",
        "E",
        "nu",
        "bounds",
        "prior",
        "identify",
        "surface",
        "symmetry",
        "quantity",
        "height_unit",
        "still_frames",
        "image_times",
        "reference",
        "mask",
        "magnification_column",
        "motion",
        "defocus",
        "roi_mm",
        "locking",
        "simulated",
        "noise_std",
        "name",
        "free",
        "design",
        "images",
        "course",
        "decimal",
    }
)
small = (
    st.sampled_from(NUMBERS) | st.sampled_from(WORDS) | st.sampled_from(PATHS) | st.sampled_from(NAMES) | st.booleans()
)
value = (
    small
    | st.lists(small, max_size=4)
    | st.dictionaries(st.sampled_from(KEYS + WORDS), small, max_size=3)
    | st.floats()
    | st.integers()
    | st.text(max_size=8)
)


def _paths(tables, at=()):
    """The path of every value of nested tables and lists."""
    entries = tables.items() if isinstance(tables, dict) else enumerate(tables)
    found = []
    for key, below in entries:
        found.append((*at, key))
        if isinstance(below, (dict, list)):
            found += _paths(below, (*at, key))
    return found


@dataclass(frozen=True)
class Change:
    """One change of the tables: delete | replace | rename | add | double | nest, at a path."""

    what: str
    path: tuple
    value: object = None

    def apply(self, tables: dict) -> None:
        place = tables
        for step in self.path[:-1]:
            if (
                not isinstance(place, (dict, list))
                or (isinstance(place, dict) and step not in place)
                or (isinstance(place, list) and not (isinstance(step, int) and step < len(place)))
            ):
                return  # an earlier change took it away
            place = place[step]
        last = self.path[-1]
        if not (
            isinstance(place, dict)
            and last in place
            or isinstance(place, list)
            and isinstance(last, int)
            and last < len(place)
        ):
            return
        if self.what == "delete":
            del place[last]
        elif self.what == "replace":
            place[last] = self.value
        elif self.what == "nest":
            place[last] = [copy.deepcopy(place[last])] if self.value else {"value": copy.deepcopy(place[last])}
        elif self.what == "double" and isinstance(place, list):
            place.append(copy.deepcopy(place[last]))
        elif self.what == "rename" and isinstance(place, dict):
            place[self.value] = place.pop(last)
        elif self.what == "add" and isinstance(place[last], dict):
            key, new = self.value
            place[last][key] = new


@st.composite
def changes(draw, base: str) -> Change:
    paths = _paths(base_tables(base))
    what = draw(st.sampled_from(["delete", "replace", "replace", "replace", "rename", "add", "double", "nest"]))
    path = draw(st.sampled_from(paths))
    if what in ("delete", "double"):
        return Change(what, path)
    if what == "nest":
        return Change(what, path, draw(st.booleans()))
    if what == "rename":
        return Change(
            what, path, draw(st.sampled_from(KEYS) | st.sampled_from(WORDS) | st.just(str(path[-1]).upper() + "x"))
        )
    if what == "add":
        tables = [p for p in paths if isinstance(_at(base_tables(base), p), dict)]
        return Change(what, draw(st.sampled_from(tables)), (draw(st.sampled_from(KEYS)), draw(value)))
    return Change(what, path, draw(value))


def _at(tables, path):
    for step in path:
        tables = tables[step]
    return tables


@dataclass(frozen=True)
class ExperimentText:
    """The text of an experiment.toml; `base` names the folder that it belongs into."""

    base: str
    changes: tuple[Change, ...]

    @property
    def text(self) -> str:
        tables = copy.deepcopy(base_tables(self.base))
        for change in self.changes:
            change.apply(tables)
        return to_toml(tables)


@st.composite
def changed_experiments(draw) -> ExperimentText:
    """A base experiment with one to three changes."""
    base = draw(st.sampled_from(sorted(BASES)))
    return ExperimentText(base, tuple(draw(st.lists(changes(base), min_size=1, max_size=3))))


DEEP = [
    b"\na = " + b"[" * 3000 + b"]" * 3000,
    b"\na = " + b"{b=" * 3000 + b"1" + b"}" * 3000,
    b"\n[" + b".".join([b"a"] * 3000) + b"]\n",
    b"\n" + b".".join([b"a"] * 3000) + b" = 1\n",
]
PIECES = DEEP + [
    b"\xff\xfe",
    b"\xef\xbb\xbf",
    b"\x00",
    b'"',
    b"'''",
    b'"""',
    b"[",
    b"]",
    b"=",
    b"\r",
    b"\n[experiment]\n",
    b"\n[[camera]]\n",
    b"\na = 1" + b"0" * 5000 + b"\n",
    b"\na = 1e" + b"9" * 400 + b"\n",
    b"\nd = 1979-05-27T07:32:00Z\n",
    b"\nt = 07:32:00\n",
    b'\n"" = 1\n',
    b'\na = "\\ud800"\n',
    b'\na = "\\U00110000"\n',
    b"\nmaterial = 1\n",
    b"# \x01\n",
    b"\xc3\x28",
]


@dataclass(frozen=True)
class Splice:
    """Bytes of a file replaced: at a share of its length, so many of them, by a piece."""

    where: float
    length: int
    piece: bytes

    def __call__(self, data: bytes) -> bytes:
        k = int(self.where * len(data))
        return data[:k] + self.piece + data[k + self.length :]


splices = st.builds(
    Splice, st.floats(0, 1), st.sampled_from([0, 0, 1, 5, 100, 10**6]), st.sampled_from(PIECES) | st.binary(max_size=4)
)
