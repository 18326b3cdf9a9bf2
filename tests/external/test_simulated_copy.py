"""`idic simulate` of a test whose body an external program simulates."""

import pytest
from strip import write_strip

from idic.experiment_file import load_experiment
from idic.model import build_forward, solve
from idic.virtual_tests import simulate


def test_a_simulated_experiment_brings_its_solver_along(tmp_path):
    """Template and files lie in a folder of the new experiment, which the solver simulates again."""
    folder = write_strip(tmp_path / "strip")
    toml = simulate(folder, tmp_path / "virtual", {"BODY.E": 2.0, "BODY.nu": 0.35})
    names = ["nodes.txt", "strange_solver.py", "strip.deck.template"]
    assert sorted(path.name for path in (toml.parent / "solver").iterdir()) == names
    for name in names:
        assert (toml.parent / "solver" / name).read_bytes() == (folder / name).read_bytes()
    again = build_forward(load_experiment(toml))
    solution = solve(again, again.model.parameters)
    # the logged force has noise of 0.5 N
    assert solution.channels[:, 0] == pytest.approx(again.model.channels[0].values, abs=2.5)
