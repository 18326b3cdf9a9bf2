"""The tables of an experiment on its recording: the model is made of both, and no file is opened."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from idic.errors import InputError
from idic.experiment_file.checks.images_at_rest import with_notes_on_references
from idic.experiment_file.checks.model import (check_materials, check_supported, check_times, check_visible,
                                               checked_heights)
from idic.experiment_file.cracks import cracks, cut_mesh
from idic.experiment_file.laws.composed_law import course_notes
from idic.experiment_file.laws.free_curves import free_curves, knot_notes, smoothness_priors
from idic.experiment_file.laws.softening import softening_notes
from idic.experiment_file.laws.spectrum import spectrum_notes
from idic.experiment_file.measured_fields.noise import noise_of_fields, with_depth
from idic.experiment_file.pinhole.lenses import Lenses, camera_tables, joint_priors
from idic.experiment_file.pinhole.pairing import pairing_notes
from idic.experiment_file.placed_mesh import PlacedMesh, placed_mesh
from idic.experiment_file.recording import Frames, RecordedFiles
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.experiment_file.tables import boundaries as boundary_tables, dofs
from idic.experiment_file.tables.camera_motion import moving_camera, with_identified_motions
from idic.experiment_file.tables.camera_noise import camera_noise, with_stabilised_images
from idic.experiment_file.tables.further_cameras import further_cameras
from idic.experiment_file.tables.gauges import gauges
from idic.experiment_file.tables.geometry import geometry_of
from idic.experiment_file.tables.heterogeneities import heterogeneities
from idic.experiment_file.tables.lengths import Lengths
from idic.experiment_file.tables.mesh_on_image import arcs_of, outline_share
from idic.experiment_file.tables.mesh_sets import with_element_set, with_joined_sets
from idic.experiment_file.tables.solver import EXTERNAL_PERTURBATION, check_external_laws, solver_notes
from idic.experiment_file.tables.temperatures import Body, knots_of_temperature, temperatures
from idic.experiment_file.toml_file import validated, with_overrides
from idic.experiment_file.volumes.scan_noise import scan_noise
from idic.experiment_file.volumes.scanner_table import check_in_volume
from idic.fe import Mesh, curved, raise_order
from idic.images import AnyCamera, Camera, SCANNER, Scanner, mirrored_rim_px
from idic.model import (
    Column, Experiment, FieldPoints, FurtherCamera, Material, Model, Noise, Options, Prescribed, Recording,
    Remedies, Stage,
)
from idic.parameters import Parameter, ParameterSet
from idic.readers import FieldStack, MatchedLog

LINEAR_AS_GIVEN = "elements are linear, as given: they are too stiff, and the parameters absorb most of that error"
_HEIGHT_MM = {"m": 1e3, "mm": 1.0, "um": 1e-3, "nm": 1e-6}


@dataclass(frozen=True, eq=False)
class ExperimentTables:
    """The tables of an experiment file and the recording that they are about.

    file : that messages name; raw : the tables; config : the same, validated; placed : the mesh on the images
    original : the experiment before an edit, whose noise and points are those of the recording; None where the images
        are still to be looked at
    """

    file: Path
    raw: Mapping
    config: ExperimentFile
    recording: RecordedFiles
    placed: PlacedMesh
    original: Experiment | None = None

    @classmethod
    def of(cls, file: Path, raw: Mapping, config: ExperimentFile, recording: RecordedFiles) -> ExperimentTables:
        """The tables on a recording; InputError where the mesh does not fit its images."""
        return cls(file, raw, config, recording, placed_mesh(config, recording, file))

    def edited(self, edits: Mapping[str, Any], original: Experiment) -> ExperimentTables:
        """The tables with edits, on the same recording.

        Parameters
        ----------
        edits : dotted keys, as `load_experiment` takes them
        original : the experiment of this recording without them, with its noise

        Raises
        ------
        InputError
            A key that does not exist, a value that it does not take, or another number of cameras.
        """
        raw = with_overrides(self.raw, edits)
        config = validated(raw, self.file)
        if len(config.further_cameras) != len(self.recording.cameras):
            raise InputError("an edit that adds or removes a camera", file=self.file, key="camera",
                             expected=1 + len(self.recording.cameras), found=1 + len(config.further_cameras),
                             remedy="identify an experiment with these cameras again")
        placed = self.placed if self.placed.is_of(config) else placed_mesh(config, self.recording, self.file)
        return replace(self, raw=raw, config=config, placed=placed, original=original)

    def experiment(self) -> Experiment:
        """The experiment as these tables model it.

        Raises
        ------
        InputError
            At the first table that contradicts another one, the mesh or the recording.
        """
        table, scale = self.config.experiment, self.placed.scale
        recording, frames = self.recording, self.recording.frames
        materials, parameters, mesh, law_notes = self.materials(self.placed.mesh)
        cut = cut_mesh(self.config, mesh, scale.unit, self.file)
        mesh = cut.mesh
        check_external_laws(self.config, self.file)
        log, known_times = recording.log, recording.times
        if log is not None and log.is_interpolated:
            log = replace(log, late=dofs.start_of_time_offset(self.config, self.file))
        curves = free_curves(materials, self.config.material, parameters)
        check_times(materials, known_times, self.file)
        context = boundary_tables.Context(log, known_times, frames.reference, frames.stack.n_frames, scale.unit,
                                          self.file)
        motion = boundary_tables.motion(self.config, mesh, context)
        mesh, lens = motion.mesh, self.placed.lens
        thickness = self.thickness(scale, motion)
        if recording.solver is None:  # else the deck holds the body
            self.check_held(mesh, motion.prescribed)
        if isinstance(scale.camera, Scanner):
            check_in_volume(mesh, scale.camera, frames.shape, self.file)
        else:
            check_visible(mesh, table.kind, table.surface, scale.camera, frames.shape, frames.mask, self.file,
                          fields=frames.points is not None)
        noises = None if self.original is None else [camera.noise for camera in self.original.cameras]
        cameras, camera_notes = further_cameras(self.config, recording.cameras, mesh, scale, frames.stack.n_frames,
                                                frames.still, self.file, lens, noises)
        if self.original is None and not table.volumes:
            camera_notes += pairing_notes(self.config, mesh, scale.camera, frames.stack, cameras, frames.reference,
                                          self.file)
        mesh, order_notes = self.element_order(mesh, scale.camera, frames)
        geometry = geometry_of(mesh, self.config, scale.unit, self.file)
        mesh = geometry.mesh
        varied, of_varied = heterogeneities(self.config, mesh, scale.unit, self.file)
        parameters += of_varied
        cut_open, lengths = cracks(self.config, cut.cuts, context)
        parameters += lengths
        camera, cameras = self._moving(scale.camera, cameras, lens, frames, context, known_times, mesh, thickness)
        parameters += dofs.degrees_of_freedom(self.config, camera, tuple(motion.channels), tuple(motion.prescribed),
                                              thickness, known_times, scale.unit, frames.shape, parameters, self.file,
                                              cameras, geometry.parameters, tuple(motion.loads), lens.freed,
                                              knots_of_temperature(self.config, context, self.file))
        camera, cameras = with_identified_motions(camera, cameras, self.config.camera, parameters)
        times = np.arange(frames.stack.n_frames, dtype=float) if known_times is None else known_times
        body = Body(mesh, table.kind, table.surface, scale, frames.shape, tuple(motion.prescribed), times)
        warmth, warm_notes = temperatures(self.config, body, context, recording.infrared, parameters)
        noise, points, noise_notes = self.noise(frames, mesh, scale)
        model = Model(
            kind=table.kind, mesh=mesh, thickness=thickness, materials=materials,
            parameters=ParameterSet(parameters,
                                    (*joint_priors(lens, parameters), *smoothness_priors(curves, parameters))),
            prescribed=tuple(motion.prescribed), loads=tuple(motion.loads), channels=tuple(motion.channels),
            camera=camera, times=times, reference=frames.reference, has_times=known_times is not None,
            surface=table.surface, symmetry=table.symmetry, length_unit=scale.unit, temperatures=warmth,
            heterogeneities=varied, cracks=cut_open, solver=recording.solver, morphs=geometry.morphs,
            log_offset=0.0 if log is None else log.late,
            stated_values=tuple(entry.name for entry in self.config.dof if entry.value is not None),
            free_curves=curves, outline_share=outline_share(self.config, frames.stack, scale.camera, self.file))
        notes = (*scale.notes, *lens.notes, *camera_notes, *frames.notes, *(log.notes if log is not None else ()),
                 *self.placed.notes, *law_notes, *motion.notes, *order_notes, *geometry.notes, *warm_notes,
                 *solver_notes(recording.solver), *noise_notes, *self.force_notes(parameters, motion),
                 *knot_notes(self.config.material), *course_notes(materials, parameters, _courses(motion)),
                 *spectrum_notes(materials, parameters, known_times),
                 *softening_notes(materials, parameters, mesh, scale.unit))
        experiment = Experiment(
            title=table.title or recording.folder.name, folder=str(recording.folder),
            recording=self.compared(frames, log, noise, points), model=model, cameras=cameras,
            stages=self.stages(parameters, known_times), options=self.options(),
            gauges=gauges(self.config, mesh, scale.unit, scale.camera, self.file), notes=notes,
            setup=self.config.setup.entries, written=Remedies.written(self.raw))
        if self.original is not None:
            return self._on_images_of(self.original, experiment)
        return checked_heights(with_notes_on_references(with_stabilised_images(experiment), self.file), self.file)

    def recorded(self) -> Experiment:
        """The recording and its mesh in the view of the main camera, without law, drive and parameter: what a free
        FE-DIC needs (docs/method.md, equation 13.1).

        Raises
        ------
        InputError
            Images of heights or several cameras, whose motion in space is no motion in one image; a mesh out of view.
        """
        table, scale, frames = self.config.experiment, self.placed.scale, self.recording.frames
        problems = {f"quantity = {table.quantity!r}": table.quantity != "grey",
                    f"{1 + len(self.config.further_cameras)} cameras": bool(self.config.further_cameras)}
        for problem, applies in problems.items():
            if applies:
                raise InputError("no free motion of these images", file=self.file, key="experiment.images",
                                 expected="grey images of one camera", found=problem,
                                 remedy="add a material and a boundary, and identify")
        check_visible(self.placed.mesh, table.kind, table.surface, scale.camera, frames.shape, frames.mask, self.file)
        mesh, order_notes = self.element_order(self.placed.mesh, scale.camera, frames)
        noise, points, noise_notes = self.noise(frames, mesh, scale)
        times = self.recording.times
        model = Model(kind=table.kind, mesh=mesh, thickness=None, materials=(), parameters=ParameterSet(()),
                      prescribed=(), loads=(), channels=(), camera=scale.camera,
                      times=np.arange(frames.stack.n_frames, dtype=float) if times is None else times,
                      reference=frames.reference, has_times=times is not None, surface=table.surface,
                      length_unit=scale.unit)
        return with_stabilised_images(Experiment(
            title=table.title or self.recording.folder.name, folder=str(self.recording.folder),
            recording=self.compared(frames, self.recording.log, noise, points), model=model, options=self.options(),
            notes=(*scale.notes, *frames.notes, *self.placed.notes, *order_notes, *noise_notes),
            written=Remedies.written(self.raw)))

    def _on_images_of(self, original: Experiment, experiment: Experiment) -> Experiment:
        """The edited experiment with the images that the original one compares; it is not stored under a name."""
        cameras = tuple(replace(camera, stack=original_camera.stack)
                        for camera, original_camera in zip(experiment.cameras, original.cameras, strict=True))
        return replace(experiment, recording=replace(experiment.recording, stack=original.recording.stack,
                                                     excluded=original.recording.excluded, identity=""),
                       cameras=cameras)

    def _moving(self, camera: AnyCamera, cameras: tuple[FurtherCamera, ...], lens: Lenses, frames: Frames,
                context: boundary_tables.Context, times: np.ndarray | None, mesh: Mesh,
                thickness: float | None) -> tuple[AnyCamera, tuple[FurtherCamera, ...]]:
        """The cameras with all their motions, or those of the specimen before lenses, every amplitude zero."""
        tables = camera_tables(self.config)
        if frames.points is not None:  # a rigid motion of fields is an unknown of the frame
            tables[0] = tables[0].model_copy(update={"motion": None})
        rigid = next((table for table in tables if table.lens), None)
        compared = [k for k in range(frames.reference + 1, frames.stack.n_frames) if k not in frames.excluded]
        table = self.config.experiment
        is_sheet = mesh.n_dim == 2 and table.surface is None and table.quantity == "grey"
        ends = np.array([mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)]) if is_sheet else None
        moved = [moving_camera(still_camera, rigid if lens.cameras[i] is not None else tables[i], context, times,
                               compared, ends, thickness)
                 for i, still_camera in enumerate([camera, *(view.camera for view in cameras)])]
        return moved[0], tuple(replace(view, camera=moving) for view, moving in zip(cameras, moved[1:], strict=True))

    def noise(self, frames: Frames, mesh: Mesh, scale: Lengths) -> tuple[Noise, FieldPoints | None, tuple[str, ...]]:
        """Noise of the main camera, or of the measured fields; their points, weighed by it; and notes."""
        if self.original is not None:
            return self.original.recording.noise, self.original.recording.points, ()
        if isinstance(scale.camera, Scanner):
            noise, notes = scan_noise(self.config, frames.stack, frames.still, max(len(frames.averaged), 1), mesh,
                                      scale.camera, self.options().interpolation, self.file)
            return noise, None, notes
        if not isinstance(frames.stack, FieldStack) or frames.points is None:
            noise, notes = camera_noise(self.config, frames, mesh, scale.camera, self.file)
            return noise, None, notes
        stack, n_references = frames.stack, max(len(frames.averaged), 1)
        counted = tuple(k for k in range(frames.reference, stack.n_frames) if k not in frames.excluded)
        if frames.recorded is not None:  # stages next to each other show the noise best
            stack, counted = frames.recorded.stack, frames.recorded.counted
        noise = noise_of_fields(self.config, stack, frames.points, counted, counted[0], n_references, self.file)
        if frames.points.depth is None:
            return noise, frames.points, ()
        table = self.config.experiment
        points, note = with_depth(frames.points, noise, stack, counted, counted[0], n_references,
                                  bool(table.fields_thickness_change), table.thickness_mm)
        return noise, points, (note,)

    def compared(self, frames: Frames, log: MatchedLog | None, noise: Noise,
                 points: FieldPoints | None) -> Recording:
        """What the main camera recorded, with its noise."""
        table = self.config.experiment
        stack = frames.stack if points is None else frames.stack.with_components(points.n_components)
        return Recording(
            stack=stack, labels=frames.labels, excluded=frames.excluded, mask=frames.mask,
            voxel_mask=frames.voxel_mask, quantity=table.quantity,
            height_unit=_HEIGHT_MM[table.height_unit] if table.height_unit else 1.0, noise=noise,
            camera_name=SCANNER if table.volumes else self.config.camera.name if self.config.camera else "camera",
            averaged=frames.averaged,
            points=points, still_frames=frames.still, still_stack=frames.still_stack, still_labels=()
            if frames.still_stack is None else frames.still_stack.labels,
            is_log_interpolated=log is not None and log.is_interpolated,
            column_units={} if log is None else {name: log.unit(name) for name in log.names},
            stated_order=frames.stated_order, identity=self.recording.identity)

    def element_order(self, mesh: Mesh, camera: Camera, frames: Frames) -> tuple[Mesh, tuple[str, ...]]:
        """The mesh with the element order of the options, on the arcs of a drawing, and a note if the order was
        raised."""
        order, n = self.config.options.element_order, mesh.n_nodes
        if order == "as_given" or (order == "auto" and not mesh.is_raised_by_default):
            return mesh, (LINEAR_AS_GIVEN,) if mesh.is_raised_by_default else ()
        if not mesh.can_raise_order:
            raise InputError("idic cannot raise the order of these elements", file=self.file,
                             key="options.element_order", expected="a mesh of tri3, quad4, tet4 or hex8 elements",
                             found=", ".join(sorted({block.cell for block in mesh.blocks})),
                             remedy='use element_order = "auto"')
        straight, table = raise_order(mesh), self.config.experiment.mesh
        drawing = None if mesh.n_dim == 3 else arcs_of(self.config, frames.stack, camera, self.file)
        if drawing is not None:
            mesh = drawing.on_arcs(straight, camera if table.in_px else None)
        else:
            mesh = curved(straight)
        bent = int((mesh.nodes != straight.nodes).any(axis=1).sum())
        return mesh, (f"linear elements are computed as quadratic ones ({n} -> {mesh.n_nodes} nodes"
                      + (f", {bent} of them moved onto the arcs of the boundary" if bent else "") + "); "
                      'element_order = "as_given" under [options] keeps them linear',)

    def materials(self, mesh: Mesh) -> tuple[tuple[Material, ...], list[Parameter], Mesh, list[str]]:
        records, parameters, notes = [], [], []
        if not self.config.material:
            raise InputError("a key is missing", file=self.file, key="material", found="no such key",
                             expected="a table [material.SET], or [material.ALL], with its law",
                             remedy="add the table; idic init writes a commented example")
        for name, table in self.config.material.items():
            if table.sets:
                mesh = with_joined_sets(mesh, name, table.sets, self.file, f"material.{name}.sets")
            mesh, note = with_element_set(mesh, name, len(self.config.material) == 1, self.file, f"material.{name}",
                                          self.config.sets)
            record, constants, more = dofs.material(name, table, self.file)
            records.append(record)
            parameters.extend(constants)
            notes.extend(([note] if note else []) + more)
        check_materials(mesh, [record.element_set for record in records], self.file)
        return tuple(records), parameters, mesh, notes

    def thickness(self, scale: Lengths, motion: boundary_tables.Motion) -> float | None:
        table = self.config.experiment
        forced = any(c.kind == "reaction" for c in motion.channels)
        forced = forced or any(load.kind == "force" for load in motion.loads)
        if forced and scale.unit == "px":
            raise InputError("a force without a scale", file=self.file, key="camera.pixel_size_mm",
                             expected="the size of a pixel: stress is force per area", found="lengths in px",
                             remedy="give pixel_size_mm, or leave the force out")
        if table.kind == "solid":
            if table.thickness_mm is not None:
                raise InputError("a solid has its thickness in the mesh", file=self.file, key="experiment.thickness_mm",
                                 expected="no thickness_mm", found=f"{table.thickness_mm:g}",
                                 remedy="leave it out")
            return None
        if forced and table.thickness_mm is None:
            raise InputError("a key is missing", file=self.file, key="experiment.thickness_mm",
                             expected="the thickness: a force is compared or applied", found="no such key",
                             remedy="give the measured thickness in mm" + (", the mean over the deformed part"
                                                         if table.kind == "plane_stress" else ""))
        return table.thickness_mm

    def check_held(self, mesh: Mesh, prescribed: list[Prescribed]) -> None:
        """See `check_supported`; an edit that holds the body as before needs no check."""
        components = {(entry.nodes, entry.component) for entry in prescribed}
        if self.original is None or components != {(entry.nodes, entry.component)
                                                   for entry in self.original.model.prescribed}:
            check_supported(mesh, prescribed, self.file)

    def stages(self, parameters: list[Parameter], times: np.ndarray | None) -> tuple[Stage, ...]:
        names, free_names = {p.name for p in parameters}, [p.name for p in parameters if p.free]
        for number, stage in enumerate(self.config.stage):
            if stage.until_s is not None and times is None:
                raise InputError("a stage in seconds on a test without times", file=self.file,
                                 key=f"stage[{number}].until_s", found=f"{stage.until_s:g} s",
                                 expected="frame_interval_s or image_times in [experiment], or a column time_s in the "
                                 "log", remedy="give the times, or leave until_s out")
            for name in stage.free if isinstance(stage.free, list) else ():
                if name not in free_names:
                    fault = "a locked parameter in a stage" if name in names else "an unknown parameter in a stage"
                    raise InputError(fault, file=self.file, key=f"stage[{number}].free",
                                     expected=f"one of {', '.join(free_names) or '(none is free)'}", found=repr(name),
                                     remedy="set identify = true where it is defined" if name in names
                                     else "correct the name")
        return tuple(Stage(stage.free if isinstance(stage.free, str) else tuple(stage.free), stage.max_iterations,
                           stage.lowpass_px, stage.until_s) for stage in self.config.stage)

    def options(self) -> Options:
        """The options; height images have defaults of their own.

        A scan is blurred by its reconstruction already, and the quintic spline has 216 taps: none and the cubic one.

        Height images have no drifting light, and an offset of the instrument is indistinguishable from a rise of the
        whole specimen: no brightness correction by default. They are not blurred either: the pixels of a profilometer
        do not alias like those of a camera, and a blur would smooth the simulated height within the pattern.
        """
        table, quantity = self.config.options.model_dump(), self.config.experiment.quantity
        height, volume = quantity in ("height", "displacement"), quantity == "volume"
        if self.config.experiment.fields:
            self._check_field_options(table)
            table |= {"edge_margin_px": 0, "border_px": 0}  # a point has a value of its own
        defaults = {"brightness": "none" if height else "frame",
                    "lowpass_px": 0.0 if height or volume else Options.lowpass_px}
        if volume and "interpolation" not in self.config.options.model_fields_set:
            table["interpolation"] = "cubic"
        defaults["perturbation"] = Options.perturbation if self.config.solver is None else EXTERNAL_PERTURBATION
        table |= {name: value for name, value in defaults.items() if table[name] is None}
        if table["border_px"] is None:
            table["border_px"] = mirrored_rim_px(table["lowpass_px"])
        kinds = ("none", "frame", "tilt") if height else ("none", "frame", "patch")
        if table["brightness"] not in kinds:
            raise InputError("brightness does not fit these images", file=self.file, key="options.brightness",
                             expected=" | ".join(kinds), found=table["brightness"],
                             remedy="choose for height images the offset of the instrument (frame), with two tilts "
                                    "(tilt); for grey images gain and offset of the frame or of patches")
        if height and table["defocus"] != "none":
            raise InputError("defocus does not fit these images", file=self.file, key="options.defocus",
                             expected="none", found=table["defocus"],
                             remedy="leave defocus out: height images have no focus")
        table["left_out_px"] = self._left_out()
        return Options(**table)

    def _left_out(self) -> tuple[tuple[float, float, float], ...]:
        """Circles of the reference image that are not correlated: those of one camera that looks at a surface."""
        circles = tuple((float(x), float(y), float(radius)) for x, y, radius in self.config.options.left_out_px)
        if circles and (self.config.experiment.fields or self.config.further_cameras):
            raise InputError("circles that are left out, of several cameras or of measured fields", file=self.file,
                             key="options.left_out_px", expected="one camera with images",
                             found=f"{len(circles)} circles",
                             remedy="paint them black in the mask of their camera, or remove their points")
        if any(radius <= 0.0 for _, _, radius in circles):
            raise InputError("a circle without a size", file=self.file, key="options.left_out_px",
                             expected="[column, row, radius] with a radius above 0",
                             found=str(next(list(circle) for circle in circles if circle[2] <= 0.0)),
                             remedy="correct the radius")
        return circles

    def _check_field_options(self, table: Mapping[str, Any]) -> None:
        """Refuse options of images next to measured fields."""
        for name, allowed in (("brightness", ("none",)), ("lowpass_px", (0.0,)), ("method", ("integrated",))):
            if table[name] is not None and table[name] not in allowed:
                raise InputError("an option of images next to measured fields", file=self.file, key=f"options.{name}",
                                 expected=f"{allowed[0]}, or no {name}", found=str(table[name]),
                                 remedy=f"leave {name} out")

    def force_notes(self, parameters: list[Parameter], motion: boundary_tables.Motion) -> list[str]:
        if any(c.kind == "reaction" for c in motion.channels) or motion.loads:
            return []
        stresses = [p for p in parameters if p.transform == "log" and p.unit in ("MPa", "GPa", "kPa", "Pa")]
        names = ", ".join(p.name for p in stresses)
        moduli = [p.name for p in stresses if p.free]
        if len(moduli) == 1 and len(stresses) == 1:
            return [f"no force is compared: {moduli[0]} cannot be identified"]
        if moduli:
            return [f"no force is compared: of {', '.join(moduli)} only ratios can be identified"]
        return [f"no force is compared: the stresses follow from the fixed values of {names}; they are "
                "not measured, as images determine only ratios of stresses"] if stresses else []


def _courses(motion: boundary_tables.Motion) -> list[np.ndarray]:
    """Logged motions and loads, one value per frame."""
    drives = [*(entry.drive for entry in motion.prescribed), *(entry.drive for entry in motion.loads)]
    return [drive.values for drive in drives if isinstance(drive, Column)]
