"""Several specimens of one material: shared parameters, directions of their own, and the scatter between them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2
from twin_runs import ELASTIC, FORCE, GRIPS, TRUTH, Twin, write_folder
from typer.testing import CliRunner

from idic.cli.app import app
from idic.experiment_file import load_experiment
from idic.identification import AcceptedPoint, Joint, evaluate_at, specimens_content, start
from idic.identification.specimens.scatter import scatter
from idic.parameters import JointPrior, ParameterSet
from idic.report import joint_page
from idic.run import identify_run

E1, E2, NU12, G12 = 60_000.0, 20_000.0, 0.15, 4_000.0
WIDTH, HEIGHT, THICKNESS = 12.0, 36.0, 2.0

EXPERIMENT = """
[experiment]
fields = "stages/*.csv"
mesh = {{ around_points_mm = [0.6, 0.6], element_mm = 4.0 }}
kind = "plane_stress"
thickness_mm = 2.0
[material.PLY]
law = "orthotropic"
E1 = {{ value = 50e3, unit = "MPa", identify = true }}
E2 = {{ value = 25e3, unit = "MPa", identify = true }}
nu12 = {{ value = 0.2, identify = true }}
G12 = {{ value = 5e3, unit = "MPa", identify = true }}
angle = {angle}
[[boundary]]
nodes = "TOP"
u = "measured"
[[boundary]]
nodes = "BOTTOM"
u = "measured"
[[channel]]
column = "force"
simulated = {{ reaction = "TOP", component = "y" }}
noise_std = 3.0
"""


def compliance(angle: float, stiffer: float) -> np.ndarray:
    """Strain (xx, yy, engineering xy) of stress along fibres at `angle` degrees from x, by hand  # (3, 3) 1/MPa"""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    T = np.array([[c * c, s * s, 2 * c * s], [s * s, c * c, -2 * c * s], [-c * s, c * s, c * c - s * s]])
    S = np.array([[1 / E1, -NU12 / E1, 0], [-NU12 / E1, 1 / E2, 0], [0, 0, 1 / G12]])
    return T.T @ S @ T / stiffer


def write_specimen(folder: Path, angle: float, stated: str | None = None, stiffer: float = 1.0, n: int = 6) -> Path:
    """Stages of a strip under uniform stress along y, whose ends turn freely: an affine motion, without a mesh."""
    rng = np.random.default_rng(int(angle) + int(1e3 * stiffer))
    x, y = np.meshgrid(np.arange(0.6, WIDTH, 1.2), np.arange(0.6, HEIGHT, 1.2))
    points = np.column_stack([x.ravel(), y.ravel()])
    (folder / "stages").mkdir(parents=True)
    for k in range(n):
        stress = 12.0 * k
        xx, yy, xy = compliance(angle, stiffer) @ [0.0, stress, 0.0]
        at = points + points @ np.array([[xx, 0.5 * xy], [0.5 * xy, yy]]) + rng.normal(0.0, 3e-4, points.shape)
        force = stress * WIDTH * THICKNESS + rng.normal(0.0, 3.0)
        lines = ["# Units: length:mm angle:deg time:s force:N", f"# Stage: {k}", "stage;index;relative_time;date",
                 f'"{k}";{k};{k}.0;"now"', "# Name : Analog 0", "force;untransformed;transformed",
                 f"{force:.4f};0;{force:.4f}",
                 "# Name : Surface 1", "id;x;y;z", *(f"{i};{a:.6f};{b:.6f};0.0" for i, (a, b) in enumerate(at))]
        (folder / "stages" / f"stage_{k}.csv").write_text("\n".join(lines))
    (folder / "experiment.toml").write_text(EXPERIMENT.format(angle=stated or f"{angle}"))
    return folder


def test_directions_that_differ_belong_to_their_specimen(tmp_path):
    folders = {f"s{angle}": write_specimen(tmp_path / f"s{angle}", angle, n=4) for angle in (0, 90)}
    joint = Joint.of({name: load_experiment(folder) for name, folder in folders.items()})
    assert set(joint.whole.model.parameters) == {"PLY.E1", "PLY.E2", "PLY.nu12", "PLY.G12", "s0.PLY.angle",
                                                 "s90.PLY.angle"}
    same = {name: load_experiment(folders["s0"]) for name in ("a", "b")}
    assert "PLY.angle" in Joint.of(same).whole.model.parameters
    own = {name: load_experiment(folders["s0"], {"material.PLY.E1.shared": False}) for name in ("a", "b")}
    assert {"a.PLY.E1", "b.PLY.E1", "PLY.E2"} <= set(Joint.of(own).whole.model.parameters)


@pytest.mark.slow  # 10 s of CPU time; two specimens below and above
def test_three_directions_give_the_four_constants_that_no_one_of_them_gives(tmp_path):
    turned = "{ value = 46.0, identify = true, prior = { mean = 45.0, std = 1.0 } }"  # cut and clamped to a degree
    folders = [write_specimen(tmp_path / "along", 90.0), write_specimen(tmp_path / "across", 0.0),
               write_specimen(tmp_path / "shear", 45.0, turned)]
    out = tmp_path / "run"
    result = identify_run(folders, out)
    assert result["status"] == "converged"
    for name, truth in (("E1", E1), ("E2", E2), ("nu12", NU12), ("G12", G12)):
        entry = result["parameters"][f"PLY.{name}"]
        assert entry["std"] < 0.1 * truth and abs(entry["value"] - truth) < 4.0 * entry["std"], name
    assert abs(result["parameters"]["shear.PLY.angle"]["value"] - 45.0) < 2.0
    specimens = result["specimens"]
    assert set(specimens["PLY.G12"]["values"]) <= {"shear"} and specimens["PLY.G12"]["between_std"] is None
    assert "Specimen by specimen" in joint_page(result)


@pytest.mark.slow  # 11 s of CPU time; the scatter of given values: below
def test_specimens_that_differ_are_told_apart_with_their_scatter(tmp_path):
    factors = {"a": 0.96, "b": 1.0, "c": 1.05}
    folders = [write_specimen(tmp_path / name, 0.0, stiffer=factor) for name, factor in factors.items()]
    locked = {f"material.PLY.{name}.identify": False for name in ("E1", "nu12", "G12")}
    locked |= {"material.PLY.E1.value": E1, "material.PLY.nu12.value": NU12, "material.PLY.G12.value": G12}
    result = identify_run(folders, tmp_path / "run", overrides=locked)
    found = result["specimens"]["PLY.E2"]
    for name, factor in factors.items():
        own = found["values"][name]
        assert abs(own["value"] - factor * E2) < 4.0 * own["std"] + 0.003 * E2  # 0.3 %: a step of 5 % to first order
    assert found["between_std"] == pytest.approx(np.std(list(factors.values()), ddof=1) * E2, rel=0.1)
    assert found["between_ci95"][0] < found["between_std"] < found["between_ci95"][1] and found["p_value"] < 1e-6
    assert found["mean"] == pytest.approx(np.mean(list(factors.values())) * E2, rel=0.005)
    assert "specimens differ by more than their error bars" in joint_page(result)


def said(*arguments: object) -> str:
    """What a command prints, its lines joined."""
    shown = CliRunner().invoke(app, [str(word) for word in arguments])
    assert shown.exit_code == 0, shown.output
    return " ".join(shown.output.split())


@pytest.mark.slow
def test_three_directions_from_init_to_the_report_by_the_command_line(tmp_path):
    """Each specimen is off by its own factor; its axes were cut by eye, its thickness measured to 0.5 %."""
    factors = {0: 1.02, 90: 1.0, 45: 0.985}
    folders = [tmp_path / f"s{angle}" for angle in factors]
    for folder, (angle, factor) in zip(folders, factors.items(), strict=True):
        write_specimen(folder, angle + 0.5, stiffer=factor, n=9)
        (folder / "experiment.toml").unlink()
        said("init", folder)
        file = folder / "experiment.toml"
        text = file.read_text(encoding="utf-8")
        law = "\n".join([EXPERIMENT[EXPERIMENT.index("law ="):EXPERIMENT.index("angle")].replace("{{", "{").replace(
            "}}", "}"), f"angle = {{ value = {angle}, identify = true, prior = {{ mean = {angle}, std = 1.0 }} }}", ""])
        open_margin = text[text.index('[[dof]]\nname = "geometry.outline"'):text.index("# [[dof]]")]
        text = text.replace(open_margin, "")  # the margin around the points, 0.6 mm, is that of the specimen
        thickness = '[[dof]]\nname = "geometry.thickness"\nvalue = 2.0\nprior = { mean = 2.0, std = 0.01 }\n'
        first, last = text.index("law ="), text.index("[[boundary]]")
        text = text[:first] + law + text[last:] + thickness
        file.write_text(text.replace("# thickness_mm = 1.0 ", "thickness_mm = 2.0 "), encoding="utf-8")
        assert "PLY" not in said("check", folder)  # init names the material ALL
    out = tmp_path / "all"
    printed = said("identify", *folders, "--out", out, "--no-prefect", "--workers", "0")
    result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert result["status"] == "converged" and "ALL.E1" in printed
    for name, truth in (("E1", E1), ("E2", E2), ("nu12", NU12), ("G12", G12)):
        entry = result["parameters"][f"ALL.{name}"]
        error = abs(entry["value"] - truth)  # specimens off by 2 %, of which one or two show a constant
        assert error < 3.0 * np.hypot(entry["std"], 0.02 * truth) and entry["std"] < 0.1 * truth, name
    for angle in factors:
        entry = result["parameters"][f"s{angle}.ALL.angle"]
        assert abs(entry["value"] - angle - 0.5) < 4.0 * max(entry["std"], 0.05), angle
    # one of them determines a constant, the others to 50 % and worse: nothing is said of a scatter
    assert all(len(found["values"]) == 1 and found["between_std"] is None for found in result["specimens"].values())
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "Specimen by specimen" in page


# priors, in memory ---------------------------------------------------------------------------------------
SCALE = '\n[[dof]]\nname = "channel.force_N.scale"\n'


@pytest.fixture(scope="module")
def recordings(clean, tmp_path_factory):
    """Three recordings of the standard twin, each with a load cell of unknown scale."""
    root, toml = tmp_path_factory.mktemp("specimens"), ELASTIC + GRIPS + FORCE + SCALE
    return {f"s{seed}": load_experiment(write_folder(root / f"s{seed}", Twin(seed=seed), toml, clean))
            for seed in (1, 2, 3)}


def with_priors(experiment, nu_std=None, joint=()):
    """The experiment with a prior of nu around 0.3, and with priors of several parameters together."""
    parameters = (replace(p, prior_mean=0.3, prior_std=nu_std) if p.name == "BODY.nu" and nu_std else p
                  for p in experiment.model.parameters.values())
    return replace(experiment, model=replace(experiment.model, parameters=ParameterSet(parameters, joint)))


def of_specimens(experiments):
    """What every specimen says of the shared parameters, at the true values."""
    joint = Joint.of(experiments)
    values = joint.whole.model.parameters.as_values() | {"BODY.E": TRUTH["E"], "BODY.nu": TRUTH["nu"]}
    state = replace(start(joint.whole), accepted=AcceptedPoint(values))
    found = {name: evaluate_at(e, joint.values_of(name, values), np.zeros((e.model.n_frames, 0)))
             for name, e in experiments.items()}
    return specimens_content(joint, state, {name: point for name, (point, _) in found.items()},
                             {name: weights.image_noise for name, (_, weights) in found.items()},
                             dict.fromkeys(experiments, "not asked for"))


def test_the_mean_of_specimens_is_in_the_unit_of_their_values_under_a_wide_prior(recordings):
    """A prior wider than the scale of a parameter makes its scaled unit: no specimen has that prior."""
    plain, wide = (of_specimens({name: with_priors(e, nu_std) for name, e in recordings.items()})["BODY.nu"]
                   for nu_std in (None, 0.4))
    values = [own["value"] for own in plain["values"].values()]
    assert min(values) < plain["mean"] < max(values)
    for key in ("mean", "mean_std", "between_std", "between_ci95"):
        assert wide[key] == pytest.approx(plain[key], rel=1e-6), key


def test_specimens_keep_the_joint_priors_of_what_is_their_own_and_no_others(recordings):
    """A calibrated load cell: without what is known of its scale, the force says nothing of E."""
    calibrated = JointPrior(("channel.force_N.scale",), np.array([1.0]), np.array([[0.01**2]]))
    of_material = JointPrior(("BODY.nu",), np.array([0.3]), np.array([[1e-4**2]]))
    bare, known = (of_specimens({name: with_priors(e, joint=joint) for name, e in recordings.items()})
                   for joint in ((), (calibrated, of_material)))
    assert not bare["BODY.E"]["values"] and len(known["BODY.E"]["values"]) == 3
    for name, own in known["BODY.E"]["values"].items():
        assert own["std"] == pytest.approx(0.01 * own["value"], rel=0.2)  # beside 0.3 % by the noise
        assert known["BODY.nu"]["values"][name] == pytest.approx(bare["BODY.nu"]["values"][name], rel=1e-3)


# the scatter alone --------------------------------------------------------------------------------------
def test_equal_specimens_show_no_scatter_and_a_lone_one_cannot():
    found = scatter([1.0, 1.1, 0.9], [0.2, 0.2, 0.2])
    assert found.std == 0.0 and found.ci95[0] == 0.0 and found.mean == pytest.approx(1.0) and found.p_value > 0.5
    with pytest.raises(ValueError, match="one specimen"):
        scatter([1.0], [0.1])


def test_exact_values_scatter_as_their_sample_standard_deviation():
    y = np.array([1.0, 1.3, 0.8, 1.1])
    found = scatter(y, np.full(4, 1e-9))
    assert found.std == pytest.approx(np.std(y, ddof=1), rel=1e-9)
    exact = np.sqrt(3 * np.var(y, ddof=1) / chi2.ppf([0.975, 0.025], 3))  # the interval of a normal sample
    np.testing.assert_allclose(found.ci95, exact, rtol=1e-9)


def test_the_interval_holds_the_scatter_as_often_as_it_says():
    rng = np.random.default_rng(3)
    tau, stds, n = 0.5, np.array([0.2, 0.4, 0.6, 0.3]), 2000
    held = 0
    for _ in range(n):
        found = scatter(rng.normal(0.0, np.hypot(tau, stds)), stds)
        held += found.ci95[0] <= tau <= found.ci95[1]
    assert 0.94 < held / n < 0.96  # three standard errors of 2000 draws are 0.015; Q is chi-square exactly
