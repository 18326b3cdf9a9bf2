"""The state of a run comes back to the last bit."""

import pytest

from idic.errors import InputError
from idic.identification.step.state import GENERALISED_REJECTED
from idic.identification import AcceptedPoint, LoopState, Trial
from idic.identification.step.state import Activation, EstimatorChoice, ParallelTrial, SchedulePosition, TrustRegion
from idic.run.store.state_file import load_state, save_state
from idic.run import STATE_FILE

ENTRY = {"evaluation": 0, "stage": 0, "accepted": True, "passed_over": False, "damping": 0.0, "phi": 12.5,
         "phi_image": 10.25, "rms_gv": 1.5, "values": {"BODY.E": 1 / 3, "BODY.nu": 0.1}, "message": ""}
STATE = LoopState(
    trial=Trial({"BODY.E": 2 / 3, "BODY.nu": 0.1},
                (ParallelTrial({"BODY.E": 1.1, "BODY.nu": float("inf")}, 1e-4 / 3, -1),), True, True),
    accepted=AcceptedPoint({"BODY.E": 1 / 3, "BODY.nu": 0.1}, 4, 1e5 / 7),
    trust=TrustRegion(0.7 / 3, 1e-3 / 3, 2), schedule=SchedulePosition(1, 2),
    activation=Activation(("BODY.E",), ("BODY.nu",), 1),
    estimator=EstimatorChoice(GENERALISED_REJECTED, {"BODY.E": 1 / 7, "BODY.nu": 0.3}),
    evaluations=7, parallel_evaluations=2, iteration=3, history=(ENTRY,))


@pytest.mark.parametrize("state", [STATE, LoopState(Trial({"BODY.E": 0.1}))], ids=["everything", "nothing yet"])
def test_a_state_comes_back_to_the_last_bit(state, tmp_path):
    save_state(tmp_path, state)
    assert load_state(tmp_path) == state


def test_an_altered_state_is_refused_and_a_missing_one_is_none(tmp_path):
    assert load_state(tmp_path) is None
    save_state(tmp_path, STATE)
    file = tmp_path / STATE_FILE
    file.write_text(file.read_text().replace('"evaluations": 7', '"evaluations": 8'))
    with pytest.raises(InputError, match="the checkpoint cannot be used"):
        load_state(tmp_path)
