"""Whatever line a warning of `idic check` tells to write, this kind of experiment can have it, and then it is gone."""

import re
import shutil

import numpy as np
import pytest
from report.cause_worlds import E_MPA, FORCE, HEIGHT_MM, LENGTH_MM, N, NU, RAMP, WRONG
from report.test_causes import checked

LINE = re.compile(r"(\w+) = (\"[^\"]*\"|\[.*?\]) under \[(\w+)\]")
LENS = """name = "camera"
model = "pinhole"
fx_px = 3000.0
fy_px = 3000.0
cx_px = 125.0
cy_px = 60.0
rotation = [[1, 0, 0], [0, -1, 0], [0, 0, -1]]
translation_mm = [-10.0, 0.0, 300.0]
noise_std_gv = 1.5
"""


def images(folder, name):
    return WRONG[name][0]().write(folder)


def two_cameras(folder, name):
    images(folder, name)
    shutil.copytree(folder / "images", folder / "second")
    head, camera, rest = parts(folder)
    further = f'[[camera]]\nname = "second"\nimages = "second/*.tif"\n{camera}'
    (folder / "experiment.toml").write_text(f'{head}[[camera]]\nname = "first"\n{camera}{further}{rest}')
    return folder


def lens(folder, name):
    images(folder, name)
    head, _, rest = parts(folder)
    (folder / "experiment.toml").write_text(f"{head}[[camera]]\n{LENS}{rest}")
    return folder


def parts(folder):
    """experiment.toml before, in and after [camera]."""
    head, _, rest = (folder / "experiment.toml").read_text().partition("[camera]\n")
    camera, _, rest = rest.partition("[material")
    return head, camera, f"[material{rest}"


def fields(folder, name, sides="held"):
    """Displacements of points in the place of images; sides : "held" and driven by the log, or "measured"."""
    folder.mkdir()
    x, y = (each.ravel() for each in np.meshgrid(np.arange(0.25, 20, 0.5), np.arange(-3.75, 4, 0.5)))
    rng, is_broken = np.random.default_rng(4), name.startswith("broken")
    rows = ["stage,x_mm,y_mm,ux_mm,uy_mm"]
    for k, strain in enumerate(RAMP):
        strain, moved = (0.0, 0.0) if is_broken and k >= 9 else (strain, 0.0 if is_broken or not k else 0.2)
        ux, uy = strain * x + moved, -NU * strain * y - 0.5 * moved
        rows += [f"{k},{a:.3f},{b:.3f},{u + rng.normal(0, 5e-4):.6f},{v + rng.normal(0, 5e-4):.6f}"
                 for a, b, u, v in zip(x, y, ux, uy, strict=True)]
    (folder / "fields.csv").write_text("\n".join(rows) + "\n")
    force = np.where(is_broken & (np.arange(N) >= 9), 0.0, FORCE)
    (folder / "loads.csv").write_text("force_N,grip_mm\n" + "\n".join(
        f"{f:.2f},{LENGTH_MM * e:.6f}" for f, e in zip(force, RAMP, strict=True)) + "\n")
    held = "ux = 0.0\nuy = 0.0" if sides == "held" else 'u = "measured"'
    pulled = 'ux = { column = "grip_mm" }\nuy = 0.0' if sides == "held" else 'u = "measured"'
    (folder / "experiment.toml").write_text(f"""[experiment]
fields = "fields.csv"
loads = "loads.csv"
mesh = {{ around_points_mm = [0.25, 0.25], element_mm = 4 }}
kind = "plane_stress"
thickness_mm = 2.0
[material.SPECIMEN]
law = "elastic"
E = {{ value = {E_MPA}, unit = "MPa", identify = true }}
nu = 0.3
[[boundary]]
nodes = "LEFT"
{held}
[[boundary]]
nodes = "RIGHT"
{pulled}
[[channel]]
column = "force_N"
simulated = {{ reaction = "RIGHT", component = "x" }}
""")
    assert HEIGHT_MM == 8.0
    return folder


def measured_sides(folder, name):
    return fields(folder, name, sides="measured")


def written(folder, output):
    """The lines that the warnings tell, written into the file; how many."""
    file = folder / "experiment.toml"
    lines = LINE.findall(output)
    for key, value, table in lines:
        text = file.read_text()
        assert not re.search(rf"^{key} =", text, re.MULTILINE)
        header = f"[{table}]\n" if f"[{table}]\n" in text else f"[[{table}]]\n"
        if header not in text:
            text = f"{text}[{table}]\n"
            header = f"[{table}]\n"
        file.write_text(text.replace(header, f"{header}{key} = {value}\n", 1))
    return len(lines)


@pytest.mark.parametrize("kind", [images, two_cameras, lens, fields])
@pytest.mark.parametrize("name", ["jump, shifted", "broken late"])
def test_the_line_that_is_told_can_be_written_and_mends_it(tmp_path, kind, name):
    folder = kind(tmp_path / "test", name)
    told = " ".join(checked(folder))
    assert written(folder, told), told
    again = " ".join(checked(folder))
    assert "idic:" not in again and "rigid body" not in again and "stays low" not in again, again


def test_sides_that_are_measured_move_with_the_specimen_and_a_break_is_told(tmp_path):
    assert "rigid" not in " ".join(checked(measured_sides(tmp_path / "moved", "jump, shifted")))
    folder = measured_sides(tmp_path / "test", "broken late")
    told = " ".join(checked(folder))
    assert "stays low" in told and written(folder, told) == 1
    assert "stays low" not in " ".join(checked(folder))
