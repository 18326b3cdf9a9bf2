"""[[crack]]: what it makes of mesh and parameters, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from experiment_file.small_experiment import TOML, write_experiment

from idic.errors import InputError
from idic.experiment_file import load_experiment
from idic.model import build_forward

CRACK = """
[[crack]]
name = "edge"
path_mm = [[-0.5, 1.5], [3.0, 1.6]]
length_mm = { value = 1.2, identify = true }
"""


def test_a_crack_is_a_cut_and_its_length_a_degree_of_freedom(tmp_path):
    plain = load_experiment(write_experiment(tmp_path / "plain", TOML)).model
    model = load_experiment(write_experiment(tmp_path / "test", TOML + CRACK)).model
    (crack,) = model.cracks
    assert crack.names == ("crack.edge.length",) and "crack.edge.length" in model.parameters.free
    assert model.parameters["crack.edge.length"].bounds == (0.0, pytest.approx(np.hypot(3.0, 0.0857), abs=1e-3))
    assert model.mesh.n_nodes > plain.mesh.n_nodes
    forward = build_forward(load_experiment(tmp_path / "test" / "experiment.toml"))
    assert forward.moves("crack.edge.length") and not forward.moves("crack.other.length")
    (seam,) = forward.body_at(model.parameters.with_values({"crack.edge.length": 2.0})).seams
    assert seam.tips == pytest.approx(2.0)


def test_a_length_with_knots_is_linear_between_them_and_stays_outside(tmp_path):
    text = CRACK + "knots = [1, 3]\nlengths_mm = [0.8, 2.0]\n"
    model = load_experiment(write_experiment(tmp_path / "test", TOML + text)).model
    names = ("crack.edge.length_knot[1]", "crack.edge.length_knot[3]")
    assert model.cracks[0].names == names and set(names) <= set(model.parameters.free)
    assert model.tips_at(model.parameters)[:, 0] == pytest.approx([0.8, 0.8, 1.4, 2.0])


@pytest.mark.parametrize("change, message", [
    (("value = 1.2", "value = 9"), "longer than its path"), (("[3.0, 1.6]", "[9.0, 1.6]"), "leaves the body"),
    (("identify = true }", "identify = true }\nknots = [3, 1]"), "knots that do not increase"),
    (("identify = true }", "identify = true }\nknots = [1, 77]"), "a knot that is no frame"),
    (("identify = true }", "identify = true }\nlengths_mm = [1, 2]"), "another number of lengths"),
    (('name = "edge"', 'name = "2nd one"'), "name")])
def test_what_does_not_fit_is_refused_by_its_key(tmp_path, change, message):
    with pytest.raises(InputError) as refused:
        load_experiment(write_experiment(tmp_path / "test", TOML + CRACK.replace(*change)))
    assert message in str(refused.value) and "crack[0]" in str(refused.value).replace("crack.0", "crack[0]")


def test_two_of_one_name_and_a_mesh_that_moves_are_refused(tmp_path):
    with pytest.raises(InputError, match="two cracks of one name"):
        load_experiment(write_experiment(tmp_path / "two", TOML + CRACK + CRACK))
    with pytest.raises(InputError, match="a model that cannot have one"):
        load_experiment(write_experiment(tmp_path / "hole", TOML + CRACK + '[[dof]]\nname = "geometry.hole_radius"\n'))
