"""A twin that is heated in one place while it is pulled: with its infrared images all is found, without them all is
off.

The truth is computed on a finer mesh from the analytic temperature, the infrared images are rendered by
`idic.virtual_tests.rendering` on the deformed body, with their own coarser camera and noise.
"""

import numpy as np
import pytest
import tifffile
from twin_bodies import PIXEL, plate
from twin_runs import (
    FORCE, GRIPS, SHAPE, THICKNESS, Twin, clean_image, dense_speckle, judged, painted, solved, write_folder,
)

from idic.fe import Constraints, Direction, Body, Reaction, Section, march
from idic.images import Camera
from idic.laws import compile as compile_law
from idic.virtual_tests import Sensor

TWIN = Twin(noise=1.0)
TRUTH = {"BODY.E": 2000.0, "BODY.nu": 0.35, "BODY.alpha": 8e-5}
ROOM, TOP_K, INFRARED_NOISE = 21.5, 60.0, 0.1  # °C, K, K
COARSE = 2.0  # px of the camera per px of the infrared camera
INFRARED = Camera.from_table(COARSE * PIXEL, (34.4, 24.9), rotation_deg=0.7)
MATERIAL = """
[material.BODY]
law = "elastic"
E = { value = 1300, unit = "MPa", identify = true }
nu = { value = 0.25, identify = true }
"""
EXPANSION = 'alpha = { value = 2e-5, unit = "1/K", identify = true }\n'


def heated(X, time):
    """Temperature change (n,) K: a spot left of the middle that grows, then spreads."""
    rise, size = TOP_K * min(time, 3.0) / 3.0, 0.8 + 0.1 * time
    return rise * np.exp(-0.5 * ((X[:, 0] + 1.2) ** 2 + (X[:, 1] - 0.4) ** 2) / size**2)


@pytest.fixture(scope="module")
def records():
    """Clean images, force (n_frames,) and infrared images (n_frames, ny, nx) of the heated twin."""
    mesh = plate((12, 8))
    left, right = mesh.node_sets["LEFT"], mesh.node_sets["RIGHT"]
    dofs = np.concatenate([2 * right, 2 * right + 1, 2 * left, 2 * left + 1])
    basis = np.zeros((len(dofs), 1))
    basis[:len(right)] = 1.0
    section = Section("BODY", compile_law("elastic", None), np.arange(mesh.n_elements), TRUTH["BODY.alpha"])
    model = Body(mesh, "plane_stress", (section,), Constraints(dofs, basis, np.array(TWIN.grip)[:, None]), THICKNESS,
                  channels=(Reaction(2 * right),), temperature=np.array([heated(mesh.nodes, t) for t in TWIN.times]))
    states = [(s.u.copy(), s.channels[0])
              for s in march(model, {"BODY": np.array([TRUTH["BODY.E"], TRUTH["BODY.nu"]])}, np.array(TWIN.times))]
    texture = painted(dense_speckle(np.random.default_rng(7), 1.6, 20.0, 235.0, extent_px=300.0), TWIN.camera)
    sensor, rng = Sensor(SHAPE, background=25.0), np.random.default_rng(11)
    images = [clean_image(u, mesh.nodes, mesh.blocks, TWIN.camera, texture, sensor) for u, _ in states]
    wall = Sensor((50, 70), bits=0, background=ROOM)
    infrared = [clean_image(u, mesh.nodes, mesh.blocks, INFRARED, lambda X, t=t: ROOM + heated(X, t), wall)
                + INFRARED_NOISE * rng.standard_normal(wall.shape)
                for (u, _), t in zip(states, TWIN.times, strict=True)]
    return (np.array(images), np.array([force for _, force in states])), np.array(infrared)


def folder_of(tmp_path, records, material, with_infrared):
    clean, infrared = records
    matrix = [[round(float(x), 9) for x in row] for row in INFRARED.matrix]
    heat = ""
    if with_infrared:
        heat = ('\n[[boundary]]\ntemperature = { images = "infrared/*.tif", unit = "C", noise_std = 0.1, '
                f"matrix_px_per_unit = {matrix}, origin_px = [34.4, 24.9] }}\n")
    path = write_folder(tmp_path / "twin", TWIN, material + GRIPS + FORCE + heat, clean)
    if with_infrared:
        (path.parent / "infrared").mkdir()
        for k, image in enumerate(infrared):
            tifffile.imwrite(path.parent / "infrared" / f"ir_{k:02d}.tif", image.astype(np.float32))
    return path


def errors(result, names, by="std"):
    entries = result["parameters"]
    return {name: (entries[name]["value"] - TRUTH[name]) / entries[name][by] for name in names}


def test_stiffness_and_expansion_are_found_with_the_infrared_images(tmp_path, records):
    path = folder_of(tmp_path, records, MATERIAL + EXPANSION, True)
    result = judged(path)
    assert result["status"] == "converged"
    off = errors(result, TRUTH)
    assert all(abs(e) < 3.0 for e in off.values()), off
    # the spot's expansion moves its surroundings by 0.1 px, and every one of 7000 pixels knows 0.03 px of it
    assert result["parameters"]["BODY.alpha"]["std"] < 0.05 * TRUTH["BODY.alpha"]
    assert result["residual"]["image_chi2_dof"] == pytest.approx(1.0, abs=0.05)


def test_without_the_temperature_the_stiffness_is_off_by_many_standard_deviations(tmp_path, records):
    _, result = solved(folder_of(tmp_path, records, MATERIAL, False))
    off = errors(result, ("BODY.E", "BODY.nu"), "std_noise")  # std counts what is left, too
    assert max(abs(e) for e in off.values()) > 10.0, off


# what can be determined at all ----------------------------------------------------------------------------
def expansion_seen(field):
    """du/dalpha (n_nodes, 2) of a free body in the last frame, under a temperature change `field` (n_nodes,)."""
    mesh = plate()
    corner, other = int(mesh.node_sets["LEFT"][0]), int(mesh.node_sets["LEFT"][-1])
    dofs = np.array([2 * corner, 2 * corner + 1, 2 * other])
    section = Section("BODY", compile_law("elastic", None), np.arange(mesh.n_elements), 8e-5)
    model = Body(mesh, "plane_stress", (section,), Constraints(dofs, np.zeros((3, 0)), np.zeros((2, 0))), THICKNESS,
                  temperature=np.array([0.0 * field, field]))
    frame = list(march(model, {"BODY": np.array([2000.0, 0.35])}, np.array([0.0, 1.0]),
                       [Direction("alpha", expansion=0)]))[-1]
    return mesh.nodes, frame.du[:, :, 0]


def left_over(nodes, du):
    """Part of du that no magnification, shift or rotation of the camera explains, relative."""
    x, y = nodes.T
    zero, one = np.zeros(len(x)), np.ones(len(x))
    columns = np.stack([np.r_[x, y], np.r_[one, zero], np.r_[zero, one], np.r_[-y, x]], axis=1)
    seen = np.r_[du[:, 0], du[:, 1]]
    return np.linalg.norm(seen - columns @ np.linalg.lstsq(columns, seen, rcond=None)[0]) / np.linalg.norm(seen)


def test_uniform_warming_of_a_free_body_is_a_magnification_and_local_warming_is_not():
    nodes, du = expansion_seen(np.full(plate().n_nodes, 40.0))
    assert left_over(nodes, du) < 1e-10  # alpha and the camera's pixel_size are one unknown
    nodes, du = expansion_seen(heated(nodes, 3.0))
    assert left_over(nodes, du) > 0.1  # ten orders above: a good part has another shape
