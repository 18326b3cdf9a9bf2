"""Without `idic[instruments]` the commands name the format and the command that installs it, and write nothing."""

import json
import subprocess
import sys

import pytest
import tifffile
from instrument_files import write_cine, write_mraw, write_plu

import numpy as np

FRAMES = np.random.default_rng(1).integers(0, 255, (3, 40, 60)).astype(np.uint16)
LIBRARIES = ("surfalize", "SurfaceTopography", "pyMRAW", "cinereader", "nptdms", "zs2decode", "openpyxl")
BLOCKED = f"""
import sys
for name in {LIBRARIES!r}:
    sys.modules[name] = None
from idic.cli import main
sys.argv = ["idic", *{{arguments}}]
main()
"""
INSTALL = "pip install 'idic[instruments]'"


def idic(*arguments):
    code = BLOCKED.format(arguments=json.dumps([str(argument) for argument in arguments]))
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)


def experiment(folder, images, quantity=""):
    (folder / "experiment.toml").write_text(f"""
[experiment]
images = "{images}"
{quantity}
mesh = {{ roi_px = [5, 5, 50, 30], element_px = 10 }}
kind = "plane_stress"
[material.SPECIMEN]
law = "elastic"
E = {{ value = 70e3, unit = "MPa" }}
nu = {{ value = 0.3, identify = true }}
[[boundary]]
nodes = "OUTER"
u = "measured"
""")


FILES = {"film.mraw": (lambda path: write_mraw(path, FRAMES, 16), "Photron", "pymraw"),
         "film.cine": (lambda path: write_cine(path, FRAMES, 16), "Phantom", "cinereader"),
         "map.plu": (lambda path: write_plu(path, FRAMES[0].astype(np.float32), 1.0), "Sensofar", "surfalize")}


@pytest.mark.parametrize("name", FILES)
def test_init_and_check_name_format_and_command(name, tmp_path):
    write, instrument, library = FILES[name]
    write(tmp_path / name)
    before = sorted(tmp_path.iterdir())
    result = idic("init", tmp_path)
    assert result.returncode == 2 and sorted(tmp_path.iterdir()) == before, result.stderr
    text = " ".join((result.stdout + result.stderr).split())
    assert instrument in text and library in text and INSTALL in text and "Traceback" not in text
    experiment(tmp_path, name, 'quantity = "height"\nheight_unit = "um"' if name == "map.plu" else "")
    result = idic("check", tmp_path)
    text = " ".join((result.stdout + result.stderr).split())
    assert result.returncode == 2 and INSTALL in text and not (tmp_path / "check").exists()


def test_init_names_the_library_of_stages_in_workbooks(tmp_path):
    (tmp_path / "stage_0.xlsx").write_bytes(b"PK" + bytes(60))
    result = idic("init", tmp_path)
    text = " ".join((result.stdout + result.stderr).split())
    assert result.returncode == 2 and "openpyxl" in text and INSTALL in text


def test_init_notes_a_log_that_it_cannot_read(tmp_path):
    for k, frame in enumerate(FRAMES):
        tifffile.imwrite(tmp_path / f"image_{k}.tif", frame)
    (tmp_path / "log.tdms").write_bytes(b"TDSm" + bytes(60))
    result = idic("init", tmp_path)
    assert result.returncode == 0, result.stderr
    text = " ".join((tmp_path / "experiment.toml").read_text().split())
    assert "log.tdms was not understood" in text and INSTALL in text
