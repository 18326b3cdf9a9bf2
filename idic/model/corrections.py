"""Corrections of the logged motion of a grip: slip, rotation, compliance, seating, misalignment, shape.

A correction adds ``amplitude * course(t) * pattern(X)`` to a prescribed displacement; the amplitude is the degree of
freedom ``boundary.SET.COMPONENT.KIND``, zero where the log is right:

    slip          mm       1 at the end of the course: the specimen has moved so much less than the log says
    compliance    mm/N     the machine's own deflection is in the log: u = u_log - C F, F a measured column
    seating       mm       grips settle under the first load: u = u_log - s (1 - exp(-|F| / F_seated))
    rotation      rad/mm   the set turns about its middle in proportion to the motion
    misalignment  -        the set moves across, too, in proportion to the motion
    shape         mm       the set moves by a Legendre polynomial along its longest extent, in proportion to the motion:
                           ``shape0`` as a whole, ``shape1`` linear, ``shape2`` bent, ...; mm at the largest motion

Slip, rotation, misalignment and shape may have an identified time course (`idic.model.free_course`).

Rotation, misalignment and shape may follow a column of the log, or begin at a time with a course of their own; the
amplitude (rad, mm) is then that at the column's largest value, or at the end of the course. At a set that is held at a
fixed value, slip, seating and compliance count along the axis.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import legendre

from idic.errors import InputError
from idic.fe import Mesh
from idic.model.experiment import Column, Correction, Drive
from idic.parameters import Parameter

COMPONENTS = "xyz"
LEVERS = {"x": ("y", -1.0), "y": ("x", 1.0), "z": ("x", 1.0)}  # small rotation: u_x = -w y, u_y = w x


def corrections_of(drive: Drive) -> tuple[Correction, ...]:
    """The corrections that a drive has; only logged motions and fixed values have any."""
    return getattr(drive, "corrections", ())


def pattern(correction: Correction, mesh: Mesh, nodes: np.ndarray, component: str) -> tuple[str, np.ndarray]:
    """The component that a correction moves and its pattern on the nodes of the set  # "x", (n,)

    The lever of a rotation is the distance (mm) from the middle between the outermost nodes of the set.
    """
    if correction.kind == "misalignment":
        return correction.towards or ("y" if component == "x" else "x"), np.ones(len(nodes))
    if correction.degree is not None:
        return component, legendre.legval(_places(mesh, nodes), np.eye(correction.degree + 1)[-1])
    if correction.kind != "rotation":
        return component, np.ones(len(nodes))
    along, sign = LEVERS[component]
    place = mesh.nodes[nodes, COMPONENTS.index(along)]
    return component, sign * (place - 0.5 * (place.min() + place.max()))


def _places(mesh: Mesh, nodes: np.ndarray) -> np.ndarray:
    """Along the axis of the longest extent of a set, -1 and 1 at its outermost nodes  # (n,)"""
    at = mesh.nodes[nodes]
    along = at[:, int(np.argmax(np.ptp(at, axis=0)))]
    half = 0.5 * float(np.ptp(along))
    return (along - along.min()) / half - 1.0 if half > 0.0 else np.zeros(len(nodes))


def correction_parameter(stem: str, correction: Correction, pixel_size: float) -> Parameter:
    """The amplitude as a degree of freedom; a unit of its scale moves the set by ten pixels at most (mm per px)."""
    reach = correction.reach * float(np.abs(correction.course).max(initial=0.0))
    return Parameter(f"{stem}.{correction.name}", 0.0, correction.unit, True, scale=10.0 * pixel_size / (reach or 1.0))


def reach(correction_kind: str, mesh: Mesh, nodes: np.ndarray, component: str) -> float:
    """Largest value of the pattern: half the length of the set for a rotation, else 1.

    Raises
    ------
    InputError
        If the set is a point as far as a rotation goes.
    """
    if correction_kind != "rotation":
        return 1.0
    along = LEVERS[component][0]
    half = 0.5 * float(np.ptp(mesh.nodes[nodes, COMPONENTS.index(along)]))
    if half <= 0.0:
        raise InputError("a node set that cannot rotate", key="corrections",
                         expected=f"a node set with an extent along {along}, for a rotation seen in u{component}",
                         found="all its nodes in one place",
                         remedy="leave the rotation out, or correct the other component")
    return half


def slip_course(times: np.ndarray, start: float, shape: str, motion: np.ndarray) -> np.ndarray:
    """Course of a slip that begins after `start` (s), 1 at its end  # (n_frames,)

    shape : "ramp" grows evenly in time, "jump" is there at once, "travel" grows with the way that the log covers.
    """
    is_slipping = times > start
    if shape == "jump":
        return is_slipping.astype(float)
    if shape == "ramp":
        return np.where(is_slipping, times - start, 0.0) / max(float(times[-1] - start), 1e-300)
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(motion)))])
    distance = np.maximum(way - np.interp(start, times, way), 0.0)
    return distance / max(float(distance[-1]), 1e-300)


def end_sign(drive: Column) -> float:
    """Sign of the logged motion where it is largest; +1 for none."""
    return float(np.sign(drive.values[np.argmax(np.abs(drive.values))])) or 1.0


def along_the_motion(drive: Column, values: np.ndarray) -> float:
    """+1 where `values` (n_frames,) has the sign of the motion where the motion is largest, -1 where not."""
    return float(np.sign(values[np.argmax(np.abs(drive.values))])) * end_sign(drive) or 1.0
