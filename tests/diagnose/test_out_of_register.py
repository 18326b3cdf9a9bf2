"""`idic diagnose` where the model ends pixels off its images: judged by the measured motion, then by the images."""

import csv
import json

import pytest
from material_twins import TRUTHS, write_folder

import idic
from idic.diagnose import candidate_library
from idic.run import diagnose_run

COMPLIANCE = 0.06  # mm/N, between the grip and what measures its motion: 3.6 px at the largest force
FEW = ("grip_slip", "machine_compliance", "grip_rotation", "second_invariant", "geometric_nonlinearity", "force_offset",
       "lens_distortion", "magnification", "viscoelasticity", "orthotropy")


@pytest.fixture(scope="module")
def soft_machine(tmp_path_factory):
    """Rubber pulled by 48 px in a machine that gives way; the log has its motion before the machine gave way."""
    folder = tmp_path_factory.mktemp("soft_machine")
    write_folder(folder / "test", "clean_rubber")
    log = folder / "test" / "loads.csv"
    with log.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        row["grip_mm"] = float(row["grip_mm"]) + COMPLIANCE * float(row["force_N"])
    with log.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    result = idic.identify(folder / "test", folder / "run", workers=0)
    diagnose_run(folder / "run", library=tuple(one for one in candidate_library() if one.name in FEW))
    return result, json.loads((folder / "run" / "diagnosis.json").read_text())


@pytest.mark.slow  # an identification, a free FE-DIC and refits: 55 s of CPU time
def test_a_machine_that_gives_way_by_pixels_is_named_from_the_measured_motion(soft_machine):
    result, content = soft_machine
    assert result["residual"]["image_chi2_dof"] > 30.0
    register = content["register"]
    assert max(register["gap_px"]) > 1.0 and "out of register" in register["words"]
    assert content["verdict"] == "single" and content["named"] == ["machine_compliance"], content["headline"]
    assert register["image_chi2_before"] > 10.0 and register["image_chi2_after"] < 1.5


@pytest.mark.slow
def test_its_compliance_and_the_material_come_back(soft_machine):
    model = soft_machine[1]["model"]["parameters_after"]
    truth = {f"BODY.{name}": value for name, value in TRUTHS["clean_rubber"].values.items()}
    truth["boundary.RIGHT.x.compliance"] = COMPLIANCE
    for name, value in truth.items():
        assert abs(model[name]["value"] - value) < 3.0 * model[name]["std"], (name, model[name])
    assert model["BODY.C10"]["std"] < 0.02 * truth["BODY.C10"]
