"""The true state of a virtual test: body, motion of its ends, camera, light and force.

A scene is a strip with a hole between two grips. It starts as the user's model and is changed by the effects of
`effects`; `solve` and `calculix`, in the same folder, compute its motion and force.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from idic.images import Camera
from idic.laws import get_law

THICKNESS_MM = 1.5  # mm
PIXEL_MM = 0.084  # mm
IMAGE_SHAPE_PX = (84, 132)  # px
GRIP_NOISE, FORCE_NOISE = 2e-4, 2e-3  # mm; share of the largest force

TIMES = np.concatenate([np.arange(6.0), [8.0, 11.0], np.arange(12.0, 15.0), [17.0, 20.0], [21.0, 22.0, 23.0]])
UP = np.array([0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.0, 1.0, 0.7, 0.4, 0.1, 0.1, 0.1, 0.5, 0.9, 1.2])  # up, hold, down, up
REVERSED = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.25, 1.25, 0.9, 0.5, 0.1, 0.1, 0.1, -0.3, -0.7, -1.1])
EVEN = np.arange(16.0)  # s: a test at constant speed
RAMP = EVEN / 15.0
RAMP_HOLD = np.minimum(EVEN / 5.0, 1.0)


@dataclass(frozen=True)
class Null:
    """The user's model: its material table, with start values off the truth, and the true values of the same law.

    grip : largest grip motion (mm); courses : of the grip over time, times (s)
    """

    table: str
    law: str
    truth: Mapping[str, float]
    grip: float
    courses: np.ndarray
    times: np.ndarray = field(default_factory=lambda: TIMES)


_BODY = {"E": 2000.0, "nu": 0.35}
_FLOW = _BODY | {"yield_stress": 30.0, "hardening_modulus": 300.0}
_ELASTIC = """law = "elastic"
E = { value = 1800, unit = "MPa", identify = true }
nu = { value = 0.3, identify = true }
"""
_PLASTIC = """law = "j2_linear"
E = { value = 1900, unit = "MPa", identify = true }
nu = { value = 0.33, identify = true }
yield_stress = { value = 28, unit = "MPa", identify = true }
hardening_modulus = { value = 250, unit = "MPa", identify = true }
"""
NULLS = {
    "elastic": Null(_ELASTIC, "elastic", _BODY, 0.1, UP),
    "plastic": Null(_PLASTIC, "j2_linear", _FLOW, 0.16, REVERSED),
    "rubber": Null("""law = "neo_hookean"
C10 = { value = 0.35, unit = "MPa", identify = true }
kappa = { value = 15.0, unit = "MPa", identify = true }
""", "neo_hookean", {"C10": 0.4, "kappa": 20.0}, 2.0, UP),
    "held": Null("""law = "elastic"
E = { value = 1800, unit = "MPa", identify = true }
nu = 0.30
""", "elastic", {"E": 2000.0, "nu": 0.30}, 0.1, UP),
    "known": Null("""law = "elastic"
E = { value = 2000, unit = "MPa" }
nu = { value = 0.3, identify = true }
""", "elastic", _BODY, 0.12, RAMP, EVEN),
    "ramp": Null(_ELASTIC, "elastic", _BODY, 0.12, RAMP, EVEN),
    "ramp_hold": Null(_ELASTIC, "elastic", _BODY, 0.12, RAMP_HOLD, EVEN),
    "plastic_ramp": Null(_PLASTIC, "j2_linear", _FLOW, 0.2, RAMP, EVEN),
}


@dataclass(frozen=True)
class Geometry:
    """A specimen along x, mm: a strip with a central hole, or a kind of `idic_studies.trial.scenes.specimens`.

    radius : of the hole, or of another feature of this kind; concentration : largest strain over that of the ends
    """

    length: float = 10.0
    width: float = 6.0
    radius: float = 1.0
    kind: str = "hole"
    concentration: float = 3.0


@dataclass(frozen=True)
class View:
    """What the camera sees, the origin of the specimen at its centre: shape (rows, columns) px, pixel (mm)."""

    shape: tuple[int, int] = IMAGE_SHAPE_PX
    pixel: float = PIXEL_MM

    @property
    def centre_px(self) -> np.ndarray:
        """Column and row."""
        return np.array([(self.shape[1] - 1) / 2, (self.shape[0] - 1) / 2])


@dataclass(frozen=True)
class Scene:
    """The truth of one test.

    Attributes
    ----------
    null : key of `NULLS`; geometry; times (T,) s; grip (T,) mm true motion of the right end along x
    law, values, kinematics : of the body ("small", "finite" or None: the law's own)
    motion : {(set, component): (T, n) mm} coefficients of 1, y, y^3 (y over half the width), added to the programme
    modulus : factor of all stiffness at points (n, 2) mm, None: 1
    warmth : (T, n) free expansion at points (n, 2) mm, None: none
    slit : mm from the hole's edge upwards at x = 0, 0: none
    camera : (camera, frame) -> camera; image : (clean image, frame, rng) -> image; warp : (n, 2) px and frame -> (n, 2)
        px, the point that a pixel shows
    force : (T,) -> (T,) shown by the load cell; late : s by which the log lags; compliance : mm/N of the machine, in
        the log
    view, thickness (mm); along : direction of the grip; solid : bricks of this thickness, finite strains; finite : the
        user's elastic law is one of finite strains; noise : key of `recording.NOISES`
    """

    null: str
    geometry: Geometry
    times: np.ndarray
    grip: np.ndarray
    law: str
    values: Mapping[str, float]
    kinematics: str | None = None
    motion: Mapping[tuple[str, str], np.ndarray] = field(default_factory=dict)
    modulus: Callable[[np.ndarray], np.ndarray] | None = None
    warmth: Callable[[np.ndarray], np.ndarray] | None = None
    slit: float = 0.0
    camera: Callable[[Camera, int], Camera] | None = None
    image: Callable[[np.ndarray, int], np.ndarray] | None = None
    warp: Callable[[np.ndarray, int], np.ndarray] | None = None
    force: Callable[[np.ndarray], np.ndarray] | None = None
    late: float = 0.0
    compliance: float = 0.0
    view: View = View()
    thickness: float = THICKNESS_MM
    along: str = "x"
    solid: bool = False
    finite: bool = False
    noise: str = "white"

    @property
    def peak_strain(self) -> float:
        """Largest strain of the test, about."""
        return self.geometry.concentration * float(np.abs(self.grip).max()) / self.geometry.length

    @property
    def has_finite_strains(self) -> bool:
        """Whether the body strains finitely: in bricks, and in plane stress under a law that knows nothing else."""
        return self.solid or (self.kinematics or get_law(self.law).kinematics[0]) == "finite"

    @property
    def user_has_small_strains(self) -> bool:
        """Whether the user's law is one of small strains."""
        return get_law(NULLS[self.null].law).kinematics[0] == "small" and not self.finite

    def moved(self, nodes: str, component: str, *terms: np.ndarray) -> Scene:
        """The scene with further motion of an end: courses (T,) mm of 1, y, y^3."""
        added = np.zeros((len(self.times), 3))
        for k, term in enumerate(terms):
            added[:, k] = term
        present_motion = self.motion.get((nodes, component), 0.0)
        return replace(self, motion={**self.motion, (nodes, component): present_motion + added})

    def end_motion(self, nodes: str, component: str, y: np.ndarray) -> np.ndarray:
        """Displacement of points of an end at heights y (mm)  # (T, n) mm"""
        eta = y / (0.5 * self.geometry.width)
        displacement = np.zeros((len(self.times), len(y)))
        if (nodes, component) == ("RIGHT", self.along):
            displacement += self.grip[:, None]
        terms = self.motion.get((nodes, component))
        return displacement if terms is None else displacement + terms @ np.array([np.ones_like(eta), eta, eta**3])


def plain_scene(null: str, geometry: Geometry, values: Mapping[str, float], grip: float = 1.0) -> Scene:
    """A test without effects; values : true parameters; grip : factor of the motion."""
    belief = NULLS[null]
    return Scene(null, geometry, belief.times, grip * belief.grip * belief.courses, belief.law, dict(values))


def loading(scene: Scene) -> np.ndarray:
    """Course of the programme, 1 at its largest  # (T,)"""
    return scene.grip / np.abs(scene.grip).max()


def elapsed(scene: Scene) -> np.ndarray:
    """Time over the duration of the test  # (T,)"""
    return (scene.times - scene.times[0]) / (scene.times[-1] - scene.times[0])
