"""A thick bar that necks before one lens at 300 mm: what a telecentric model makes of it, and the model with the lens.

The truth is idic's own simulation on the mesh and with the increments of the model, seen through the lens by ray
tracing, so that what is wrong is the camera's. CalculiX on the same mesh (`necking_bar.truth`) differs in its finite
strains by as much as the lens in E: see docs/cameras.md.
"""

import numpy as np
import pytest
from necking_bar import GRIP, USER, VALUES, bar, telecentric, write_bar

from idic.experiment_file.load import load_experiment
from idic.identify.in_memory import identify
from idic.identify.result import Analysis
from idic.model.forward import build_forward

TRUTH = {f"BODY.{name}": value for name, value in VALUES.items()}
INCREMENTS = "\n[options]\nsubsteps = 8\n"


def found_with(file):
    """Errors over the standard deviations by noise, and the mean square of the images' residual."""
    file.write_text(file.read_text() + INCREMENTS)
    found = identify(load_experiment(file))
    analysis = Analysis(found.experiment, found.parameters, found.point, found.weights.image_noise)
    system = found.point.system
    return (np.array([(found.parameters[name].value - TRUTH[name]) / analysis.std(name) for name in analysis.names]),
            system.phi_image / system.n_pixels)


@pytest.mark.slow  # a minute of processor time
def test_a_telecentric_model_is_biased_where_a_thick_bar_necks_and_the_lens_is_not(tmp_path):
    mesh, still = bar(USER), np.zeros(len(GRIP))
    blank = write_bar(tmp_path / "blank", (mesh, np.zeros((len(GRIP), mesh.n_nodes, 3)), still))
    blank.write_text(blank.read_text() + INCREMENTS)
    experiment = load_experiment(blank)
    logged = next(entry.drive.values for entry in experiment.prescribed
                  if entry.nodes == "RIGHT" and entry.component == "x")
    states = build_forward(experiment).march(experiment.parameters.with_values(TRUTH), (), (GRIP - logged)[:, None],
                                             None, True)
    u, force = zip(*((state.u.copy(), state.channels[0]) for state in states), strict=True)
    truth = mesh, np.array(u), np.array(force)
    assert truth[1][-1][np.abs(mesh.nodes[:, 2]) < 1e-9, 2].min() < -0.5  # mm: the front recedes in the neck
    lens, chi2 = found_with(write_bar(tmp_path / "lens", truth, seed=3))
    flat, flat_chi2 = found_with(write_bar(tmp_path / "flat", truth, telecentric(), seed=3))
    print(lens.round(1), flat.round(1), chi2, flat_chi2)
    assert np.abs(lens).max() < 3.0
    assert np.abs(flat).max() > 5.0 and flat_chi2 > 3.0 * chi2
