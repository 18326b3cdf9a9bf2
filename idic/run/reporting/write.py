"""Pages and files made from a RUN folder: report.html, figures, CSV tables and ParaView files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from idic.correlation import ViewKind, at_fixed_pixels, camera_at, view_of
from idic.errors import InputError
from idic.identification import ratios_of
from idic.inside import folder_inside, is_inside, write_inside
from idic.measure import FieldSeries
from idic.model import Experiment, Model, is_mode, nodal_temperature
from idic.parameters import ParameterSet, digits_text
from idic.report import (
    AcceptedFrames, ChannelRecord, FieldFrames, ResidualMaps, RunRecord, Sensitivities, ShownMesh, all_pictures,
    all_tables, draw_sections, joint_page, render_page, shown_step, time_label, run_evidence, without_modes,
)
from idic.run.judgement.accepted_point import channel_table, channels_of, last_accepted, refuse_passed_point
from idic.run.judgement.floor import read_floor
from idic.run.judgement.free import read_free
from idic.run.judgement.residual_maps import residuals_of
from idic.run.judgement.shown_frames import shown_frames
from idic.run.prepared.context import RunContext, correlation_context, open_run
from idic.run.prepared.motion_columns import motion_columns, stored_frame
from idic.run.reporting.paraview import write_paraview
from idic.run.reporting.second_process import SecondProcess
from idic.run.reporting.series import gauges_of, series_of
from idic.run.store.arrays import FrameArrays
from idic.run.store.layout import BASE, group_name
from idic.run.store.result_file import RESULT_FILE, read_result
from idic.run.store.run_folders import folders_of, is_joint
from idic.run.store.system_store import load_evaluation

REPORT_FILE = "report.html"
CHANNEL_NOISE = {"given": "as given in the experiment file"}
METHODS = {"direct": "direct differentiation of the simulation", "perturbed": "perturbed simulations"}


def write_report(run: Path | str, stage: Callable[[str], None] = lambda text: None, paraview: bool = False,
                 second: SecondProcess | None = None) -> Path:
    """Write ``RUN/report.html``, ``RUN/figures`` and ``RUN/tables``.

    stage : called with the name of every step that begins, once the RUN has been read
    paraview : also ``RUN/paraview``, as `idic report` does
    second : draws some of the figures; the files have the same bytes

    Returns
    -------
    Path
        The report.

    Raises
    ------
    InputError
        If the folder holds no finished identification.
    """
    run = Path(run)
    if is_joint(run):
        return _write_joint_report(run, stage, paraview, second)
    record = load_record(run)
    stage("tables and ParaView files" if paraview else "tables")
    write_numbers(run, record, paraview)  # before the figures: it meets a damaged frame at once
    stage("figures")
    sections = draw_sections(record) if second is None else draw_sections(record, partial(second.draw_all, record))
    folder_inside(run, "figures")
    for picture in all_pictures(sections):
        write_inside(run, f"figures/{picture.name}.{picture.format}", picture.png)
    stage("page")
    return write_inside(run, REPORT_FILE, render_page(record, sections))


def write_numbers(run: Path, record: RunRecord, paraview: bool = False) -> None:
    """Write ``RUN/tables``, and with `paraview` ``RUN/paraview``: what stands beside page and figures."""
    folder_inside(run, "tables")
    for name, text in all_tables(record).items():
        write_inside(run, f"tables/{name}", text)
    if paraview:
        context = open_run(str(run))
        parameters = accepted_parameters(record.result, context.experiment.model.parameters)
        experiment = context.experiment.at_geometry(parameters)
        accepted = [entry["evaluation"] for entry in record.result.get("history", ()) if entry["accepted"]]
        data = sensitivities_of(context, accepted[-1], experiment.views[0], parameters) if accepted else None
        write_paraview(context, experiment.model, replace(record, sensitivities=data), run / "paraview")


def _write_joint_report(run: Path, stage: Callable[[str], None], paraview: bool,
                        second: SecondProcess | None) -> Path:
    """The page of several experiments identified together, and the report of each."""
    result = read_result(run)
    for name, folder in folders_of(run).items():
        if is_inside(folder, RESULT_FILE):
            stage(f"report of {name}")
            write_report(folder, paraview=paraview, second=second)
    return write_inside(run, REPORT_FILE, joint_page(result))


def load_record(run: Path | str) -> RunRecord:
    """The record of a finished RUN, all numbers in the user's units."""
    run = Path(run)
    result = read_result(run)
    context = open_run(str(run))
    experiment = context.experiment
    _refuse_another_experiment(run, context, result)
    history = _history(result, experiment.model.parameters)
    accepted = [entry["evaluation"] for entry in result.get("history", ()) if entry["accepted"]]
    parameters = accepted_parameters(result, experiment.model.parameters)
    fitted_experiment = experiment.at_geometry(parameters)  # the mesh as it was identified
    names, M = without_modes(result.get("M", {}))
    shown_points = ShownMesh.seen_by(fitted_experiment, camera_at(experiment, parameters))
    common = dict(
        title=experiment.title,
        result=result,
        history=history,
        names=names,
        M=M,
        reference=experiment.recording.picture(experiment.model.reference),
        nodes_px=shown_points.points_px,
        cells=shown_points.cells,
        times=experiment.model.times,
        time_label=time_label(experiment.model.times),
        notes=_notes(context, result),
        pixel_size_mm=_pixel_size(experiment),
        temperature=_temperature(experiment.model, parameters),
    )
    if not accepted:
        return RunRecord(**common)
    floor = read_floor(context.store)
    main, *camera_fields = [_seen(context, result, fitted_experiment, number, parameters)
                            for number in range(len(fitted_experiment.views))]
    series = series_of(run, context, result, fitted_experiment.model)
    record = RunRecord(**(common | main), channels=_channels(context, result), series=series,
                       gauges=gauges_of(context, fitted_experiment.model),
                       camera_floor_px=None if floor is None else floor.nodes_px,
                       **run_evidence(correlation_context(context, parameters), result, parameters,
                                  _accepted_frames(context, result, series), main["sensitivities"],
                                  _noise_sources(context)))
    names = [camera.name for camera in fitted_experiment.cameras]
    camera_records = (replace(record, **fields, channels=(), views=(), free_fields=None, camera_floor_px=None,
                              result=_of_camera(result, name))
                      for name, fields in zip(names, camera_fields, strict=True))
    return replace(record, cameras=tuple(zip(names, camera_records, strict=True)))


def _accepted_frames(context: RunContext, result: Mapping, series: FieldSeries | None) -> AcceptedFrames:
    """What the RUN keeps of its frames at the accepted point."""
    experiment, point = context.experiment, last_accepted(result)["evaluation"]
    stored = FrameArrays.open(context.store.group(group_name(point, BASE)), "u")

    def motion(frame: int) -> np.ndarray:
        k = frame - experiment.model.reference
        return stored.read(k, k + 1)[0]  # (n_nodes, dim) mm

    measured_motions = read_free(context.store, point) if experiment.recording.noise.std_gv else None
    return AcceptedFrames(shown_frames(experiment), motion, residuals_of(context, last_accepted(result)), series,
                          measured_motions)


def _noise_sources(context: RunContext) -> list[str]:
    """Where the noise of every channel comes from, in words."""
    return ["given" if source == "given" else f"{source} of the log"
            for source in context.settings["channel_noise_source"]]


def _seen(context: RunContext, result: Mapping, experiment: Experiment, number: int, parameters: ParameterSet) -> dict:
    """Images and residuals of one camera: the fields of a RunRecord that differ between cameras."""
    view = experiment.views[number]
    point = [entry["evaluation"] for entry in result["history"] if entry["accepted"]][-1]
    shown_points = ShownMesh.seen_by(view, camera_at(view, parameters))
    return dict(
        reference=view.recording.picture(view.model.reference),
        nodes_px=shown_points.points_px,
        cells=shown_points.cells,
        pixel_size_mm=_pixel_size(view),
        rms_before=_rms_before(context, result, number),
        rms_after=_rms_after(result if number == 0 else _of_camera(result, view.recording.camera_name)),
        residuals=_residuals(context, result, number),
        fields=_fields(context, point, view, parameters, shown_points),
        sensitivities=_shown(sensitivities_of(context, point, view, parameters), shown_points),
    )


def _of_camera(result: Mapping, name: str) -> dict:
    """The result with noise, residual and frames of one of several cameras."""
    return dict(result) | result["cameras"][name]


def _refuse_another_experiment(run: Path, context: RunContext, result: Mapping) -> None:
    """Maps are drawn on the mesh of the experiment as it is now: it must be the one that was identified."""
    evaluated = [entry["evaluation"] for entry in result.get("history", ()) if entry["accepted"]]
    if not evaluated:
        return
    refuse_passed_point(context, result)
    stored = FrameArrays.open(context.store.group(group_name(evaluated[-1], BASE)), "u").shape[0]
    unknown = set(result["history"][0]["values"]) - set(context.experiment.model.parameters)
    if stored != context.experiment.model.mesh.n_nodes or unknown:
        raise InputError(
            "the experiment has changed since it was identified",
            file=run,
            expected=f"a mesh of {stored} nodes, as in the RUN",
            found=f"{context.experiment.model.mesh.n_nodes} nodes" if not unknown
            else f"no {', '.join(sorted(unknown))}",
            remedy="identify it again into a new RUN, or restore the experiment folder",
        )


def accepted_parameters(result: Mapping, parameters: ParameterSet) -> ParameterSet:
    """The last accepted trial, the start where none was."""
    accepted = [entry["values"] for entry in result.get("history", ()) if entry["accepted"]]
    return parameters.with_values(accepted[-1]) if accepted else parameters


def _history(result: Mapping, parameters: ParameterSet) -> tuple[dict, ...]:
    """Trials with their values in the user's units."""
    return tuple(
        entry | {"values": {n: v / parameters[n].factor for n, v in entry["values"].items() if v is not None}}
        for entry in result.get("history", ())
    )


def _pixel_size(experiment) -> float | None:
    return experiment.model.camera.pixel_size if experiment.model.length_unit == "mm" else None


def _temperature(model: Model, parameters: ParameterSet) -> np.ndarray | None:
    """Lowest, mean and highest change of the nodes since the reference, with the accepted knots of a course that the
    data give  # (n_frames, 3) K"""
    field = nodal_temperature(model)
    if field is None:
        return None
    values = field.at(0.0, parameters)
    return np.stack([values.min(axis=1), values.mean(axis=1), values.max(axis=1)], axis=1)


def _estimators(result: Mapping) -> Iterator[str]:
    if result.get("method", "integrated") != "integrated":
        weights = "every node alike" if result["method"].endswith("unweighted") else "by the matrix of the FE-DIC"
        yield (f"Two steps: a free FE-DIC of all frames, then the law fitted to its displacements, weighted {weights} "
               "(docs/two-step.md).")
    if result.get("estimator") == "generalised":
        yield ("Generalised least squares: the weights count the noise that all frames share with the reference image "
               "(docs/error-bars.md).")


def _spreads(result: Mapping) -> Iterator[str]:
    """What came of other treatments of boundary and camera, by parameter and ratio that the run determines."""
    treatments = [treatment for treatment in result.get("treatments", []) if treatment["status"] == "converged"]
    for name, entry in (result["parameters"] | result["derived"]).items():
        if entry.get("systematic_std") is None:
            continue
        pairs = [(treatment["values"] | ratios_of(result, treatment["values"]), treatment) for treatment in treatments]
        values = {numbers[name]: treatment for numbers, treatment in pairs if name in numbers}
        n = sum(name in numbers for numbers, _ in pairs)
        if values:
            low, high = min(values), max(values)
            without = f"; {len(pairs) - n} more do not determine it" if n < len(pairs) else ""
            yield (f"{name}: {low:.5g} ({_words(values[low])}) to {high:.5g} ({_words(values[high])}) over "
                   f"{n} other treatment{'' if n == 1 else 's'} of boundary and camera{without}.")


def _words(treatment: Mapping) -> str:
    return f"boundary: {treatment['boundary']}; camera: {treatment['camera']}"


def _notes(context: RunContext, result: Mapping) -> tuple[str, ...]:
    notes = [*result["notes"], *_estimators(result), *_spreads(result)]
    sources = context.settings["channel_noise_source"]
    units = {channel.column: channel.shown_unit for channel in context.experiment.model.channels}
    for (name, std), source in zip(result["residual"].get("channel_noise_std", {}).items(), sources, strict=False):
        notes.append(f"Noise of {name}: {digits_text(std)} {units[name]}, "
                     f"{CHANNEL_NOISE.get(source, 'from its ' + source)}.")
    if result.get("sensitivity") in METHODS:
        notes.append(f"Sensitivities by {METHODS[result['sensitivity']]}.")
    for entry in result.get("history", ()):
        if entry.get("message"):
            notes.append(f"Trial {entry['evaluation']} was rejected because its simulation failed: {entry['message']}.")
    return tuple(notes)


def _rms_before(context: RunContext, result: Mapping, number: int) -> np.ndarray | None:
    """rms residual per frame of one camera at the starting values  # (n_frames,) grey values"""
    if result["history"][0]["phi"] is None:
        return None
    rms = np.full(context.experiment.model.n_frames, np.nan)
    for record in load_evaluation(context.store, 0, context.names).system.frames:
        n_pixels, _, rr, _ = record.cameras[number]
        if n_pixels:
            rms[record.frame] = np.sqrt(rr / n_pixels)
    return rms


def _rms_after(result: Mapping) -> np.ndarray:
    used = [f["rms_gv"] if f["rms_gv"] is not None and not f.get("reference") else np.nan for f in result["frames"]]
    return np.array(used, dtype=float)


def _channels(context: RunContext, result: Mapping) -> tuple[ChannelRecord, ...]:
    simulated, measured = channels_of(context, result)
    started = None
    if result["history"][0]["phi"] is not None:
        started, _ = channel_table(context, result["history"][0]["values"], 0)
    stds = result["residual"].get("channel_noise_std", {})
    return tuple(
        ChannelRecord(
            c.column,
            c.shown_unit,
            measured[:, i] / c.shown_factor,
            simulated[:, i] / c.shown_factor,
            stds.get(c.column),
            None if started is None else started[:, i] / c.shown_factor,
        )
        for i, c in enumerate(context.experiment.model.channels)
    )


def _residuals(context: RunContext, result: Mapping, number: int) -> ResidualMaps | None:
    first, *_ = result["history"]
    frames = shown_frames(context.experiment)
    if first["phi"] is None or not frames:
        return None
    last_entry = last_accepted(result)
    maps_before, maps_after = (np.array([read(k) for k in frames])
                               for read in (residuals_of(context, entry, number) for entry in (first, last_entry)))
    return ResidualMaps(frames, maps_before, maps_after)


def _fields(context: RunContext, point: int, experiment: Experiment, parameters: ParameterSet,
            shown_points: ShownMesh) -> FieldFrames | None:
    """Displacement of some frames as one camera sees it; experiment : the view of that camera."""
    recording = experiment.recording
    frames = shown_frames(experiment)
    view, nodes = view_of(experiment, camera_at(experiment, parameters)), experiment.model.mesh.nodes

    def seen_u(frame: int) -> np.ndarray:
        frames_read = max(frame - 1, experiment.model.reference), frame
        u_earlier, u = (stored_frame(context, point, BASE, "u", k) for k in frames_read)
        return experiment.model.turned(experiment.at_camera_time(parameters, frame, u, u_earlier))

    u = np.array([view.at(frame).motion(nodes, seen_u(frame)) for frame in frames])
    if not frames:
        return None
    if view.kind == ViewKind.VOLUME:
        u = np.array([shown_points.of(motion) for motion in u])
        return FieldFrames(frames, u[:, :, :2], {"motion along the slices [px]": u[:, :, 2]})
    unit = 1.0 if recording.points is None else recording.points.um_per_px
    rise = {f"rise [{recording.value_unit}]": unit * u[:, :, 2]} if view.n_components == 3 else {}
    return FieldFrames(frames, u[:, :, :2], rise)


def sensitivities_of(context: RunContext, point: int, experiment: Experiment,
                     parameters: ParameterSet) -> Sensitivities | None:
    """Fields of the parameters that move the simulation, in the frame in which they move most, seen by one camera."""
    model = experiment.model
    chosen = [i for i, name in enumerate(context.moving) if not is_mode(name)]
    names = tuple(context.moving[i] for i in chosen)
    frames = shown_frames(experiment)
    if not names or not frames:
        return None
    frame = frames[-1]
    u = model.turned(stored_frame(context, point, BASE, "u", frame))
    columns = model.turned(motion_columns(context, point, frame, parameters)[..., chosen])
    du = at_fixed_pixels(model, u, columns, names)
    view, nodes = view_of(experiment, camera_at(experiment, parameters)).at(frame), model.mesh.nodes
    columns = view.columns(nodes, u, du).reshape(len(nodes), view.n_components, len(names))
    if view.n_components == 3 and view.kind not in (ViewKind.SPACE, ViewKind.VOLUME):
        columns[:, 2] *= experiment.recording.height_unit / view.camera.pixel_size
    steps = [shown_step(parameters[name]) for name in names]
    phi = np.stack([columns[:, :, i] * size for i, (size, _) in enumerate(steps)])
    sizes = tuple(size / parameters[name].factor for name, (size, _) in zip(names, steps, strict=True))
    return Sensitivities(names, frame, phi, tuple(text for _, text in steps), sizes)


def _shown(data: Sensitivities | None, shown_points: ShownMesh) -> Sensitivities | None:
    """The fields at the points that are shown."""
    return data and replace(data, phi_px=np.array([shown_points.of(phi) for phi in data.phi_px]))
