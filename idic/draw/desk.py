"""The requests of the page: each answer uses the folder and the data that the browser sent, nothing else."""

from __future__ import annotations

import threading
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from idic.draw import document, watch
from idic.draw.folder import Listing, list_folder, log_table
from idic.draw.pictures import Pictures
from idic.draw.plan import Plan, Sketch, first_sketch, read_plan
from idic.draw.speckle_area import speckled_area
from idic.draw.texture import Texture, noise_floor, texture_of
from idic.errors import InputError
from idic.fe import Segments
from idic.images import image_noise, speckle_size
from idic.laws import all_laws
from idic.readers import Drawing, has_gmsh
from idic.report import check

MIN_NOISE_WINDOW_PX = 32
NOISE_WINDOW_PX = 1024  # of the middle of the speckled area, from which noise and speckle are taken
MAX_SHOWN_ELEMENTS = 60_000
FIRST_LAW = "elastic"


@dataclass(frozen=True)
class Recording:
    """The images of one group: the reference, its texture, its speckled area, its noise."""

    pictures: Pictures
    texture: Texture
    outline: list
    holes: list
    noise_gv: float
    speckle_px: float | None


@dataclass
class Desk:
    """One folder, opened in the page; what it read last is kept."""

    folder: Path
    _written: str = ""
    _pictures: dict[str, Pictures] = field(default_factory=dict)
    _recordings: dict[str, Recording] = field(default_factory=dict)
    _pictures_lock: threading.Lock = field(default_factory=threading.Lock)
    _recordings_lock: threading.Lock = field(default_factory=threading.Lock)

    def listing(self) -> Listing:
        return list_folder(self.folder)

    def pictures(self, images: str) -> Pictures:
        """The frames of a group of images."""
        with self._pictures_lock:
            if images not in self._pictures:
                self._pictures = {images: Pictures(self.listing().stack(images))}
            return self._pictures[images]

    def recording(self, images: str) -> Recording:
        """The reference of a group of images, looked through once."""
        pictures = self.pictures(images)
        with self._recordings_lock:
            if images not in self._recordings:
                self._recordings = {images: _recording(pictures)}
            return self._recordings[images]

    def read_ahead(self) -> None:
        """Read the reference of the first group before the page asks."""
        with suppress(InputError):  # the page will ask, and tell
            self.pictures(next(iter(self.listing().images))).frame(0)

    # answers ----------------------------------------------------------------------------------------------
    def files(self) -> dict:
        """The listing, the laws and the images of the first group: enough to show the reference."""
        listing = self.listing()
        images = next(iter(listing.images))
        stack = self.pictures(images).stack
        ny, nx = stack.shape
        return {"folder": self.folder.name, "images": {name: len(paths) for name, paths in listing.images.items()},
                "logs": list(listing.logs), "runs": list(listing.runs), "next_run": watch.next_name(listing.runs),
                "at_work": next((name for name in listing.runs if watch.is_at_work(self.folder, name)), None),
                "has_experiment": listing.has_experiment, "gmsh": has_gmsh(), "laws": _laws(), "first_law": FIRST_LAW,
                "width": nx, "height": ny, "frames": stack.n_frames, "drawn_before": document.drawn_before(self.folder)}

    def size(self, images: str) -> dict:
        """Width, height and number of the frames of a group, and the name of the first."""
        stack = self.pictures(images).stack
        return {"width": stack.shape[1], "height": stack.shape[0], "frames": stack.n_frames,
                "reference": stack.labels[0]}

    def area(self, images: str) -> dict:
        """The speckled area as a first drawing; noise and size of the speckle."""
        recording = self.recording(images)
        return {"sketch": first_sketch(recording.outline, recording.holes, recording.pictures.stack.shape),
                "found": bool(recording.outline),
                "noise_gv": recording.noise_gv, "speckle_px": recording.speckle_px}

    def log(self, name: str, images: str) -> dict:
        """The columns of a log."""
        return {"name": name} | log_table(self.listing().log(name), self.pictures(images).stack.n_frames)

    def mesh(self, content: dict, images: str) -> dict:
        """The mesh of a drawing, in px, with the noise floor of every element."""
        sketch = read_plan(content, Sketch)
        assert isinstance(sketch, Sketch)
        number = Segments.of(sketch.outline, sketch.holes).area() / sketch.element_px**2
        if number > MAX_SHOWN_ELEMENTS:
            raise InputError("too many elements to show", key="element_px",
                             expected=f"{MAX_SHOWN_ELEMENTS} elements or fewer",
                             found=f"about {number:.0f}", remedy="choose larger elements")
        drawing = Drawing(sketch.outline, sketch.holes, sketch.element_px, sketch.elements == "quads",
                          sketch.edge_names,
                          sketch.mesher)
        mesh = drawing.mesh()
        recording = self.recording(images)
        corners = [mesh.nodes[cell] for block in mesh.blocks for cell in block.connectivity]
        floor = noise_floor(recording.texture, corners, recording.noise_gv)
        finite = floor[np.isfinite(floor)]
        return {"nodes": np.round(mesh.nodes, 2).tolist(),
                "elements": [cell.tolist() for block in mesh.blocks for cell in block.connectivity],
                "sets": {name: [mesh.face_nodes(face)[:2].tolist() for face in faces]
                         for name, faces in mesh.edge_sets.items()},
                "floor": [round(float(v), 5) if np.isfinite(v) else None for v in floor],
                "floor_median": float(np.median(finite)) if len(finite) else None,
                "smallest_angle": mesh.smallest_angle,
                "px_per_element": float(np.mean([_area(cell) for cell in corners]))}

    def text(self, content: dict) -> dict:
        """experiment.toml of a plan; nothing is written."""
        return {"toml": document.text_of(self.plan(content))}

    def write(self, content: dict, replace: bool) -> dict:
        """Check and write experiment.toml; what `idic check` tells of it."""
        plan = self.plan(content)
        text = self._written = document.write(self.folder, plan, replace, self._written)
        return {"toml": text, "lines": check(document.loaded(self.folder, plan), draw=False).lines()}

    def plan(self, content: dict) -> Plan:
        """A plan whose files are in the listing."""
        plan = read_plan(content, Plan)
        assert isinstance(plan, Plan)
        listing = self.listing()
        listing.stack(plan.images)
        if plan.loads is not None:
            listing.log(plan.loads)
        return plan

    def identify(self, name: str) -> dict:
        """Start `idic identify` on the folder's experiment.toml."""
        if not self.listing().has_experiment:
            raise InputError("there is no experiment to identify", key="experiment.toml",
                             expected="a written experiment.toml",
                             found="none", remedy="write it first")
        if watch.is_at_work(self.folder, name):
            raise InputError("this run is in progress", key="run", expected="a run that has ended, or a new name",
                             found=name,
                             remedy="watch it, or choose another name")
        watch.start(self.folder, name)
        return {"name": name}


def _recording(pictures: Pictures) -> Recording:
    image = pictures.frame(0)
    texture = texture_of(image)
    outline, holes = speckled_area(image, texture)
    window, inside = _window(image, outline, holes)
    noise = image_noise(window).std_gv if min(window.shape) > MIN_NOISE_WINDOW_PX else float(np.nanstd(window))
    return Recording(pictures, texture, outline, holes, noise, speckle_size(window, inside, noise))


def _window(image: np.ndarray, outline: list, holes: list) -> tuple[np.ndarray, np.ndarray]:
    """A part of the outline, half as wide and high, and its pixels outside of round holes: the part with most of
    them."""
    ny, nx = image.shape
    low, high = Segments.of(outline).box() if outline else np.array([[0, 0], [nx - 1, ny - 1]], dtype=float)
    half = np.minimum(high - low, 2 * NOISE_WINDOW_PX) / 4
    parts = []
    for share in ((0.5, 0.5), (0.28, 0.28), (0.72, 0.28), (0.28, 0.72), (0.72, 0.72)):
        centre = low + (high - low) * share
        (x0, y0), (x1, y1) = (centre - half).astype(int), (centre + half).astype(int) + 1
        window = image[y0:y1, x0:x1]
        rows, columns = np.ogrid[y0 : y0 + window.shape[0], x0 : x0 + window.shape[1]]
        inside = np.ones(window.shape, dtype=bool)
        for x, y, radius in (hole for hole in holes if Segments.is_circle(hole)):
            inside &= (columns - x) ** 2 + (rows - y) ** 2 > (1.1 * radius) ** 2
        parts.append((window, inside))
    return max(parts, key=lambda part: int(part[1].sum()))


def _laws() -> list[dict]:
    return [{"name": name, "parameters": [{"name": entry.name, "unit": entry.unit, "typical": entry.default,
                                           "what": entry.description} for entry in spec.parameters]}
            for name, spec in all_laws().items()
            if spec.compose is None and all(entry.default is not None for entry in spec.parameters)]


def _area(cell: np.ndarray) -> float:
    following = np.roll(cell, -1, axis=0)
    return 0.5 * abs(float((cell[:, 0] * following[:, 1] - following[:, 0] * cell[:, 1]).sum()))
