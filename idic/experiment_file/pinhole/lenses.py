"""The cameras with a lens of an experiment file: calibration, pose of the mesh, deviations as priors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.linalg import block_diag

from idic.errors import InputError
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.experiment_file.schema.cameras import CameraTable
from idic.experiment_file.pinhole.alignment import Clicks, aligned
from idic.fe import Mesh
from idic.images import LENS_PARAMETERS, LensCamera, PlacedCamera
from idic.parameters import JointPrior, Parameter
from idic.readers import CameraRig, Conventions, existing_file, read_calibration


@dataclass(frozen=True, eq=False)
class Lenses:
    """The cameras with a lens of an experiment, one entry per [[camera]] table; None where that one is telecentric.

    cameras : with the place of the mesh; sizes : (width, height) px that the calibration is of, None where not known;
    prior : of the calibrated values by the names of their degrees of freedom, None without deviations; freed : names
    that ``identify_calibration`` makes degrees of freedom; notes : what was assumed; placement_prior : of
    ``placement.*`` where the images showed the place
    """

    cameras: tuple[PlacedCamera | None, ...] = ()
    sizes: tuple[tuple[int, int] | None, ...] = ()
    prior: JointPrior | None = None
    freed: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    placement_prior: JointPrior | None = None

    def about(self, pivot_mm: np.ndarray) -> Lenses:
        """The same, turning about a point of the mesh frame."""
        return replace(self, cameras=tuple(camera and replace(camera, pivot_mm=pivot_mm) for camera in self.cameras))


def camera_tables(config: ExperimentFile) -> list[CameraTable]:
    """All camera tables, the main one first."""
    return [config.camera or CameraTable(), *config.further_cameras]


def has_lens(config: ExperimentFile) -> bool:
    """Whether any camera has a lens."""
    return any(table.lens for table in camera_tables(config))


def calibration_files(config: ExperimentFile, folder: Path) -> list[Path]:
    """The calibration files."""
    return [folder / name for name in dict.fromkeys(t.calibration for t in camera_tables(config) if t.calibration)]


def calibrations(config: ExperimentFile, folder: Path, file) -> dict[str, CameraRig]:
    """The calibration files of the pinhole cameras by their names in the tables.

    Raises
    ------
    InputError
        A pinhole camera of images that are not grey, or a file that is no calibration.
    """
    if has_lens(config) and config.experiment.quantity != "grey":
        raise InputError("a pinhole camera of images that are not grey", file=file, key="camera.model",
                         expected='quantity = "grey"', found=config.experiment.quantity,
                         remedy='use model = "telecentric"')
    tables, rigs = camera_tables(config), {}
    for i, table in enumerate(tables):
        if table.lens and table.calibration is not None and table.calibration not in rigs:
            path = existing_file(folder, table.calibration, file=file, key=_key(tables, i, "calibration"))
            rigs[table.calibration] = read_calibration(path,
                                                       Conventions(**table.calibration_conventions.model_dump()))
    return rigs


def lenses(config: ExperimentFile, rigs: Mapping[str, CameraRig], file) -> Lenses:
    """The lenses of the tables, and the place of the mesh before them.

    rigs : the calibration files by their names

    Raises
    ------
    InputError
        A file holds no such camera, cameras have no common frame, a pose is missing, or clicked points contradict it.
    """
    if not has_lens(config):
        return Lenses(tuple(None for _ in camera_tables(config)), tuple(None for _ in camera_tables(config)))
    return _LensTables(config, rigs, file).lenses()


def _key(tables: Sequence[CameraTable], i: int, name: str = "") -> str:
    stem = "camera" if len(tables) == 1 else f"camera[{i}]"
    return f"{stem}.{name}" if name else stem


class _LensTables:
    """The tables of one experiment file."""

    def __init__(self, config: ExperimentFile, rigs: Mapping[str, CameraRig], file):
        self.config, self.file = config, file
        self.tables = camera_tables(config)
        self.rigs = {name: rig.in_frame_of(0) for name, rig in rigs.items()} if self._is_placed() else dict(rigs)

    def lenses(self) -> Lenses:
        placed = self._is_placed()
        numbers = [self._number(i) for i in range(len(self.tables))]
        lens = [self._lens(i, placed) for i in range(len(self.tables))]
        rotation, shift, notes = self._place(lens)
        cameras = []
        for i, table in enumerate(self.tables):
            if lens[i] is not None and table.rotation is not None:  # its own pose, from the mesh frame
                camera = lens[i].placed(table.rotation, table.translation_mm)
                turn = camera.rotation @ rotation.T
                lens[i] = camera.placed(turn, camera.translation_mm - turn @ shift)
            cameras.append(None if lens[i] is None else PlacedCamera(lens[i], rotation, shift))
        sizes = tuple(None if number is None else self._rig(i).image_size_px[number]
                      for i, number in enumerate(numbers))
        prior = self._prior(numbers, cameras)
        freed = () if prior is None else tuple(
            name for name in prior.names
            for table in self.tables if table.identify_calibration and name.startswith(f"{table.name}."))
        if any(table.identify_calibration for table in self.tables) and not freed:
            raise InputError("a calibration without deviations", file=self.file, key="camera.identify_calibration",
                             expected="a file with the covariance of its values, as idic calibrate writes it",
                             found="values alone",
                             remedy="leave identify_calibration out, and give [[dof]] with a prior")
        return Lenses(tuple(cameras), sizes, prior, freed, tuple(notes))

    def _is_placed(self) -> bool:
        """Whether a pose of the mesh is given: then the frame of the calibration is that of camera 0."""
        return any(table.rotation is not None or table.alignment is not None for table in self.tables)

    def key(self, i: int, name: str = "") -> str:
        return _key(self.tables, i, name)

    def _number(self, i: int) -> int | None:
        """Which camera of its calibration file a table is."""
        table = self.tables[i]
        if table.lens is None or table.calibration is None:
            return None
        stated_number = table.calibration_camera
        number = stated_number if stated_number is not None else sum(
            earlier.calibration == table.calibration for earlier in self.tables[:i])
        n = len(self._rig(i).cameras)
        if number >= n:
            raise InputError("no such camera in the calibration", file=self.file, key=self.key(i, "calibration_camera"),
                             expected=f"0 … {n - 1}", found=str(number), remedy="correct the number, or the file")
        return number

    def _rig(self, i: int) -> CameraRig:
        return self.rigs[self.tables[i].calibration]

    def _lens(self, i: int, placed: bool) -> LensCamera | None:
        """The lens with the pose of its calibration, values of the table in the place of the file's."""
        table, number = self.tables[i], self._number(i)
        if table.lens is None:
            return None
        values = {}
        for name in table.lens.intrinsics:
            key = name if name in table.lens.coefficients else f"{name}_px"
            if key in table.model_fields_set and getattr(table, key) is not None:
                values[name] = float(getattr(table, key))
        if number is not None:
            return self._rig(i).cameras[number].with_parameters(values)
        if table.rotation is None and not (placed and self._single()):
            file = ", or a calibration file with a pose" if table.lens.is_calibrated else ""
            raise InputError(f"a {table.model} camera without a pose", file=self.file, key=self.key(i, "rotation"),
                             expected=f"rotation and translation_mm, or an alignment{file}",
                             found="none of them", remedy="say where the mesh is before this camera")
        return table.lens(**values)

    def _single(self) -> bool:
        return sum(table.lens is not None for table in self.tables) == 1

    def _place(self, lens: Sequence[LensCamera | None]) -> tuple[np.ndarray, np.ndarray, list[str]]:
        """Rotation and translation from the mesh frame to that of the calibration, and notes."""
        self._check_common_frame()
        for camera, table in zip(lens, self.tables, strict=True):
            if camera is not None and table.rotation is not None:
                posed_camera = camera.placed(table.rotation, table.translation_mm)  # checks the matrix
                return (camera.rotation.T @ posed_camera.rotation,
                        camera.rotation.T @ (posed_camera.translation_mm - camera.translation_mm), [])
        clicks = [Clicks(self.key(i, "alignment"), camera, np.array([[*p, 0.0][:3] for p in table.alignment.points_mm]),
                         np.array(table.alignment.points_px))
                  for i, (camera, table) in enumerate(zip(lens, self.tables, strict=True))
                  if camera is not None and table.alignment is not None and table.alignment.points_mm]
        if any(table.alignment is not None and table.alignment.by_images for table in self.tables):
            return np.eye(3), np.zeros(3), []  # `placed_lenses` looks at the images
        if clicks:
            return aligned(clicks, self.file)
        return np.eye(3), np.zeros(3), ["the mesh is in the frame of the calibration: no alignment, no rotation given"]

    def _check_common_frame(self) -> None:
        files = {table.calibration for table in self.tables if table.lens and table.rotation is None}
        if len(files) > 1:
            raise InputError("cameras of different calibrations have no common frame", file=self.file,
                             key=self.key(1, "calibration"), expected="one file for all cameras, or rotation and "
                             "translation_mm of each", found=", ".join(str(name) for name in sorted(map(str, files))),
                             remedy="calibrate the cameras together")

    def _prior(self, numbers: Sequence[int | None], cameras: Sequence[PlacedCamera | None]) -> JointPrior | None:
        """The covariances of the calibration files in the names of the degrees of freedom; files know nothing of each
        other."""
        names: list[str] = []
        mean, blocks = [], []
        for file, rig in self.rigs.items():
            if rig.covariance is None:
                continue
            stems = {number: (table, camera)
                     for table, number, camera in zip(self.tables, numbers, cameras, strict=True)
                     if number is not None and table.calibration == file}
            rows = []
            for k, name in enumerate(rig.names):
                number, _, parameter = name.partition(".")
                if int(number) not in stems or parameter not in LENS_PARAMETERS or not rig.covariance[k, k] > 0.0:
                    continue  # not of these cameras, or held
                table, camera = stems[int(number)]
                if camera is None or (table.rotation is not None and parameter not in camera.lens.intrinsics):
                    continue  # a pose of its own
                rows.append(k)
                names.append(f"{table.name}.{parameter}")
                mean.append(camera.lens.values()[parameter])
            blocks.append(rig.covariance[np.ix_(rows, rows)])
        return JointPrior(tuple(names), np.array(mean), block_diag(*blocks)) if names else None


def check_image(camera: PlacedCamera, calibrated_size: tuple[int, int] | None, shape: tuple[int, int], key: str,
                file) -> None:
    """InputError where the images have another size than those of the calibration.

    Where the file does not tell a size, the principal point must lie in the image.
    """
    ny, nx = shape
    if calibrated_size is not None and tuple(calibrated_size) != (nx, ny):
        raise InputError("the calibration is of images of another size", file=file, key=f"{key}.calibration",
                         expected=f"{calibrated_size[0]} x {calibrated_size[1]} px, as the calibration",
                         found=f"images of {nx} x {ny} px",
                         remedy="name the images that belong to it; of cropped images, give cx_px, cy_px minus the "
                                "crop and a file without the size")
    lens = camera.lens
    if calibrated_size is None and not (0.0 <= lens.cx <= nx - 1 and 0.0 <= lens.cy <= ny - 1):
        raise InputError("the principal point lies outside the image", file=file, key=f"{key}.cx_px",
                         expected=f"columns 0 … {nx - 1}, rows 0 … {ny - 1}",
                         found=f"({lens.cx:.1f}, {lens.cy:.1f}) px",
                         remedy="check that the calibration is of images of this size")


def middle_of(mesh: Mesh) -> np.ndarray:
    """Middle of the bounding box of a mesh, z = 0 of a plane one  # (3,) mm"""
    middle = 0.5 * (mesh.nodes.min(axis=0) + mesh.nodes.max(axis=0))
    return np.append(middle, np.zeros(3 - len(middle)))


def joint_priors(lens: Lenses, parameters: Sequence[Parameter]) -> tuple[JointPrior, ...]:
    """The deviations of calibration and placement, less the values that have a prior of their own."""
    names_with_prior = {p.name for p in parameters if p.prior_std}
    priors = []
    for prior in (lens.prior, lens.placement_prior):
        if prior is not None:
            keep = [i for i, name in enumerate(prior.names) if name not in names_with_prior]
            priors.append(JointPrior(tuple(prior.names[i] for i in keep), prior.mean[keep],
                                     prior.covariance[np.ix_(keep, keep)]))
    return tuple(priors)
