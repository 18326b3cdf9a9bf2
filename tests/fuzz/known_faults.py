"""The corpus: inputs that once ended in a traceback, hung or took the memory; each as a change of a base experiment."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

TOO_LONG_FOR_CSV = 140_000  # characters
BEYOND_INT64 = "9" * 23


def in_file(name: str, old: str, new: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text, f"{old!r} is not in {name}"
        (folder / name).write_text(text.replace(old, new, 1))

    return change


def key(line: str, table: str = "[experiment]") -> Callable[[Path], None]:
    return in_file("experiment.toml", f"{table}\n", f"{table}\n{line}\n")


def images(pattern: str) -> Callable[[Path], None]:
    return in_file("experiment.toml", '"images/*.tif"', f'"{pattern}"')


def set_by_position(expression: str) -> Callable[[Path], None]:
    return in_file("experiment.toml", "[camera]\n", f'[sets]\nODD = {{ where = "{expression}" }}\n[camera]\n')


def in_mesh(text: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        with (folder / "mesh.inp").open("a") as stream:
            stream.write(text)

    return change


def mesh_file(name: str, text: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        (folder / name).write_text(text)
        in_file("experiment.toml", '"mesh.inp"', f'"{name}"')(folder)

    return change


def in_place_of(name: str, make: Callable[[Path], None]) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        (folder / name).unlink()
        make(folder / name)

    return change


def to_itself(path: Path) -> None:
    path.symlink_to(path.name)


def nested_sets(levels: int, per_level: int, rising: bool = True) -> str:
    blocks = [f"*NSET, NSET=N{k}\n" + ", ".join([f"N{k - 1}"] * per_level) + "\n" for k in range(1, levels)]
    blocks.insert(0, "*NSET, NSET=N0\n101\n")
    return "".join(blocks if rising else reversed(blocks))


XDMF = """<?xml version="1.0"?><Xdmf Version="3.0"><Domain><Grid Name="plate"><Geometry GeometryType="XY"><DataItem
DataType="Float" Dimensions="4 2" Format="XML" Precision="8">0 0 1 0 0 1 1 1</DataItem></Geometry><Topology
TopologyType="Quadrilateral" NumberOfElements="1"><DataItem DataType="Int" Dimensions="1 4" Format="XML"
Precision="8">0 1 3 2</DataItem></Topology></Grid></Domain></Xdmf>"""

REFUSED: dict[str, Callable[[Path], None]] = {  # exit code 2, one message
    "a folder as images": images("."),
    "a folder as images, with a slash": images("./"),
    "a folder as still frames": key('still_frames = "."'),
    "a pattern with ** inside a name": images("a**b/*.tif"),
    "a division by zero as a power": set_by_position("0 ** -1 > x"),
    "a complex power": set_by_position("(0 - 8) ** 0.5 > x"),
    "deep parentheses": set_by_position("(" * 1900),
    "a cell longer than csv reads": in_file("loads.csv", "5.0", "5." + "0" * TOO_LONG_FOR_CSV),
    "a quoted cell longer than csv reads": in_file("loads.csv", "5.0", f'"5.{"0" * TOO_LONG_FOR_CSV}"'),
    "a value that overflows": in_file("loads.csv", "5.0", "5e300"),
    "a node label beyond int64": in_file("mesh.inp", "101, 0.0", f"{BEYOND_INT64}, 0.0"),
    "an element label beyond int64": in_file("mesh.inp", "1001, ", f"{BEYOND_INT64}, "),
    "a member of a set beyond int64": in_mesh(f"*NSET, NSET=A\n{BEYOND_INT64}\n"),
    "a member of 5000 digits": in_mesh(f"*NSET, NSET=A\n{'9' * 5000}\n"),
    "a superscript as a label": in_mesh("*NSET, NSET=A\n²\n"),
    "a superscript as an element": in_mesh("*SURFACE, NAME=Q\n²\n"),
    "a superscript as an element with a face": in_mesh("*SURFACE, NAME=Q\n²,S1\n"),
    "a range without end": in_mesh("*NSET, NSET=A, GENERATE\n1, 99999999999\n"),
    "a range beyond int64": in_mesh(f"*NSET, NSET=A, GENERATE\n1, {BEYOND_INT64}\n"),
    "a long range of int32": in_mesh("*NSET, NSET=A, GENERATE\n1, 2000000000\n"),
    "a surface of an unknown node": in_mesh("*SURFACE, NAME=Q, TYPE=NODE\n77777\n"),
    "a surface of an unknown node set": in_mesh("*SURFACE, NAME=Q, TYPE=NODE\nNONE\n"),
    "a surface of an unknown element": in_mesh("*SURFACE, NAME=Q\n77777, S1\n"),
    "a face S0": in_mesh("*SURFACE, NAME=Q\n1001, S0\n"),
    "sets nested from the outside": in_mesh(nested_sets(3000, 1, rising=False)),
    "a mesh that a reader waits for": mesh_file("part.node", ""),
    "XDMF without its library": mesh_file("part.xdmf", XDMF),
    "XDMF of another version": mesh_file("part.xdmf", "<Xdmf Version='9'/>"),
    "the last frame as reference": key("reference = 3"),
    "a billion increments": key("substeps = 1000000000", "[options]"),
    "iterations without end": key(f"max_iterations = {'9' * 300}\n[setup]", "[options]"),
    "noise whose square is zero": in_file("experiment.toml", "noise_std = 0.005", "noise_std = 1e-300"),
    "noise whose square is infinite": in_file("experiment.toml", "noise_std = 0.005", "noise_std = 1e300"),
    "image noise whose square is zero": in_file("experiment.toml", "noise_std_gv = 2.0", "noise_std_gv = 1e-300"),
    "drive noise whose square is zero": in_file("experiment.toml", "noise_std = 0.2", "noise_std = 1e-300"),
    "patches whose area is infinite": key("patch_px = 1e300", "[options]"),
    "a thickness beyond all measure": in_file("experiment.toml", "thickness_mm = 2.0", "thickness_mm = 1e300"),
    "a factor beyond all measure": in_file("experiment.toml", 'component = "y" }', 'component = "y", factor = 1e300 }'),
    "pixels beyond all measure": in_file("experiment.toml", "pixel_size_mm = 0.1", "pixel_size_mm = 1e-300"),
    "a table whose name looks like a type": in_file("experiment.toml", "[experiment]", "['a(b)']"),
    "a table with the name of a type": in_file("experiment.toml", "[experiment]", "[str]"),
    "a table as law": in_file("experiment.toml", 'law = "elastic"', 'law = { x = 1 }'),
    "a pipe as log": in_place_of("loads.csv", os.mkfifo),
    "a pipe as mesh": in_place_of("mesh.inp", os.mkfifo),
    "a pipe as experiment": in_place_of("experiment.toml", os.mkfifo),
    "a folder as log": in_place_of("loads.csv", os.mkdir),
    "a folder as mesh": in_place_of("mesh.inp", os.mkdir),
    "a folder as experiment": in_place_of("experiment.toml", os.mkdir),
    "a link to itself as log": in_place_of("loads.csv", to_itself),
    "a link to itself as experiment": in_place_of("experiment.toml", to_itself),
    "an endless device as log": in_place_of("loads.csv", lambda path: path.symlink_to("/dev/zero")),
    "a file that cannot be read as log": in_place_of("loads.csv", lambda path: path.symlink_to("/proc/self/mem")),
    "folders without end": lambda folder: [(folder / "images" / "again").symlink_to("."), images("**/*.tif")(folder)],
}

ACCEPTED: dict[str, Callable[[Path], None]] = {  # exit code 0
    "a superscript between the digits of a name": lambda folder: [
        (folder / "images" / f"frame_00{k}.tif").rename(folder / "images" / f"frame_{k}²{k}.tif") for k in range(4)],
    "a superscript as the name of a folder": lambda folder: [
        (folder / "images").rename(folder / "²"), images("²/*.tif")(folder)],
    "a pipe among the images": lambda folder: os.mkfifo(folder / "images" / "frame_004.tif"),
    "sets of sets of sets": in_mesh(nested_sets(60, 2)),
    "a long chain of sets": in_mesh(nested_sets(3000, 1)),
    "a byte order mark": lambda folder: (folder / "experiment.toml").write_bytes(
        b"\xef\xbb\xbf" + (folder / "experiment.toml").read_bytes()),
    "an experiment in UTF-16": lambda folder: (folder / "experiment.toml").write_bytes(
        (folder / "experiment.toml").read_text().encode("utf-16")),
}

REFUSED_SETTINGS = {  # --set
    "a superscript as a number": "boundary.².uy=0",
    "a superscript as a key": "boundary.0.²=0",
    "a number of 5000 digits": f"boundary.{'9' * 5000}.uy=0",
    "a deep value": "SPECIMEN.E=" + "[" * 5000 + "]" * 5000,
    "a deep table": "boundary.0.uy=" + "{a=" * 30 + "1" + "}" * 30,
    "a key with an escape": "a\x1b=1",
    "a value with a zero": "SPECIMEN.E=\x00",
    "a value of 6000 digits": "options.alpha=" + "9" * 6000,
    "a power of zero": "sets.A.where=0 ** -1 > x",
}
