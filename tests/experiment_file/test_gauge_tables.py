"""[[probe]], [[extensometer]], [[line]] and [[circle]] in experiment.toml: places, units, refusals."""

import numpy as np
import pytest
from small_experiment import TOML, write_experiment

from idic.errors import InputError
from idic.experiment_file import load_experiment

GAUGES = """
[[probe]]
name = "P"
at_mm = [1.0, 2.0]
[[extensometer]]
from_mm = [0.5, 0.0]
to_mm = [0.5, 3.0]
[[line]]
name = "cut"
from_px = [10.0, 25.0]
to_px = [50.0, 25.0]
points = 5
[[circle]]
centre_mm = [2.0, 1.5]
radius_px = 5.0
"""


def load(folder, more):
    return load_experiment(write_experiment(folder / "test", TOML + more))


def test_gauges_are_places_on_the_mesh_and_change_nothing_of_the_identity(tmp_path):
    plain = load(tmp_path / "a", "")
    found = load(tmp_path / "b", GAUGES.replace("radius_px = 5.0", "radius_mm = 0.5"))
    assert found.recording.identity == plain.recording.identity and not plain.gauges
    probe, extensometer, line, circle = found.gauges
    assert probe.name == "P" and probe.points_mm == ((1.0, 2.0),)
    assert extensometer.name == "extensometer 1" and extensometer.length_mm == 3.0
    # 0.1 mm per px from the origin (10, 40), rows down: columns 10 and 50 are x = 0 and 4, row 25 is y = 1.5
    assert np.allclose(line.places, np.column_stack([np.linspace(0.0, 4.0, 5), np.full(5, 1.5)]))
    assert circle.radius_mm == 0.5 and np.allclose(circle.places.mean(axis=0), [2.0, 1.5])


@pytest.mark.parametrize("more, what", [
    (GAUGES, "the place of a gauge is not complete"),  # middle in mm, radius in px
    ("[[probe]]\nat_mm = [9.0, 2.0]\n", "a gauge beside the specimen"),
    ("[[probe]]\n", "the place of a gauge is not complete"),
    ("[[extensometer]]\nfrom_mm = [1.0, 1.0]\nto_mm = [1.0, 1.0]\n", "the two ends are one point"),
    ("[[probe]]\nname = \"a\"\nat_mm = [1.0, 1.0]\n[[line]]\nname = \"a\"\nfrom_mm = [0.0, 1.0]\nto_mm = [1.0, 1.0]\n",
     "two gauges of one name"),
    ("[[circle]]\ncentre_mm = [1.0, 1.0]\nradius_mm = -1.0\n", "greater than 0"),
    ("[[line]]\nfrom_mm = [0.0, 1.0]\nto_mm = [1.0, 1.0]\ncolour = \"red\"\n", "colour"),
])
def test_a_gauge_that_is_no_place_is_refused_with_its_key(tmp_path, more, what):
    with pytest.raises(InputError) as caught:
        load(tmp_path, more)
    text = str(caught.value)
    assert what in text and any(kind in text for kind in ("probe", "extensometer", "line", "circle")), text
