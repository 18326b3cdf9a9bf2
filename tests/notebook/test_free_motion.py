"""The motion of images alone: without a law, in the measure of the log, and refused where nothing can be identified."""

import arrays
import numpy as np
import pytest

import idic
from idic.errors import InputError

CAMERA = {"pixel_size_mm": arrays.PIXEL, "origin_px": arrays.ORIGIN}


@pytest.fixture(scope="module")
def strip():
    data = arrays.recorded()
    return idic.Experiment(images=data.images, mesh=data.mesh, camera=CAMERA)


@pytest.fixture(scope="module")
def motion(strip):
    return strip.free_motion()


def test_the_grips_move_as_the_log_says(motion):
    right = motion.mesh.nodes[:, 0] > motion.mesh.nodes[:, 0].max() - 1.0
    assert motion.status == ["ok"] * len(arrays.GRIP)
    assert np.nanmean(motion.u[:, right, 0], axis=1) == pytest.approx(arrays.GRIP, abs=0.002)  # 0.02 px


def test_the_motion_is_that_of_the_same_experiment_with_a_law(motion):
    data = arrays.recorded()
    known = idic.Experiment(**data.tables(camera=CAMERA, title="Experiment")).free_motion()
    assert np.array_equal(motion.u_px, known.u_px, equal_nan=True)


def test_strain_is_that_of_the_displacement(motion):
    strain = motion.strain(-1, "small")
    assert strain.shape == (motion.mesh.n_nodes, 2, 2)
    assert np.nanmedian(strain[:, 0, 0]) == pytest.approx(arrays.GRIP[-1] / arrays.LENGTH, rel=0.2)
    with pytest.raises(InputError, match="no such frame"):
        motion.strain(len(arrays.GRIP))


def test_a_longer_regularisation_has_less_noise(strip, motion):
    smooth = strip.free_motion(length_px=80.0)
    assert smooth.stack.length_px == 80.0 > motion.stack.length_px
    rough = [np.nanstd(entry.strain(1)[:, 1, 1]) for entry in (motion, smooth)]
    assert rough[1] < 0.8 * rough[0]


def test_nothing_is_identified_and_nothing_written_without_a_law(strip, tmp_path):
    for out in (None, tmp_path / "run"):
        with pytest.raises(InputError, match="no parameter|nothing to identify"):
            idic.identify(strip, out)
    assert not (tmp_path / "run").exists()
    with pytest.raises(InputError, match=r"experiment\.kind"):
        idic.Experiment(images=arrays.recorded().images, mesh=arrays.recorded().mesh,
                        materials={"sheet": {"law": "elastic", "E": 1.0, "nu": 0.3}})


def test_heights_have_no_free_motion_without_a_law():
    with pytest.raises(InputError, match="no free motion"):
        idic.Experiment(images=arrays.recorded().images.astype(np.float32), mesh=arrays.recorded().mesh,
                        camera=CAMERA, quantity="height", height_unit="um")
