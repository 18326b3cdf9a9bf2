"""One ply from four specimens at once, as a stranger brings them: 0 degrees twice, 90 degrees, and V-notched shear.

Truth and export: `rail_shear.py`, another mesh and solver. Each specimen was cut askew, is as thick as it was measured
to 0.5 %, and has moduli of its own; the rails of the shear test slip, and only the travel of the machine is known.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

import pytest
from rail_shear import rail, strip, write_stages
from typer.testing import CliRunner

from idic.cli.app import app

PLY = {"E1": 60.0, "E2": 20.0, "nu12": 0.15, "G12": 4.0}  # GPa
SLIP = 0.03  # mm, of 0.25 mm
LAW = """[material.PLY]
law = "orthotropic"
E1 = {{ value = 50, unit = "GPa", identify = true }}
E2 = {{ value = 25, unit = "GPa", identify = true }}
nu12 = {{ value = 0.2, identify = true }}
G12 = {{ value = 5, unit = "GPa", identify = true }}
angle = {{ value = {0}, identify = true, prior = {{ mean = {0}, std = 1.0 }} }}

"""
THICKNESS = '[[dof]]\nname = "geometry.thickness"\nvalue = 2.0\nprior = { mean = 2.0, std = 0.01 }\n'
GRIPS = """[[boundary]]
nodes = "RIGHT"
ux = 0.0
uy = { column = "travel_mm", corrections = [{ kind = "slip", course = "jump", start_s = 7.0 }] }
[[boundary]]
nodes = "LEFT"
ux = 0.0
uy = 0.0
[camera]
motion = "free"
[[dof]]
name = "boundary.RIGHT.y.slip"
value = 0.0
"""


@dataclass(frozen=True)
class Cut:
    """stated, true : direction of the fibres from x, degrees; stiffer : factor of this specimen's force"""

    stated: float
    true: float
    stiffer: float

    @property
    def sheared(self) -> bool:
        return self.stated == 0.0 and self.true > 0.0


CUTS = {"zero-a": Cut(90.0, 90.6, 1.01), "zero-b": Cut(90.0, 89.6, 0.97), "ninety": Cut(0.0, -0.5, 1.0),
        "shear": Cut(0.0, 0.4, 1.0)}


def said(*arguments: object) -> str:
    """What a command prints, its lines joined."""
    shown = CliRunner().invoke(app, [str(word) for word in arguments])
    assert shown.exit_code == 0, shown.output
    return " ".join(shown.output.split())


def in_mpa(ply: dict) -> dict:
    return {name: value if name == "nu12" else 1e3 * value for name, value in ply.items()}


def filled_in(text: str, cut: Cut) -> str:
    """The file of `idic init` with the ply, the thickness, the width, and of the shear test its drawing and grips."""
    text = text[:text.index("[material.ALL]")] + LAW.format(cut.stated) + text[text.index("[[boundary]]"):]
    text = text.replace("# thickness_mm = 1.0 ", "thickness_mm = 2.0 ").replace("[0.75, 0.75]", "[1.25, 1.25]")
    if not cut.sheared:
        return text[:text.index("# facets end")] + THICKNESS
    drawn = [[round(float(value), 3) for value in corner] for corner in rail().outline]
    text = text.replace("outline_points_mm = 0.75, element_mm = 4.5", f"outline_mm = {drawn}, element_mm = 2.5")
    grips, channel = text.index("[[boundary]]"), text.index("[[channel]]")
    return text[:grips] + text[channel:text.index("# facets end")] + GRIPS + THICKNESS


@pytest.mark.slow
def test_a_ply_from_tension_along_and_across_and_from_shear_by_the_commands(tmp_path):
    for seed, (name, cut) in enumerate(CUTS.items(), start=1):
        folder = tmp_path / name
        write_stages(folder, rail() if cut.sheared else strip(), in_mpa(PLY), cut.true, size=1.2, seed=seed,
                     stiffer=cut.stiffer, slip=SLIP if cut.sheared else None)
        said("init", folder)
        file = folder / "experiment.toml"
        file.write_text(filled_in(file.read_text(encoding="utf-8"), cut), encoding="utf-8")
        assert "PLY.E1" in said("check", folder)
    out = tmp_path / "together"
    printed = said("identify", *(tmp_path / name for name in CUTS), "--out", out, "--no-prefect", "--workers", "0")
    result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    found = result["parameters"]
    assert result["status"] == "converged" and "PLY.E1" in printed
    for name, truth in PLY.items():
        own = found[f"PLY.{name}"]
        assert own["std"] < 0.05 * truth and abs(own["value"] - truth) < 3.0 * own["std"], (name, own)
    for name, cut in CUTS.items():
        own = found[f"{name}.PLY.angle"]
        assert own["std"] < 0.5 and abs(own["value"] - cut.true) < 3.0 * own["std"], (name, own)
    slip = found["shear.boundary.RIGHT.y.slip"]
    assert slip["value"] == pytest.approx(SLIP, abs=3.0 * slip["std"]) and slip["std"] < 0.1 * SLIP
    scatter = result["specimens"]["PLY.E1"]
    assert set(scatter["values"]) >= {"zero-a", "zero-b"} and scatter["between_std"] > 0.0
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "Specimen by specimen" in page and "between specimens" in page
