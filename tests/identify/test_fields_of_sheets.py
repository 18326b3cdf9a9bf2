"""The change of thickness of a sheet as evidence: points of three coordinates around a hole (Kirsch 1898).

The truth is the closed solution of a plate with a round hole in tension; the sheet bends as it is pulled.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imsave
from typer.testing import CliRunner

from idic.cli.app import app
from idic.diagnose import JUDGEMENT, thinned
from idic.errors import InputError
from idic.experiment_file import load_experiment
from idic.identification import identify
from idic.model import build_forward
from idic.run import diagnose_run, identify_run
from idic_studies.cases.case import with_measured_start

E, NU, RADIUS, HALF, THICKNESS, STRESS, N_STAGES = 70e3, 0.3, 3.0, 8.0, 4.0, 200.0, 4
PLANE_UM, DEPTH_UM = 0.5, 0.6
BEND, SWAY = 2e-5, (0.03, 1e-3, -2e-3)  # 1/mm; mm, and tilts

EXPERIMENT = """
[experiment]
fields = "stages/*.csv"
mesh = { outline_mm = [[-8, -8], [8, -8], [8, 8], [-8, 8]], holes_mm = [[0.0, 0.0, 3.0]], \
element_mm = 2 }
kind = "plane_stress"
thickness_mm = 4.0
#keys
[sets]
ENDS = { where = "y < -7.99 or y > 7.99 or x < -7.99 or x > 7.99" }
TOP = { where = "y > 7.99" }
[material.ALL]
law = "elastic"
E = { value = 60e3, unit = "MPa", identify = true }
nu = { value = 0.25, identify = true }
[[boundary]]
nodes = "ENDS"
u = "measured"
[[channel]]
column = "force"
simulated = { reaction = "TOP", component = "y" }
noise_std = 20.0
"""


def kirsch(at: np.ndarray) -> np.ndarray:
    """Motion of the middle (x, y) and of the seen side (z) for a stress along y  # (n, 2) mm -> (n, 3) mm"""
    q, angle = RADIUS / np.hypot(*at.T), np.arctan2(-at[:, 0], at[:, 1])  # from the direction of the stress
    k, size = (3.0 - NU) / (1.0 + NU), STRESS * RADIUS * (1.0 + NU) / (4.0 * E)
    along = size * ((k + 1.0) / q * np.cos(angle) + 2.0 * q * ((k + 1.0) * np.cos(angle) + np.cos(3.0 * angle))
                    - 2.0 * q**3 * np.cos(3.0 * angle))
    across = size * ((k - 3.0) / q * np.sin(angle) + 2.0 * q * ((1.0 - k) * np.sin(angle) + np.sin(3.0 * angle))
                     - 2.0 * q**3 * np.sin(3.0 * angle))
    rise = -0.5 * THICKNESS * NU * STRESS / E * (1.0 - 2.0 * q**2 * np.cos(2.0 * angle))
    return np.column_stack([-across, along, rise])


def force() -> float:
    """Through the upper edge, N."""
    x = np.linspace(-HALF, HALF, 2001)
    q, angle = RADIUS / np.hypot(x, HALF), np.arctan2(x, HALF)
    twice, four = np.cos(2.0 * angle), np.cos(4.0 * angle)
    stress = STRESS * (1.0 - q**2 * (1.5 * twice + four) + 1.5 * q**4 * four)
    return float(np.trapezoid(stress, x)) * THICKNESS


def write_stages(folder: Path, side: int = 1) -> None:
    """side : -1 with z away from the cameras, x to the right and y downwards"""
    rng = np.random.default_rng(3)
    x, y = (axis.ravel() for axis in np.meshgrid(*[np.arange(-7.5, 8.0, 0.75)] * 2))
    at = np.column_stack([x, y])[np.hypot(x, y) > RADIUS + 0.6]
    full, (x, y) = kirsch(at), at.T
    bent = BEND * (0.5 * y**2 + 0.02 * y**3)
    slope = BEND * (y + 0.06 * y**2)
    (folder / "stages").mkdir(parents=True)
    for k in range(N_STAGES):
        share = k / (N_STAGES - 1)
        own = np.sin(3.0 * share)  # bending and sway go their own way
        u = share * full + own * np.column_stack([0.0 * x, -0.5 * THICKNESS * slope, bent])
        u[:, 2] += own * (SWAY[0] + SWAY[1] * x + SWAY[2] * y)
        u += rng.normal(0.0, 1e-3, u.shape) * [PLANE_UM, PLANE_UM, DEPTH_UM]
        now = (np.column_stack([at, np.zeros(len(at))]) + u) * [1, side, side]
        read = share * force() + rng.normal(0.0, 20.0)
        lines = ["# Units: length:mm angle:deg time:s force:N", f"# Stage: {k}", "stage;index;relative_time;date",
                 f'"{k}";{k};{k}.0;"now"', "# Name : Analog 0", "force;untransformed;transformed",
                 f"{read:.4f};0;{read:.4f}", "# Name : Surface 1", "id;x;y;z",
                 *(f"{i};{a:.6f};{b:.6f};{c:.6f}" for i, (a, b, c) in enumerate(now))]
        (folder / "stages" / f"stage_{k:03d}.csv").write_text("\n".join(lines))


def write_test(folder: Path, keys: str = "", side: int = 1) -> Path:
    write_stages(folder, side)
    (folder / "experiment.toml").write_text(EXPERIMENT.replace("#keys", keys))
    return folder


@pytest.fixture(scope="module")
def plate(tmp_path_factory):
    return with_measured_start(load_experiment(write_test(tmp_path_factory.mktemp("plate"))))


def without(experiment):
    return replace(experiment, recording=replace(experiment.recording,
                                                 points=replace(experiment.recording.points, depth=None)))


def test_the_change_of_thickness_determines_poissons_ratio(plate):
    experiment, start = plate
    assert "it is the change of thickness, up to 0." in " ".join(experiment.notes)
    found = identify(experiment, start).result
    own, alone = found["parameters"]["ALL.nu"], identify(without(experiment), start).result["parameters"]["ALL.nu"]
    assert found["status"] == "converged"
    assert abs(own["value"] - NU) < 3.0 * own["std"] and own["std"] < 0.9 * alone["std"]


def test_a_run_that_compares_the_change_of_thickness_is_diagnosed(tmp_path):
    """The rows along the normal have unknowns of their frame, which are no light."""
    run = tmp_path / "run"
    assert identify_run(write_test(tmp_path / "test"), run)["status"] == "converged"
    assert diagnose_run(run, library=(), quick=True)["verdict"]


@pytest.mark.parametrize("law", ["elastic", pytest.param("j2_linear", marks=pytest.mark.slow)])
def test_the_rise_follows_what_measured_ends_do(plate, law):
    experiment, _ = plate
    values = {"E": E, "nu": NU} | ({"yield_stress": 50.0, "hardening_modulus": 2e3} if law == "j2_linear" else {})
    folder = Path(experiment.folder)
    there = load_experiment(folder, {"material": {"ALL": {"law": law, **values}}})
    there = replace(there, model=replace(there.model, times=there.model.times[:3], reference=0))
    forward = build_forward(there)
    local, change = np.zeros((3, forward.drives.n_local)), np.zeros((3, forward.drives.n_local))
    k = forward.drives.n_local // 3
    local[1:, k + 1], change[2, k] = (0.02, 0.03), 1e-5

    def last(moved):
        return list(forward.march(there.model.parameters, (), moved, np.array(there.model.times[1:]), True))[-1]

    here, ahead, back = last(local), last(local + change), last(local - change)
    slope = (ahead.seen_u - back.seen_u)[:, 2] / 2e-5
    np.testing.assert_allclose(here.seen_local_du[:, 2, k], slope, atol=1e-4 * np.abs(slope).max())


def test_a_change_of_thickness_below_the_noise_is_not_compared_unless_asked_for(tmp_path, monkeypatch):
    monkeypatch.setitem(globals(), "DEPTH_UM", 3.0)
    there = load_experiment(write_test(tmp_path))
    assert there.recording.points.depth is None and "less than the noise along the normal (3" in " ".join(there.notes)
    assert thinned(there, JUDGEMENT, 0).recording.stack.frame(1).shape == (len(there.recording.points.positions_px), 2)
    file, text = tmp_path / "experiment.toml", (tmp_path / "experiment.toml").read_text()
    text = text.replace("thickness_mm", "fields_thickness_change = true\nthickness_mm")
    file.write_text(text)
    there = load_experiment(tmp_path)
    assert there.recording.points.depth.std_um == pytest.approx(3.0, rel=0.1)
    assert there.recording.stack.frame(1).shape[1] == 3
    assert thinned(there, JUDGEMENT, 0).recording.stack.frame(1).shape[1] == 3  # what a diagnosis fits
    file.write_text(text.replace("plane_stress", "plane_strain"))
    with pytest.raises(InputError, match="change of thickness cannot be compared"):
        load_experiment(tmp_path)


@pytest.mark.slow
def test_an_export_whose_z_points_away_from_the_cameras_says_so(tmp_path):
    write_test(tmp_path, 'fields_seen_from = "-z"', side=-1)
    own = identify(*with_measured_start(load_experiment(tmp_path))).result["parameters"]["ALL.nu"]
    assert abs(own["value"] - NU) < 3.0 * own["std"]


def test_of_a_field_as_wide_as_long_the_strain_tells_the_loaded_ends(tmp_path):
    write_stages(tmp_path)
    (tmp_path / "check").mkdir()
    imsave(tmp_path / "check" / "mesh.png", np.zeros((4, 4, 3)))  # of `idic check`, before the file was removed
    done = CliRunner().invoke(app, ["init", str(tmp_path)])
    text = (tmp_path / "experiment.toml").read_text()
    assert done.exit_code == 0 and "loaded end: the mean strain is larger along y" in text, done.output
    assert 'simulated = { reaction = "TOP", component = "y" }   # tension, by the mean strain' in text
