"""The table of good practice: all facts that a reader needs to judge a correlation; unknown facts are marked.

After the reporting tables of the iDICs good-practice guide (International Digital Image Correlation Society, 2018,
doi:10.32720/idics/gpg.ed1). Where the integrated method has no subset and no strain window, what stands for them is
named.
"""

from __future__ import annotations

from dataclasses import dataclass

from idic.images import MIN_TOLD_SHIFT_PX
from idic.parameters import digits_text
from idic.report.result.record import Practice, RunRecord
from idic.report.result.words import NOISE_SOURCE

NOT_STATED = "not stated"
SETUP = (("specimen", "specimen"), ("machine", "testing machine"), ("camera", "camera"), ("lens", "lens"),
         ("aperture", "aperture"), ("stand_off", "stand-off distance"), ("exposure", "exposure time"),
         ("lighting", "lighting"), ("pattern", "how the pattern was made"))
BRIGHTNESS = {"none": "none", "frame": "gain and offset of every frame", "patch": "gain and offset of patches",
              "tilt": "offset and tilt of every frame"}
ORDERS = {"quintic": "B-spline of degree 5", "cubic": "B-spline of degree 3"}


@dataclass(frozen=True)
class Rows:
    """One titled part of the table; known : False where it is neither stated nor measured."""

    title: str
    rows: tuple[tuple[str, str, bool], ...]


def practice_table(record: RunRecord) -> tuple[Rows, ...]:
    """The parts of the table, empty where the record holds no facts."""
    facts = record.practice
    if facts is None:
        return ()
    data = Rows("Fields", _points(record, facts)) if _is_field(record) else Rows("Images", _images(record, facts))
    return (data, Rows("Correlation", _correlation(record, facts)),
            Rows("Noise floor", _floors(record, facts)), Rows("Laboratory", _setup(facts)))


def _is_field(record: RunRecord) -> bool:
    return record.result.get("quantity") == "displacement"


def _points(record: RunRecord, facts: Practice) -> tuple[tuple[str, str, bool], ...]:
    """Of displacements that another system measured."""
    pitch = record.pixel_size_mm
    statuses = [frame.get("status") for frame in record.result.get("frames", ())]
    return (
        _row("quantity", "displacements of points, by another system"),
        _row("grid of the points", f"{facts.columns} × {facts.rows} places"),
        _row("field of view", None if pitch is None else f"{facts.columns * pitch:.4g} × {facts.rows * pitch:.4g} mm"),
        _row("distance of neighbours", None if pitch is None else f"{pitch:.4g} mm"),
        _row("time between stages", None if facts.frame_s is None else f"{facts.frame_s:.4g} s", "no times are known"),
        _row("stages", f"{len(statuses)}, of which {statuses.count('ok')} were used"),
        _row("reference", facts.reference if facts.n_references == 1
             else f"{facts.reference}, mean of {facts.n_references} stages"),
    )


def _images(record: RunRecord, facts: Practice) -> tuple[tuple[str, str, bool], ...]:
    grey, px = record.value_unit == "grey values", record.pixel_size_mm
    statuses = [frame.get("status") for frame in record.result.get("frames", ())]
    field = None if px is None else f"{facts.columns * px:.4g} × {facts.rows * px:.4g} mm"
    scale = None if px is None else f"{px:.4g} mm per px ({1.0 / px:.4g} px per mm)"
    low, high = facts.grey_range
    contrast = f"{digits_text(facts.contrast)} {record.value_unit} (standard deviation), from {low:.4g} to {high:.4g}"
    if facts.saturated:
        contrast += f"; {100 * facts.saturated:.2g} % saturated"
    size = None if facts.speckle_px is None else (
        f"{facts.speckle_px:.1f} px" + ("" if px is None else f" = {facts.speckle_px * px:.3g} mm")
        + " (full width at half maximum of the autocorrelation)")
    return (
        _row("quantity", "grey images" if grey else f"height images, {record.value_unit}"),
        _row("image size", f"{facts.columns} × {facts.rows} px"),
        _row("bit depth", _depth(facts)),
        *([_row("compression", "JPEG, seen in the grey values")] if facts.compressed else []),
        _row("field of view", field, "no scale is known"),
        _row("image scale", scale, "not known: lengths are in px"),
        _row("time between images", None if facts.frame_s is None else f"{facts.frame_s:.4g} s", "no times are known"),
        _row("frames", f"{len(statuses)}, of which {statuses.count('ok')} were used"),
        _row("reference", facts.reference if facts.n_references == 1
             else f"{facts.reference}, mean of {facts.n_references} images"),
        _row("speckle size" if grey else "size of the roughness", size,
             "not measurable: the autocorrelation does not fall off within 60 px"),
        _row("contrast", contrast),
    )


def _depth(facts: Practice) -> str:
    if facts.depth.startswith("uint"):
        return f"{facts.depth[4:]} bit; grey values up to {facts.grey_range[1]:.0f} occur"
    return f"{facts.depth} (not whole grey values)" if facts.depth.startswith("float") else facts.depth


def _correlation(record: RunRecord, facts: Practice) -> tuple[tuple[str, str, bool], ...]:
    px = record.pixel_size_mm
    field = _is_field(record)
    side = (f"{facts.element_px * px:.3g} mm" if field and px is not None else
            f"{facts.element_px:.3g} px" + ("" if px is None else f" = {facts.element_px * px:.3g} mm"))
    smallest = f"{facts.smallest_px * px:.3g} mm" if field and px is not None else f"{facts.smallest_px:.3g} px"
    smoothing = ("no element is compared with a free FE-DIC" if record.free_fields is None
                 else f"of the free FE-DIC: waves below {_wave(record, record.free_fields.length_px)} are smoothed")
    interpolant = ORDERS.get(facts.interpolation, facts.interpolation)
    lowpass = f"Gaussian, standard deviation {facts.lowpass_px:g} px" if facts.lowpass_px else "none"
    return (
        _row("software", f"idic {facts.version}"),
        _row("method", "integrated DIC in time: all frames and channels at once, displacement from the model "
             f"({facts.kind.replace('_', ' ')})"),
        _row("elements (for subsets)", f"{facts.n_elements} × {facts.cell}, mean side {side}, smallest "
             f"{smallest}"),
        *([_row("components compared", f"{facts.n_pixels} per stage")] if field else [
            _row("step", "none: every pixel on the mesh is compared"),
            _row("pixels compared", f"{facts.n_pixels} per frame"
                 + (f"; not along the edges ({facts.edge_margin_px} px)" if facts.edge_margin_px else ""))]),
        _row("shape function", "that of the elements, moved by the simulation"),
        _row("criterion", "sum of squared differences over noise" + (
            "" if field else f"; brightness: {BRIGHTNESS.get(facts.brightness, facts.brightness)}")),
        *([] if field else [_row("image filter", lowpass), _row("interpolant", interpolant)]),
        _row("strain", "derivative of the simulated displacement, no strain window; " + smoothing),
        _row("estimator", f"{facts.estimator} least squares"),
    )


def _floors(record: RunRecord, facts: Practice) -> tuple[tuple[str, str, bool], ...]:
    floor, px = facts.floor, record.pixel_size_mm
    source = NOISE_SOURCE.get(record.result["noise"].get("source", ""), "")
    grey = (None if record.noise_gv is None else
            f"{digits_text(record.noise_gv)} {record.value_unit}{source and ', ' + source}")
    free_strain = None if floor.free_strain is None else _strain(floor.free_strain)
    model_strain = None if floor.model_strain is None else _strain(floor.model_strain)
    frame = "" if floor.model_frame is None else f" (frame {floor.model_frame})"
    rows = [
        _row("grey value" if record.value_unit == "grey values" else
             "component of a point" if _is_field(record) else "height", grey, "not known"),
        _row("displacement, identified model", _length(floor.model_px, px, frame, _is_field(record)),
             "not known"),
        _row("displacement, free FE-DIC",
             _length(floor.free_px, px, ", from a still image with this noise", _is_field(record)), "not measured"),
        _row("displacement, camera", _camera_floor(record), "not known: no frame is at rest"),
        *([] if floor.free_rise is None else [
            _row("height, free FE-DIC", f"{floor.free_rise:.2g} {record.value_unit}, from such a still image")]),
        _row("strain, identified model", model_strain and model_strain + frame, "not known"),
        _row("strain, free FE-DIC", free_strain and free_strain + ", middle of an element", "not measured"),
    ]
    for name, unit, std, origin in facts.channel_noise:
        rows.append(_row(name, f"{digits_text(std)} {unit}, {_origin(origin)}"))
    if not facts.channel_noise:
        rows.append(_row("force", None, "no force is compared"))
    return tuple(rows)


def _camera_floor(record: RunRecord) -> str | None:
    """What frames at rest show after rigid motion and image noise are taken off, and how far they have moved."""
    camera = record.result.get("camera_floor") or {}
    if camera.get("px") is None:
        return None
    frames_text = f", in images at rest ({', '.join(camera['labels'])})"
    if (drift := max(camera["drift_px"], default=0.0)) > MIN_TOLD_SHIFT_PX:
        furthest = camera["labels"][camera["drift_px"].index(drift)]
        frames_text += f"; {furthest} has moved by {drift:.2g} px against the reference"
    if not camera["px"]:
        bound, field = camera["bound_px"], _is_field(record) and record.pixel_size_mm is not None
        return (f"below {1e3 * bound * record.pixel_size_mm:.2g} µm{frames_text}" if field
                else f"below {bound:.2g} px{frames_text}")
    return _length(camera["px"], record.pixel_size_mm, frames_text, _is_field(record))


def _wave(record: RunRecord, length_px: float) -> str:
    """A length in px, of points in mm."""
    in_mm = _is_field(record) and record.pixel_size_mm is not None
    return f"{length_px * record.pixel_size_mm:.2g} mm" if in_mm else f"{length_px:.0f} px"


def _origin(source: str) -> str:
    return "as given in the experiment file" if source == "given" else f"from its {source}"


def _length(value: float | None, pixel_size_mm: float | None, tail: str, only_mm: bool = False) -> str | None:
    """A motion in px and µm; only_mm : in µm only"""
    if value is None:
        return None
    if only_mm and pixel_size_mm is not None:
        return f"{digits_text(1e3 * value * pixel_size_mm, 2)} µm{tail}"
    scaled = "" if pixel_size_mm is None else f" = {digits_text(1e3 * value * pixel_size_mm, 2)} µm"
    return f"{value:.2g} px{scaled}{tail}"


def _strain(value: float) -> str:
    return f"{digits_text(1e6 * value, 2)} µm/m"


def _setup(facts: Practice) -> tuple[tuple[str, str, bool], ...]:
    return tuple(_row(label, facts.setup.get(name), NOT_STATED) for name, label in SETUP)


def _row(label: str, text: str | None, otherwise: str = NOT_STATED) -> tuple[str, str, bool]:
    return label, text or otherwise, bool(text)
