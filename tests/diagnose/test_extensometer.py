"""A channel that is no reaction counts in scores, in the source map and beside a known error as it is simulated."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from side_twins import TIMES, TOML, Side, write_folder

from idic.diagnose.locate.adjoint_sources import element_scores
from idic.diagnose.locate.tangents import tangents
from idic.diagnose import Variant, candidate_library, residual_evidence
from idic.diagnose.screen.score_columns import score_columns
from idic.experiment_file import load_experiment
from idic.identification import identify
from idic.model import MotionError, build_forward, solve
from idic.parameters import ParameterSet

EXTENSOMETER = """
[sets]
NEAR = { where = "abs(x + 2) < 0.4" }
FAR = { where = "abs(x - 2) < 0.4" }

[[channel]]
column = "ext_mm"
simulated = { displacement = "FAR", component = "x", minus = "NEAR" }
noise_std = 1e-4
"""


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """A strip with an extensometer across its hole, identified."""
    path = write_folder(tmp_path_factory.mktemp("extensometer") / "run", Side(), toml=TOML + EXTENSOMETER)
    log = path.parent / "loads.csv"
    rows = list(csv.reader(log.read_text(encoding="utf-8").splitlines()))
    rows = [[*row, "ext_mm" if k == 0 else "0.0"] for k, row in enumerate(rows)]
    log.write_text("\n".join(",".join(row) for row in rows) + "\n", encoding="utf-8")
    experiment = load_experiment(path)
    read = solve(build_forward(experiment), experiment.model.parameters.with_values({"BODY.E": 2000.0,
                                                                                     "BODY.nu": 0.35}))
    force, extension = experiment.model.channels
    found = identify(replace(experiment, model=replace(experiment.model,
                                                       channels=(force,
                                                                 replace(extension, values=read.channels[:, 1])))))
    return path, found, residual_evidence(found, light=False)


def extension(found, **values):
    """Course of the extensometer at other values  # (n_frames,)"""
    parameters = found.parameters.with_values({f"BODY.{name}": value for name, value in values.items()})
    return solve(build_forward(found.experiment), parameters, found.local).channels[:, 1]


def test_a_candidate_changes_the_extensometer_as_its_simulation_does(measured):
    path, found, residual = measured
    nu = found.parameters["BODY.nu"].value
    trial = Variant("another nu", {}, ("BODY.nu",), {"BODY.nu": nu}, {"BODY.nu": nu + 1e-3}, exact=True)
    experiment = found.experiment
    _, columns = score_columns(found, residual, [(candidate_library()[0], trial)], lambda edits: experiment)
    change = extension(found, nu=nu + 1e-3) - extension(found)
    assert np.abs(change).max() > 1e-6
    np.testing.assert_allclose(columns.channels[:, 1, 0], change[residual.evidence.frames], rtol=0.02, atol=1e-9)


def test_an_element_moves_the_extensometer_in_the_source_map_as_its_stiffness_does(measured):
    _, found, residual = measured
    spot = np.arange(12, 20)
    *_, last = tangents(found, residual)
    n_seen = len(residual.evidence.seen)
    scored = element_scores(residual, last, np.zeros((n_seen, 1)), np.array([[0.0], [1.0]]))[:, 0]

    experiment = found.experiment
    (body,) = experiment.model.materials
    rest = np.setdiff1d(np.arange(experiment.model.mesh.n_elements), spot)
    mesh = replace(experiment.model.mesh, element_sets={"BODY": rest, "SPOT": spot})
    parameters = found.parameters
    own = [replace(one, name=one.name.replace("BODY.", "SPOT.")) for one in parameters.values()
           if one.name.startswith("BODY.")]
    parted = replace(experiment, model=replace(experiment.model, mesh=mesh,
                                               materials=(body, replace(body, element_set="SPOT")),
                                               parameters=ParameterSet([*parameters.values(), *own])))
    forward, E = build_forward(parted), parameters["BODY.E"].value
    read = [solve(forward, parted.model.parameters.with_values({"SPOT.E": E * (1.0 + share)}), found.local).channels[:,
                                                                                                                     1]
            for share in (-1e-3, 1e-3)]
    by_stiffness = (read[1] - read[0])[residual.evidence.frames[-1]] / 2e-3
    assert abs(by_stiffness) > 1e-6
    assert scored[spot].sum() == pytest.approx(by_stiffness, rel=1e-3)


def test_a_known_error_is_added_to_an_extensometer_once(measured):
    _, found, _ = measured
    mesh, n = found.experiment.model.mesh, len(TIMES)
    u, channels = np.zeros((n, *mesh.nodes.shape)), np.zeros((n, 2))
    u[-1, :, 0], channels[-1] = 1e-4 * mesh.nodes[:, 0], [5.0, 4e-4]
    known = replace(found.experiment, model=replace(found.experiment.model, motion_error=MotionError(u, channels)))
    more = solve(build_forward(known), found.parameters).channels - solve(build_forward(found.experiment),
                                                                          found.parameters).channels
    np.testing.assert_allclose(more, channels, atol=1e-9)
