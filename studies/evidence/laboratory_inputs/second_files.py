"""A second author's files: images as cameras and programs save them, meshes as meshers write them, devices."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import tifffile
from outcome import Input, right_if
from PIL import Image

from idic.readers import Log, open_stack, read_mesh_file

RNG = np.random.default_rng(11)
STACK = RNG.integers(0, 200, (6, 40, 50)).astype(np.uint8)
DEEP = RNG.integers(0, 4095, (6, 40, 50)).astype(np.uint16)


def read_back(save: Callable[[Path], None], pattern: str, wanted: np.ndarray, folder: Path) -> tuple[str, str]:
    """The files hold these images in this order, with these values."""
    folder.mkdir(parents=True)
    save(folder)
    stack = open_stack(sorted(folder.glob(pattern)), with_gaps=True)
    pictures = np.array([np.asarray(stack.frame(k)) for k in range(stack.n_frames)])
    is_right = pictures.shape == wanted.shape and np.allclose(pictures, wanted, equal_nan=True)
    return right_if(is_right, (pictures.shape, pictures.dtype, pictures.ravel()[:3], wanted.ravel()[:3]))


def thumbnail(folder: Path) -> None:
    """A full page and a reduced one, as cameras and Photoshop save."""
    with tifffile.TiffWriter(folder / "a.tif") as stream:
        stream.write(DEEP[0])
        stream.write(DEEP[0][::4, ::4], subfiletype=1)


def multi_file(folder: Path) -> None:
    """Files of one OME series, a member of which is lost: each is one frame, none is zeros."""
    uuids = [f"urn:uuid:0000000{k}-0000-4000-8000-000000000000" for k in range(3)]
    parts = "".join(f'<TiffData FirstT="{k}" IFD="0" PlaneCount="1"><UUID FileName="a{k}.ome.tif">{uuid}</UUID>'
                    "</TiffData>"
                    for k, uuid in enumerate(uuids))
    for k, uuid in enumerate(uuids):
        text = (f'<?xml version="1.0" encoding="UTF-8"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06" '
                f'UUID="{uuid}"><Image ID="Image:0"><Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint16" '
                'SizeX="50" '
                f'SizeY="40" SizeZ="1" SizeC="1" SizeT="3"><Channel ID="Channel:0:0" SamplesPerPixel="1"/>{parts}'
                "</Pixels></Image></OME>")
        tifffile.imwrite(folder / f"a{k}.ome.tif", DEEP[k], description=text, metadata=None)
    (folder / "a1.ome.tif").unlink()


def images() -> Iterator[Input]:
    """Images."""
    def each(save: Callable[[Path, np.ndarray], None], suffix: str) -> Callable[[Path], None]:
        return lambda folder: [save(folder / f"a{k}{suffix}", picture) for k, picture in enumerate(STACK)] and None

    def once(**options) -> Callable[[Path], None]:
        return lambda folder: tifffile.imwrite(folder / "a.tif", **options)

    unit = (STACK / np.float32(255)).astype(np.float32)
    cases: dict[str, tuple[Callable, str, np.ndarray]] = {
        "ImageJ, 16 bit, frames": (once(data=DEEP, imagej=True, metadata={"axes": "TYX"}), "*.tif", DEEP),
        "ImageJ, slices that are frames": (once(data=DEEP, imagej=True, metadata={"axes": "ZYX"}), "*.tif", DEEP),
        "BigTIFF": (once(data=DEEP, bigtiff=True), "*.tif", DEEP),
        "OME, channel and depth of one": (lambda f: tifffile.imwrite(f / "a.ome.tif", DEEP.reshape(6, 1, 1, 40, 50),
                                                                    metadata={"axes": "TCZYX"}), "*.tif", DEEP),
        "OME, a member is lost": (multi_file, "*.tif", DEEP[[0, 2]]),
        "LZW with a predictor": (once(data=DEEP, compression="lzw", predictor=True), "*.tif", DEEP),
        "a thumbnail on a second page": (thumbnail, "*.tif", DEEP[:1]),
        "grey values of 0 to 1": (once(data=unit), "*.tif", unit),
        "signed 16 bit, -32768 for black": (once(data=(DEEP.astype(np.int32) - 32768).astype(np.int16)), "*.tif",
                                            DEEP.astype(float) - 32768),
        "turned by the orientation tag": (once(data=DEEP[0], extratags=[(274, "H", 1, 3, True)]), "*.tif",
                                          DEEP[:1, ::-1, ::-1]),
        "BMP": (each(lambda path, picture: Image.fromarray(picture).save(path), ".bmp"), "*.bmp", STACK),
        "PNG of 16 bit": (lambda f: Image.fromarray(DEEP[0]).save(f / "a.png"), "*.png", DEEP[:1]),
        "JPEG of a camera": (each(lambda path, picture: Image.fromarray(picture).save(path, quality=100), ".jpg"),
                             "*.jpg", STACK),
        "black and white, one bit": (once(data=STACK[0] > 99, photometric="minisblack"), "*.tif", STACK[:1] > 99)}
    for name, (save, pattern, wanted) in cases.items():
        yield Input("axes of files", name, partial(read_back, save, pattern, wanted))


def plate(save: str, more: Callable[[object], None], dimension: int, set_name: str, folder: Path,
          form: float = 4.1) -> tuple[str, str]:
    """A plate of 4 x 2 mm with a hole by gmsh: its area or volume, and the nodes of the left edge."""
    import gmsh
    folder.mkdir(parents=True)
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MshFileVersion", form)
        surface = gmsh.model.occ.cut([(2, gmsh.model.occ.addRectangle(0, 0, 0, 4, 2))],
                                     [(2, gmsh.model.occ.addDisk(2, 1, 0, 0.5, 0.5))])[0][0][1]
        gmsh.model.occ.synchronize()
        if dimension == 3:
            gmsh.model.occ.extrude([(2, surface)], 0, 0, 0.5, [2], recombine=False)
            gmsh.model.occ.synchronize()
        body = gmsh.model.getEntities(dimension)[0][1]
        gmsh.model.addPhysicalGroup(dimension, [body], name="SHEET")
        edges = [tag for dim, tag in gmsh.model.getEntities(dimension - 1)
                 if np.allclose(gmsh.model.occ.getCenterOfMass(dim, tag)[0], 0.0)]
        gmsh.model.addPhysicalGroup(dimension - 1, edges, name="LEFT")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.4)
        more(gmsh)
        gmsh.model.mesh.generate(dimension)
        more_order = getattr(more, "order", 1)
        if more_order == 2:
            gmsh.model.mesh.setOrder(2)
        gmsh.write(str(folder / save))
    finally:
        gmsh.finalize()
    mesh, notes = read_mesh_file(folder / save).to_mesh(dimension, 1.0)
    mesh.check_elements()
    if not set_name:
        corners = mesh.nodes[mesh.blocks[0].connectivity[:, :3]]
        area = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])).sum() / 2
        return right_if(abs(area - (8 - np.pi / 4)) < 0.1, area)
    left = next((mesh.nodes[nodes] for key, nodes in mesh.node_sets.items() if key.endswith(set_name)), None)
    has_left = left is not None and len(left) >= 6 and np.ptp(left[:, 0]) < 1e-9
    at_left = int((np.abs(mesh.nodes[:, 0]) < 1e-9).sum())
    return right_if(has_left and len(left) == at_left, (at_left, sorted(mesh.node_sets), notes))


class Quads:
    """Recombined; order : of the elements"""

    def __init__(self, order: int = 1, recombined: bool = True, binary: bool = False) -> None:
        self.order, self.recombined, self.binary = order, recombined, binary

    def __call__(self, gmsh) -> None:
        gmsh.option.setNumber("Mesh.RecombineAll", self.recombined)
        gmsh.option.setNumber("Mesh.Binary", self.binary)
        gmsh.option.setNumber("Mesh.SaveGroupsOfNodes", 1)


BRICK = [(x, y, z) for z in (0.0, 1.0) for x, y in ((0, 0), (2, 0), (2, 1), (0, 1))]
MIDDLES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]


def brick20() -> str:
    """C3D20R over two lines, large labels, sets with a surface by face, as CalculiX decks are."""
    places = [*BRICK, *(tuple(0.5 * (np.array(BRICK[a]) + BRICK[b])) for a, b in MIDDLES)]
    labels = [100000001 + 7 * k for k in range(20)]
    nodes = "\n".join(f"{label},\t{x:.6E},{y:.6E},{z:.6E}" for label, (x, y, z) in zip(labels, places, strict=True))
    words = ", ".join(map(str, labels[:11])) + ",\n   " + ", ".join(map(str, labels[11:]))
    left = [labels[k] for k, place in enumerate(places) if place[0] == 0]
    return (f"*NODE, NSET=Nall\n{nodes}\n*ELEMENT, TYPE=C3D20R, ELSET=Eall\n1, {words}\n*NSET,NSET=LEFT\n"
            + ",\n".join(map(str, left)) + ",\n*SURFACE, NAME=FRONT, TYPE=ELEMENT\nEall, S2\n*STEP\n*STATIC\n"
            "*END STEP\n").replace("\n", "\r\n")


def solid(folder: Path) -> tuple[str, str]:
    """The brick at its place, the left nodes, the face z = 1."""
    folder.mkdir(parents=True)
    (folder / "a.inp").write_bytes(brick20().encode())
    mesh, notes = read_mesh_file(folder / "a.inp").to_mesh(3, 1.0)
    mesh.check_elements()
    left = mesh.nodes[mesh.node_sets["LEFT"]]
    return right_if(mesh.n_elements == 1 and len(left) == 8 and np.ptp(left[:, 0]) == 0 and "FRONT" in str(
        [*mesh.edge_sets]), (len(left), notes, [*mesh.edge_sets]))


CAE = """*Heading
** Job name: Job-1 Model name: Model-1
** Generated by: Abaqus/CAE 2023
*Preprint, echo=NO, model=NO, history=NO, contact=NO
**
** PARTS
**
*Part, name="Open hole"
*Node
      1,           0.,           0.
      2,           2.,           0.
      3,           4.,           0.
      4,           0.,           1.
      5,           2.,           1.
      6,           4.,           1.
*Element, type=CPS4R
1, 1, 2, 5, 4
2, 2, 3, 6, 5
*Nset, nset=_PickedSet2, internal, generate
 1,  6,  1
*Elset, elset=_PickedSet2, internal
 1, 2
** Section: Section-1
*Solid Section, elset=_PickedSet2, material=Steel
,
*End Part
**
** ASSEMBLY
**
*Assembly, name=Assembly
**
*Instance, name="Open hole-1", part="Open hole"
*End Instance
**
*Nset, nset=Left, instance="Open hole-1"
 1, 4
*Elset, elset=_Right_S2, internal, instance="Open hole-1"
 2,
*Surface, type=ELEMENT, name=Right
_Right_S2, S2
*End Assembly
**
** MATERIALS
**
*Material, name=Steel
*Elastic
210000., 0.3
** STEP: Step-1
**
*Step, name=Step-1, nlgeom=YES
*Static
0.1, 1., 1e-05, 0.1
*Boundary
Left, ENCASTRE
*Output, field, variable=PRESELECT
*End Step
"""


def text_mesh(name: str, text: str, folder: Path) -> tuple[str, str]:
    """Two squares of the strip, the set at x = 0."""
    folder.mkdir(parents=True)
    (folder / name).write_text(text)
    mesh, notes = read_mesh_file(folder / name).to_mesh(2, 1.0)
    mesh.check_elements()
    left = next((mesh.nodes[v] for key, v in mesh.node_sets.items() if key.lower().endswith("left")), np.zeros((0, 2)))
    return right_if(mesh.n_elements == 2 and mesh.n_nodes == 6 and len(left) == 2 and np.ptp(left[:, 0]) == 0,
                    (mesh.n_elements, sorted(mesh.node_sets), notes))


def cards() -> str:
    """What pyNastran 1.4 writes: a rectangular system turned by 90°, long cards without a comma, ZOFFS, triangles."""
    def long(name: str, *words: object) -> str:
        rows = [words[k:k + 4] for k in range(0, len(words), 4)]
        return "".join(f"{f'{name}*' if not k else '*':8s}" + "".join(f"{word!s:>16s}" for word in row) + "\n"
                       for k, row in enumerate(rows))

    places = [(0, 0), (2, 0), (4, 0), (0, 1), (2, 1), (4, 1)]
    grids = "".join(long("GRID", k, 5, f"{y}.", f"{10 - x}.", "0.") for k, (x, y) in enumerate(places, 1))
    return ("$pyNastran: version=msc\n$pyNastran: punch=True\n$NODES\n" + grids + "$ELEMENTS\n"
            + long("CQUAD4", 1, 1, 1, 2, 5, 4, "", ".1") + "CTRIA3         2       1       2       3       6\n"
            "CTRIA3         3       1       2       6       5\n" + long("PSHELL", 1, 1, "2.") + "*\n"
            + long("MAT1", 1, "70000.", "", ".3") + "*\n$COORDS\n"
            + long("CORD2R", 5, "", "10.", "0.", "0.", "10.", "0.", "1.", "10.", "1.", "0.") + "*\n")


def turned(folder: Path) -> tuple[str, str]:
    """Three elements in the rectangle 4 x 1."""
    folder.mkdir(parents=True)
    (folder / "a.bdf").write_text(cards())
    mesh, notes = read_mesh_file(folder / "a.bdf").to_mesh(2, 1.0)
    mesh.check_elements()
    box = [*mesh.nodes.min(axis=0), *mesh.nodes.max(axis=0)]
    return right_if(mesh.n_elements == 3 and np.allclose(box, [0, 0, 4, 1], atol=1e-6), (mesh.n_elements, box, notes))


def meshes() -> Iterator[Input]:
    """Meshes."""
    kind = "decks and meshes"
    yield Input(kind, "Abaqus/CAE, instance with a blank in its name", partial(text_mesh, "a.inp", CAE))
    yield Input(kind, "CalculiX, C3D20R over two lines", solid)
    if find_spec("gmsh"):
        for name, save, more, dimension, group in (
                ("gmsh .msh 4.1, binary", "a.msh", Quads(binary=True), 2, "LEFT"),
                ("gmsh .msh, tri6", "a.msh", Quads(2, False), 2, "LEFT"),
                ("gmsh .inp, quads", "a.inp", Quads(), 2, "LEFT"), ("gmsh .inp, quad8", "a.inp", Quads(2), 2, "LEFT"),
                ("gmsh .bdf, tri3", "a.bdf", Quads(1, False), 2, ""),
                ("gmsh .med, solids", "a.med", Quads(2, False), 3, "LEFT"),
                ("gmsh .unv", "a.unv", Quads(), 2, "LEFT")):
            yield Input(kind, name, partial(plate, save, more, dimension, group))
    yield Input(kind, "pyNastran, CORD2R and long fields", turned)


def tdms(folder: Path) -> tuple[str, str]:
    """Two groups: force at 100 Hz, temperature at 1 Hz; the force is read whole, with its times."""
    import nptdms
    folder.mkdir(parents=True)
    force, oven = np.arange(500.0), np.linspace(20, 24, 5)
    with nptdms.TdmsWriter(folder / "a.tdms") as stream:
        stream.write_segment([
            nptdms.ChannelObject("Machine", "Force", force, {"unit_string": "kN", "wf_increment": 0.01}),
            nptdms.ChannelObject("Oven", "T", oven, {"unit_string": "degC", "wf_increment": 1.0})])
    log = Log.read(folder / "a.tdms")
    name = next(name for name in log.names if "orce" in name)
    return right_if(np.isclose(np.nanmax(log.column(name)), 499.0), log.names)


def sem(folder: Path) -> tuple[str, str]:
    """An image of a Zeiss microscope: the pixel of the file, not of the screen; one frame."""
    folder.mkdir(parents=True)
    text = "\r\n".join(["DP_IMAGE_STORE", "Store resolution = 50 * 40", "AP_IMAGE_PIXEL_SIZE",
                        "Image Pixel Size = 12.33 nm",
                        "AP_PIXEL_SIZE", "Pixel Size = 24.65 nm", ""])
    tifffile.imwrite(folder / "a.tif", STACK[0], extratags=[(34118, "s", 0, text, True)])
    stack = open_stack([folder / "a.tif"], with_gaps=True)
    pitch = stack.grid.pitch_mm
    return right_if(pitch is not None and np.allclose(pitch, 12.33e-6), (stack.n_frames, pitch))


def photron(folder: Path) -> tuple[str, str]:
    """12 bits packed, high byte first, and its .cih."""
    folder.mkdir(parents=True)
    values = DEEP.reshape(-1, 2).astype(np.uint32)
    packed = np.stack([values[:, 0] >> 4, (values[:, 0] & 15) << 4 | values[:, 1] >> 8, values[:, 1] & 255], -1)
    (folder / "a.mraw").write_bytes(packed.astype(np.uint8).tobytes())
    (folder / "a.cih").write_text("\n".join(f"{key} : {value}" for key, value in {
        "#Camera Information Header": "", "Date": "2025/11/3", "Camera Type": "FASTCAM SA-Z", "Record Rate(fps)": 2000,
        "Shutter Speed(s)": "1/20000", "Total Frame": 6, "Start Frame": -3, "Image Width": 50, "Image Height": 40,
        "Color Type": "Mono", "Color Bit": 12, "File Format": "MRaw", "EffectiveBit Depth": 12,
        "EffectiveBit Side": "Lower", "Comment Text": "", "Original Total Frame": 6, "Save Step": 1}.items()) + "\n")
    stack = open_stack([folder / "a.mraw"], with_gaps=True)
    pictures = np.array([np.asarray(stack.frame(k)) for k in range(stack.n_frames)])
    return right_if(np.array_equal(pictures, DEEP), (pictures.shape, pictures.ravel()[:4], DEEP.ravel()[:4]))


def heights(suffix: str, folder: Path) -> tuple[str, str]:
    """A film of three maps of a profilometer, a missing spot in each; µm, 2 µm per pixel."""
    import surfalize
    folder.mkdir(parents=True)
    truth = 3.0 + RNG.normal(0, 1, (3, 24, 36))
    truth[:, 5:8, 9:12] = np.nan
    for k, part in enumerate(truth):
        surfalize.Surface(part.copy(), 2.0, 2.0).save(folder / f"map{k}{suffix}")
    stack = open_stack(sorted(folder.glob(f"*{suffix}")), with_gaps=True)
    pictures = np.array([np.asarray(stack.frame(k)) for k in range(stack.n_frames)], dtype=float)
    offset = np.nanmean(pictures, axis=(1, 2), keepdims=True) - np.nanmean(truth, axis=(1, 2), keepdims=True)
    is_right = pictures.shape == truth.shape and np.allclose(pictures - offset, truth, atol=0.01, equal_nan=True)
    return right_if(is_right and np.allclose(stack.grid.pitch_mm, 2e-3), (pictures.shape, stack.grid.pitch_mm))


def devices() -> Iterator[Input]:
    """Devices."""
    yield Input("devices", "LabVIEW, two groups of other rates", tdms)
    yield Input("devices", "Zeiss, pixel of the file", sem)
    yield Input("devices", "Photron, 12 bits packed with .cih", photron)
    yield Input("devices", ".al3d, a missing spot", partial(heights, ".al3d"))
    yield Input("devices", ".sdf, a missing spot", partial(heights, ".sdf"))


def files() -> Iterator[Input]:
    """All of them."""
    yield from images()
    yield from meshes()
    yield from devices()

