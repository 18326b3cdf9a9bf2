"""A law identified from volumes of a foreign mesh: in memory, as a RUN, with drift of the scanner and measured ends."""

import json
import pickle
from collections import OrderedDict
from dataclasses import replace

import numpy as np
import pytest
from volumes.tomograms import TRUTH, VOXEL_MM, Tomograms

from idic.experiment_file import load_experiment
from idic.identification import identify
from idic.measure import volume_motion
from idic.run import identify_run, open_run, write_report

DRIFT_PX = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.8, -0.6, 0.4], [-0.5, 0.9, 0.7]])
FREE = 'motion = "free"\n'
HELD = "u = \"measured\"\n"


def deviations(parameters):
    """Of E and nu, in standard deviations."""
    return np.array([(parameters[f"BODY.{name}"]["value"] - truth) / parameters[f"BODY.{name}"]["std"]
                     for name, truth in TRUTH.items()])


@pytest.fixture(scope="module")
def result(bar):
    return identify(load_experiment(bar))


def test_the_law_is_found_within_its_error_bars(result):
    assert result.state.status == "converged"
    assert np.abs(deviations(result.result["parameters"])).max() < 3.0
    assert result.result["parameters"]["BODY.E"]["std"] < 0.05 * TRUTH["E"]


@pytest.fixture(scope="module")
def finished(bar, tmp_path_factory):
    """The result of a run, and its folder."""
    folder = tmp_path_factory.mktemp("finished") / "run"
    return identify_run(bar, folder), folder


def test_a_run_ends_with_the_bits_of_memory(result, finished):
    run, folder = finished
    in_memory = result.result["parameters"]
    for name, entry in run["parameters"].items():
        assert entry["value"] == in_memory[name]["value"]
    assert run["quantity"] == "volume"
    assert 0.8 < run["residual"]["image_chi2_dof"] < 1.3
    page = write_report(folder, paraview=True).read_text(encoding="utf-8")
    assert "residual" in page
    assert (folder / "figures" / "residual_maps.png").exists()
    assert (folder / "paraview" / "fields.pvd").exists()
    stored = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    assert stored["parameters"]["BODY.E"]["value"] == in_memory["BODY.E"]["value"]


class Counted:
    """Slices of a run, and the numbers of those that were read."""

    def __init__(self, slices):
        self.slices, self.n_frames, self.shape, self.read = slices, slices.n_frames, slices.shape, []

    def frame(self, k):
        self.read.append(k)
        return self.slices.frame(k)


@pytest.mark.parametrize(("kept", "n_read"), [(10, 10), (9, 40), (0, 40)])
def test_blocks_side_by_side_read_their_slices_once(bar, finished, monkeypatch, kept, n_read):
    """As far as the bound of what is kept allows; another process receives none of it."""
    volumes = open_run(str(finished[1])).experiment.recording.volumes
    _, rows, columns = volumes.shape
    monkeypatch.setattr("idic.run.store.slices.KEPT_BYTES", kept * volumes.slices.frame(0).nbytes)
    volumes = replace(volumes, slices=Counted(volumes.slices), recent=OrderedDict())
    scan = np.load(bar / "scans" / "scan_02.npy")
    for y in (slice(0, rows // 2), slice(rows // 2, rows)):
        for x in (slice(0, columns // 2), slice(columns // 2, columns)):
            np.testing.assert_array_equal(volumes.block(2, slice(5, 15), y, x), scan[5:15, y, x])
    assert len(volumes.slices.read) == n_read
    assert len(volumes.recent) <= kept
    assert not pickle.loads(pickle.dumps(volumes)).recent


@pytest.mark.slow
def test_scans_that_drift_are_put_back(tmp_path):
    """The place of every scan is a degree of freedom of the scanner: found to a few thousandths of a voxel."""
    result = identify(load_experiment(Tomograms(drift=DRIFT_PX, extra=FREE).write(tmp_path / "drift")))
    parameters = result.result["parameters"]
    assert result.state.status == "converged"
    for frame in (2, 3):
        for k, axis in enumerate("xyz"):
            entry = parameters[f"scanner.t_{axis}_at[{frame}]"]
            gap_px = (entry["value"] - VOXEL_MM * DRIFT_PX[frame, k]) / VOXEL_MM
            assert abs(gap_px) < max(3.0 * entry["std"] / VOXEL_MM, 0.02)
    assert np.abs(deviations(parameters)).max() < 3.0


def test_a_free_motion_needs_no_law(bar):
    """Free FE-DVC: the ends are where the machine has moved them, to a tenth of a voxel."""
    experiment = load_experiment(bar)
    measured = volume_motion(experiment)
    assert np.isnan(measured.u_mm[0]).all() and (measured.u_mm[1] == 0.0).all()  # the second scan is the reference
    model = experiment.model
    stroke = model.prescribed[-1].drive.values[-1]
    for name, expected in (("BOTTOM", 0.0), ("TOP", stroke)):
        gap_px = (measured.u_mm[-1][model.mesh.node_sets[name]] - [0.0, 0.0, expected]) / VOXEL_MM
        assert np.sqrt(np.mean(gap_px**2)) < 0.1


@pytest.mark.slow
def test_measured_ends_take_the_place_of_known_ones(bar, tmp_path):
    text = (bar / "experiment.toml").read_text()
    head, _, rest = text.partition("[[boundary]]")
    channel = rest[rest.index("[[channel]]"):]
    ends = "".join(f'[[boundary]]\nnodes = "{name}"\n{HELD}\n' for name in ("BOTTOM", "TOP"))
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "experiment.toml").write_text(head + ends + channel)
    for name in ("scans", "mesh.inp", "loads.csv"):
        (tmp_path / "experiment" / name).symlink_to(bar / name)
    run = identify_run(tmp_path / "experiment", tmp_path / "run")
    assert run["status"] == "converged"
    assert np.abs(deviations(run["parameters"])).max() < 3.0
