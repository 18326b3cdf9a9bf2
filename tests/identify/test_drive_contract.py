"""Every kind of drive keeps one contract: degrees of freedom, histories, derivatives and local unknowns."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from experiment_file.small_experiment import load, write_experiment
from idic.errors import InputError
from idic.model import COMPONENTS, Constant, Drive, DriveTable

MOTION = 'uy = { column = "grip_um", noise_std = 0.2 }'
DRIVES = {
    "constant": "uy = 0.01",
    "column": 'uy = { column = "grip_um" }',
    "noisy column": MOTION,
    "column with an offset": 'uy = { column = "grip_um", identify_offset = true }',
    "corrected column": 'uy = { column = "grip_um", corrections = [{ kind = "slip", start_s = 1.0, course = "ramp" }, '
                        '{ kind = "compliance", column = "force_kN" }] }',
    "measured": 'uy = "measured"',
    "modes": 'uy = { virtual = "bspline", modes = 2, time_modes = 2 }',
    "controlled": 'uy = { controlled_by = { displacement = "TOP", component = "y", minus = "BOTTOM", '
                  'column = "grip_um" } }',
}


@pytest.fixture(params=DRIVES)
def experiment(request, tmp_path):
    """The small experiment with this motion of its upper end."""
    return load(write_experiment(tmp_path / "test"), MOTION, DRIVES[request.param])


def upper_end(experiment):
    return next(entry for entry in experiment.model.prescribed if (entry.nodes, entry.component) == ("TOP", "y"))


def test_a_table_holds_every_degree_of_freedom_once(experiment):
    table, entry = DriveTable.of(experiment), upper_end(experiment)
    dofs = experiment.model.node_set(entry.nodes) * experiment.model.n_dim + COMPONENTS.index(entry.component)
    assert set(dofs) <= set(table.dofs) and len(set(table.dofs)) == len(table.dofs)
    assert table.basis.shape == (len(table.dofs), len(table.names)) and len(set(table.names)) == len(table.names)
    assert table.columns.shape == (experiment.model.n_frames, len(table.names))


def test_a_motion_begins_at_the_reference(experiment):
    """A constant is there from the start, and of a noisy log the reading of the reference is an unknown, too."""
    drive = upper_end(experiment).drive
    if isinstance(drive, Constant) or getattr(drive, "noise_std", 0.0) > 0.0:
        pytest.skip("does not begin at zero")
    assert not DriveTable.of(experiment).histories(experiment.model.parameters)[experiment.model.reference].any()


def test_histories_follow_the_parameters_by_their_derivatives(experiment):
    table, parameters = DriveTable.of(experiment), experiment.model.parameters
    for name, derivative in table.derivatives.items():
        ahead, behind = (table.histories(parameters.with_values({name: parameters[name].value + s * 1e-3}))
                         for s in (1.0, -1.0))
        np.testing.assert_allclose((ahead - behind) / 2e-3, derivative, atol=1e-12)  # rounding: they are linear


def test_local_unknowns_have_a_prior_and_move_one_drive_each(experiment):
    table = DriveTable.of(experiment)
    assert table.local_precision.shape == (table.n_local, table.n_local) and table.measured.shape == (table.n_local,)
    np.testing.assert_array_equal(table.local_precision, table.local_precision.T)
    assert (np.linalg.eigvalsh(table.local_precision) > 0.0).all()
    local = np.zeros((experiment.model.n_frames, table.n_local))
    for k, drive in enumerate(table.local):
        local[-1] = np.eye(table.n_local)[k]
        moved = table.histories(experiment.model.parameters, local) - table.histories(experiment.model.parameters)
        np.testing.assert_allclose(moved[-1], np.eye(len(table.names))[drive], atol=1e-12)  # rounding


def test_a_node_has_one_kind_of_drive(experiment, tmp_path):
    folder, other = tmp_path / "test", "uy = 0.02" if not isinstance(upper_end(experiment).drive, Constant) else MOTION
    with pytest.raises(InputError) as refused:
        DriveTable.of(load(folder, "[[channel]]", f'[[boundary]]\nnodes = "TOP"\n{other}\n\n[[channel]]'))
    assert refused.value.remedy


def test_every_kind_is_tried(tmp_path):
    kinds = {type(upper_end(load(write_experiment(tmp_path / str(k)), MOTION, text)).drive)
             for k, text in enumerate(DRIVES.values())}
    assert kinds == set(get_args(Drive))
