"""A point that another stage or another estimator looks at again is not simulated again."""

from dataclasses import replace

import numpy as np
import pytest
from twin_runs import ELASTIC, FORCE, GRIPS, Twin, identify, write_folder

from idic.run import BASE, FrameArrays, SimulationJob, group_name, open_run, read_array, write_array
from idic.run.prepared.tasks import simulate
from idic.run.store.arrays import Damaged
from idic.run.store.state_file import load_state


@pytest.fixture(scope="module")
def accepted(tmp_path_factory):
    """An identified RUN and a job that simulates its accepted point once more, as the evaluation after it."""
    folder = tmp_path_factory.mktemp("same")
    noisy = GRIPS.replace('"grip_mm" }', '"grip_mm", noise_std = 0.0005 }')
    path = write_folder(folder / "case", Twin(grip_noise=0.0005), ELASTIC + noisy + FORCE)
    identify(path, folder / "run")
    context, state = open_run(str(folder / "run")), load_state(folder / "run")
    steps = tuple(read_array(context.store.group(group_name(state.accepted.number, BASE)), "steps"))
    job = SimulationJob(str(folder / "run"), 90, BASE, state.accepted.values, context.moving, steps=steps,
                        warm_start=(state.accepted.number, state.accepted.values))
    return context.store, job


def start_at(store, job, shift=0.0):
    here = read_array(store.group(group_name(job.warm_start[0], "start")), "local")
    store.remove(group_name(job.evaluation, BASE))
    with store.building(group_name(job.evaluation, "start")) as folder:
        write_array(folder, "local", here + shift)


def displacements(store, number):
    array = FrameArrays.open(store.group(group_name(number, BASE)), "u")
    return array.read(0, array.n_frames)


def test_the_same_values_take_the_simulation_that_is_there(accepted):
    store, job = accepted
    start_at(store, job)
    assert simulate(job).seconds == 0.0
    np.testing.assert_array_equal(displacements(store, 90), displacements(store, job.warm_start[0]))


def test_another_value_or_another_grip_motion_is_simulated(accepted):
    store, job = accepted
    start_at(store, job)
    assert simulate(replace(job, values=job.values | {"BODY.E": 1.01 * job.values["BODY.E"]})).seconds > 0.0
    start_at(store, job, shift=1e-3)
    assert simulate(job).seconds > 0.0
    assert not np.array_equal(displacements(store, 90), displacements(store, job.warm_start[0]))


def test_a_damaged_simulation_is_not_repeated(accepted):
    """A linear body reads no warm start (`idic.fe.superposition`): it is simulated anew."""
    store, job = accepted
    start_at(store, job)
    sound = displacements(store, job.warm_start[0])
    chunk = next((store.group(group_name(job.warm_start[0], BASE)) / "u").glob("c/1/*/*"))
    content = bytearray(chunk.read_bytes())
    content[len(content) // 2] ^= 1
    chunk.write_bytes(content)
    with pytest.raises(Damaged):
        displacements(store, job.warm_start[0])
    assert simulate(job).seconds > 0.0
    np.testing.assert_array_equal(displacements(store, job.evaluation), sound)
