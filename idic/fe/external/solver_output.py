"""The output of an external solver: displacements of all nodes and forces on node sets, at the times of the frames.

Readers take what they find; `gathered` then requires every frame, every node and finite values. An incomplete output is
`NotConverged`: parameters for which the solver stops halfway leave one.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from idic.errors import NotConverged
from idic.input_decks import fortran_real

READERS: dict[str, Callable[[Path, str], Records]] = {}
MAX_TIME_MISMATCH = 2e-5  # of the last time: the files hold five to seven digits
MAX_SHARE_OF_INTERVAL = 0.5  # of the shortest time between frames: a record further away may be of the next one
MAX_DISPLACEMENT_AT_REFERENCE = 1e-3  # of the largest: the reference is undeformed
MAX_REPEATED_CHANGE = 1e-3  # of the largest value: a step may repeat the last frame of the step before
MIN_FOLLOWED, MAX_FOLLOWED = 0.02, 5.0  # of a prescribed motion: what the solver moves its set by
MIN_COMPARED_MOTION = 1e-3  # of the largest motion: a file of a few decimals rounds smaller ones to zero
FRD_READER = "calculix_frd"  # its name in experiment.toml
LOCAL_MARK = "L"  # of CalculiX, at the end of a row in the axes of a *TRANSFORM
MAX_DISPLACEMENT_RATIO = 100.0  # displacements beyond so many times the size of the mesh are rejected


@dataclass(frozen=True)
class Records:
    """Raw content of the files, each under its time (or frame number).

    motions : time -> (labels (n,), displacements (n, 2 or 3)); forces : time -> {"SET.x": value}, N;
    nodal_forces : time -> (labels, forces); by_frame : the keys are frame numbers, whatever the clock of the deck.
    """

    motions: dict[float, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    forces: dict[float, dict[str, float]] = field(default_factory=dict)
    nodal_forces: dict[float, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    by_frame: bool = False


@dataclass(frozen=True)
class ExpectedOutput:
    """What a simulation has to deliver.

    labels (n_nodes,), dim; times (n_frames - 1,) of the frames after the reference; sets {name: node indices} whose
    forces are compared, as names ``SET.x``; size : of the mesh, mm; motions : of the sets whose motion is prescribed,
    name -> (degrees of freedom, node * dim + component; their motion (n_frames,) mm).
    """

    labels: np.ndarray
    dim: int
    times: np.ndarray
    forces: tuple[str, ...]
    sets: Mapping[str, np.ndarray]
    size: float
    motions: Mapping[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)


@dataclass(frozen=True)
class Solution:
    """u (n_frames, n_nodes, dim) mm, the reference at rest first; forces {"SET.x": (n_frames,)} N."""

    u: np.ndarray
    forces: Mapping[str, np.ndarray]


def gathered(reader: str, folder: Path, job: str, expected: ExpectedOutput) -> Solution:
    """Read and check the files of a finished simulation.

    Raises
    ------
    NotConverged
        A file, a frame, a node or a force is missing, a node has two values in one frame, the frames are counted
        otherwise, the reference is deformed, a prescribed motion is not followed, or a value is not finite or absurdly
        large.
    """
    try:
        records = READERS[reader](folder, job)
    except (OSError, ValueError, IndexError, KeyError, UnicodeDecodeError) as problem:
        raise NotConverged(f"the output of the solver cannot be read: {problem}") from None
    if records.by_frame:
        expected = replace(expected, times=np.arange(1.0, len(expected.times) + 1.0))
    u = np.zeros((len(expected.times) + 1, len(expected.labels), expected.dim))
    forces = {name: np.zeros(len(expected.times) + 1) for name in expected.forces}
    for frame, time in enumerate(expected.times, 1):
        u[frame] = _nodal(_at(records.motions, time, expected, "displacements"), expected, "displacements")
        for name in expected.forces:
            forces[name][frame] = _force(records, name, time, expected)
    _check_values(u, forces, expected)
    _check_reference(records, u, expected)
    _check_motions(u, expected)
    return Solution(u, forces)


def _at(records: Mapping, time: float, expected: ExpectedOutput, quantity: str):
    """The record of a frame."""
    keys = np.array(list(records))
    distances = np.abs(keys - time) if len(keys) else np.array([np.inf])
    shortest = np.diff(expected.times, prepend=0.0).min()
    if distances.min() > min(MAX_TIME_MISMATCH * expected.times[-1], MAX_SHARE_OF_INTERVAL * shortest):
        frame = 1 + int(np.searchsorted(expected.times, time))
        raise NotConverged(f"no {quantity} of frame {frame} (time {time:g}); "
                           + (f"the last ones are at {keys.max():g}" if len(keys) else "there are none"))
    return records[float(keys[distances.argmin()])]


def _nodal(record: tuple[np.ndarray, np.ndarray], expected: ExpectedOutput, quantity: str) -> np.ndarray:
    """Values in the order of the mesh  # (n_nodes, dim)"""
    labels, values = record
    compared = np.isin(labels, expected.labels)
    labels, values = labels[compared], values[compared]
    order = np.argsort(labels, kind="stable")
    repeats = np.flatnonzero(np.diff(labels[order]) == 0)
    change = np.abs(values[order[repeats]] - values[order[repeats + 1]]).max(axis=1, initial=0.0)
    if len(twice := repeats[change > MAX_REPEATED_CHANGE * np.abs(values).max(initial=0.0)]):
        raise NotConverged(f"two different {quantity} of node {labels[order[twice[0]]]} at the same time: does every "
                           "step of the solver count its time from 0? Write the time since the reference")
    place = np.searchsorted(labels[order], expected.labels)
    has_value = place < len(labels)
    has_value[has_value] = labels[order][place[has_value]] == expected.labels[has_value]
    if not has_value.all():
        raise NotConverged(f"{quantity} of {int((~has_value).sum())} of {len(has_value)} nodes are missing, "
                           f"first node {expected.labels[~has_value][0]}")
    if values.shape[1] < expected.dim:
        raise NotConverged(f"{quantity} have {values.shape[1]} components, expected {expected.dim}")
    return values[order][place][:, :expected.dim]


def _force(records: Records, name: str, time: float, expected: ExpectedOutput) -> float:
    """A total that was written, else the sum over the nodes of the set."""
    if records.forces or not records.nodal_forces:
        row = _at(records.forces, time, expected, f"force {name}")
        forces = {key.upper(): value for key, value in row.items()}
        if name.upper() not in forces:
            raise NotConverged(f"no force {name} at time {time:g}; there are {', '.join(row) or 'none'}")
        return forces[name.upper()]
    stem, _, component = name.rpartition(".")
    nodal = _nodal(_at(records.nodal_forces, time, expected, "nodal forces"), expected, "nodal forces")
    return float(nodal[expected.sets[stem], "xyz".index(component)].sum())


def _check_values(u: np.ndarray, forces: Mapping[str, np.ndarray], expected: ExpectedOutput) -> None:
    for quantity, values in (("displacement", u), *forces.items()):
        if not np.isfinite(values).all():
            frame = int(np.argwhere(~np.isfinite(values))[0][0])
            raise NotConverged(f"{quantity}: a value that is not finite in frame {frame}")
    if np.abs(u).max() > MAX_DISPLACEMENT_RATIO * expected.size:
        frame = int(np.unravel_index(np.abs(u).argmax(), u.shape)[0])
        raise NotConverged(f"a displacement of {np.abs(u).max():.3g} mm in frame {frame}, "
                           f"on a mesh of {expected.size:.3g} mm")


def _check_reference(records: Records, u: np.ndarray, expected: ExpectedOutput) -> None:
    """Refuse frames that are counted from 1 at the reference, and a reference that is deformed."""
    last_frame, largest = len(u) - 1, np.abs(u).max()
    counted_from_1 = records.by_frame and last_frame > 1 and max(records.motions) == last_frame + 1
    if counted_from_1 and largest > 0.0 and not u[1].any():
        raise NotConverged(f"frames are counted up to {last_frame + 1}, and in frame 1 all is at rest, but frame 1 is "
                           f"the first after the reference and {last_frame} the last: count the reference as 0")
    labels, values = records.motions.get(0.0, (np.zeros(0), np.zeros((0, 2))))
    at_rest = np.abs(values[np.isin(labels, expected.labels), :expected.dim]).max(initial=0.0)
    if at_rest > MAX_DISPLACEMENT_AT_REFERENCE * largest:
        clock = "frame" if records.by_frame else "time"
        raise NotConverged(f"displacements up to {at_rest:.3g} mm at the reference ({clock} 0), where the specimen is "
                           "undeformed: write them relative to the reference")


def _check_motions(u: np.ndarray, expected: ExpectedOutput) -> None:
    """Refuse a solution in which a set stands still, goes the other way or many times as far: other units, axes or
    frames. A smaller difference may be meant, such as a machine that yields."""
    largest = max((float(np.abs(prescribed).max()) for _, prescribed in expected.motions.values()), default=0.0)
    for name, (dofs, prescribed) in expected.motions.items():
        if np.abs(prescribed).max() < MIN_COMPARED_MOTION * largest:
            continue
        frame = int(np.abs(prescribed).argmax())
        mean_motion = u[frame].ravel()[dofs].mean()
        if not MIN_FOLLOWED < mean_motion / prescribed[frame] < MAX_FOLLOWED:
            raise NotConverged(f"{name} moves by {mean_motion:.4g} mm in frame {frame} after the reference, where "
                               f"{prescribed[frame]:.4g} mm are prescribed: the output needs mm, the axes of the mesh "
                               "and the frames of the test")


# CalculiX -----------------------------------------------------------------------------------------
def read_calculix_frd(folder: Path, job: str) -> Records:
    """``JOB.frd`` (ASCII): blocks DISP and FORC of all increments; totals of forces from ``JOB.dat`` where it has some.

    Fixed columns: " -1", a node number of ten digits, numbers of twelve (CalculiX CrunchiX manual, "Results").
    """
    records, block, time, kind, nodes, rows = Records(), False, 0.0, "", [], []
    with (folder / f"{job}.frd").open(encoding="ascii", errors="replace") as file:
        for line in file:
            if line.startswith(" -1") and block:
                nodes.append(int(line[3:13]))
                rows.append([float(line[k:k + 12]) for k in range(13, min(len(line.rstrip("\n")), 49), 12)])
            elif line.startswith("  100C"):
                time, block = float(line[12:24]), False
            elif line.startswith(" -4"):
                kind = line.split()[1]
                block, nodes, rows = kind in ("DISP", "FORC"), [], []
            elif line.startswith(" -3") and block:
                target = records.motions if kind == "DISP" else records.nodal_forces
                target[time] = (np.array(nodes, dtype=np.int64), np.array(rows, dtype=float))
                block = False
    if (folder / f"{job}.dat").exists():
        records.forces.update(read_calculix_dat(folder, job).forces)
    return records


def read_calculix_dat(folder: Path, job: str) -> Records:
    """``JOB.dat``: displacements of `*NODE PRINT, NSET=...` with U, total forces of RF with TOTALS=ONLY (or YES)."""
    records, rows, labels, target = Records(), [], [], None
    motions: dict[float, tuple[list[int], list[list[float]]]] = {}
    with (folder / f"{job}.dat").open(encoding="ascii", errors="replace") as file:
        for line in file:
            words = line.split()
            if not words:
                continue
            if words[0][0].isalpha():
                title, time = line.strip().lower(), float(words[-1]) if " time " in line else 0.0
                if title.startswith("displacements"):  # of several sets at one time: all nodes together
                    labels, rows = motions.setdefault(time, ([], []))
                    target = (time, labels, rows)
                elif title.startswith("total force"):
                    target = (time, words[words.index("set") + 1], None)
                else:
                    target = None
            elif target is not None and target[2] is None:
                set_forces = records.forces.setdefault(target[0], {})
                set_forces.update({f"{target[1]}.{c}": _real(word) for c, word in zip("xyz", words[:3], strict=True)})
            elif target is not None:
                if words[-1] == LOCAL_MARK:
                    raise ValueError(f"node {words[0]} is written in the axes of its *TRANSFORM (L ends the row): "
                                     "write *NODE PRINT with GLOBAL=YES")
                labels.append(int(words[0]))
                rows.append([_real(word) for word in words[1:4]])
    return Records({time: (np.array(nodes, dtype=np.int64), np.array(values, dtype=float))
                    for time, (nodes, values) in motions.items() if nodes}, records.forces)


def _real(word: str) -> float:
    """A number as CalculiX prints it: without the letter where the exponent has three digits, NaN where it diverged."""
    try:
        return float(word)
    except ValueError:
        return fortran_real(word)


def local_output(deck: str) -> str | None:
    """The line of a deck by which CalculiX writes an unmarked ``.frd`` in local axes, or None.

    ``GLOBAL=NO`` of *NODE FILE has this effect on the nodes of a *TRANSFORM (user's manual 2.20, *NODE FILE).
    """
    lines = ["".join(line.upper().split()) for line in deck.splitlines()]
    if not any(line.startswith("*TRANSFORM") for line in lines):
        return None
    return next((line for line in lines if line.startswith(("*NODEFILE", "*NODEOUTPUT")) and "GLOBAL=NO" in line), None)


# plain tables -------------------------------------------------------------------------------------
def read_csv(folder: Path, job: str) -> Records:
    """``displacements.csv`` (time or frame, node, ux, uy[, uz]) and, where forces are compared, ``forces.csv`` (time or
    frame, SET.x, ...); frames count from 1, the first one after the reference."""
    clock, table = _table(folder / "displacements.csv")
    names = [name for name in ("node", "ux", "uy", "uz") if name in table]
    if names[:3] != ["node", "ux", "uy"]:
        raise ValueError(f"displacements.csv has the columns {', '.join(table)}, expected {clock}, node, ux, uy(, uz)")
    rows = np.array([table[name] for name in names]).T
    times, first = np.unique(table[clock], return_inverse=True)
    motions = {float(time): (rows[first == k, 0].astype(np.int64), rows[first == k, 1:])
               for k, time in enumerate(times)}
    forces = {}
    if (folder / "forces.csv").exists():
        force_clock, totals = _table(folder / "forces.csv")
        if force_clock != clock:
            raise ValueError(f"displacements.csv counts by {clock}, forces.csv by {force_clock}")
        _check_repeated(totals, force_clock)
        forces = {float(time): {name: column[k] for name, column in totals.items() if name != clock}
                  for k, time in enumerate(totals[clock])}
    return Records(motions, forces, by_frame=clock == "frame")


def _check_repeated(totals: Mapping[str, np.ndarray], clock: str) -> None:
    """Refuse two different forces at one time."""
    order = np.argsort(totals[clock], kind="stable")
    repeats = np.flatnonzero(np.diff(totals[clock][order]) == 0)
    for name, column in totals.items():
        changes = np.abs(np.diff(column[order])[repeats])
        if len(twice := repeats[changes > MAX_REPEATED_CHANGE * np.abs(column).max()]):
            raise ValueError(f"forces.csv has two different {name} at {clock} {totals[clock][order[twice[0]]]:g}")


def _table(path: Path) -> tuple[str, dict[str, np.ndarray]]:
    """The clock ("time" or "frame") and the columns of a table of numbers with a header."""
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = [row for row in csv.reader(file) if row]
    names = [name.strip() for name in rows[0]] if rows else []
    clock = next((name for name in ("time", "frame") if name in names), None)
    if clock is None:
        raise ValueError(f"{path.name} has no column time or frame, only {', '.join(names) or 'nothing'}")
    if (cut := next((row for row in rows if len(row) != len(names)), None)) is not None:
        raise ValueError(f"{path.name} has {len(names)} columns, but {len(cut)} cells in the row {','.join(cut)[:80]}")
    values = np.array([[float(cell) for cell in row] for row in rows[1:]]).reshape(-1, len(names))
    return clock, dict(zip(names, values.T, strict=True))


READERS.update({FRD_READER: read_calculix_frd, "calculix_dat": read_calculix_dat, "csv": read_csv})
