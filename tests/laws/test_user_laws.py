"""The page docs/add-a-law.md as a new user would try it: its file in a folder of his own, run by the commands."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path[:0] = [str(Path(__file__).parents[1] / "identify")]

from twin_runs import GRIPS, Twin, write_folder  # noqa: E402

from idic.errors import InputError  # noqa: E402
from idic.laws.core import law, user_laws  # noqa: E402

PAGE = Path(__file__).parents[2] / "docs" / "add-a-law.md"
RUBBER = """
[material.BODY]
law = "yeoh_2"
C1 = { value = 3.0, unit = "MPa", identify = true }
C2 = { value = 0.3, unit = "MPa", identify = true }
kappa = 100.0
[[channel]]
column = "force_N"
simulated = { reaction = "RIGHT", component = "x" }
noise_std = 0.02
"""


def idic(*words, cwd, **environment):
    return subprocess.run([sys.executable, "-m", "idic", *map(str, words)], cwd=cwd, capture_output=True, text=True,
                          env=os.environ | environment, check=False)


@pytest.fixture(scope="module")
def scratch(tmp_path_factory):
    """A folder with the file of the page."""
    folder = tmp_path_factory.mktemp("scratch")
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    (folder / "my_law.py").write_text(code)
    return folder


@pytest.mark.slow  # three commands; the test below runs two
def test_the_law_of_the_page_is_listed_and_drawn(scratch):
    listed = idic("--laws", "my_law.py", "laws", "yeoh_2", cwd=scratch)
    assert listed.returncode == 0 and "stiffening" in listed.stdout
    drawn = idic("--laws", "my_law.py", "laws", "yeoh_2", "--plot", "yeoh.png", cwd=scratch)
    assert drawn.returncode == 0 and (scratch / "yeoh.png").stat().st_size > 10_000
    unknown = idic("laws", "yeoh_2", cwd=scratch)
    assert unknown.returncode == 2 and "unknown constitutive law" in unknown.stderr and "--laws FILE" in unknown.stderr


@pytest.mark.slow  # compiles a law three times
def test_a_file_that_a_program_has_imported_and_compiled_serves_as_a_file_of_laws_in_any_order(scratch, tmp_path):
    """Numba keeps what it compiles under the file, with the name of the module in it."""
    (tmp_path / "mine.py").write_text((scratch / "my_law.py").read_text())
    (tmp_path / "other.py").write_text((scratch / "my_law.py").read_text().replace("yeoh_2", "yeoh_other"))
    compiled = "from idic.laws.core.compilation import compile; compile('yeoh_2', 'finite')"
    done = subprocess.run([sys.executable, "-c", f"import mine; {compiled}"], cwd=tmp_path, capture_output=True,
                          text=True, check=False, env=os.environ | {"PYTHONPATH": os.pathsep.join(
                              [str(tmp_path), *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))])})
    assert done.returncode == 0, done.stderr
    for files in (["mine.py"], ["other.py", "mine.py"]):
        laws = os.pathsep.join(str(tmp_path / file) for file in files)
        done = subprocess.run([sys.executable, "-c", f"from idic.laws.core.user_laws import load_user_laws; "
                               f"load_user_laws(); {compiled}"], capture_output=True, text=True,
                              env=os.environ | {"IDIC_LAWS": laws}, check=False)
        assert done.returncode == 0, done.stderr


@pytest.mark.slow  # compiles a law anew
def test_the_law_of_the_page_fulfils_the_contract(scratch):
    done = subprocess.run([sys.executable, "-m", "pytest", str(Path(__file__).parent), "-k", "yeoh", "-p",
                           "no:cacheprovider"], capture_output=True, text=True, check=False,
                          env=os.environ | {"IDIC_LAWS": str(scratch / "my_law.py")})
    assert done.returncode == 0, done.stdout
    assert int(re.search(r"(\d+) passed", done.stdout).group(1)) > 30


@pytest.mark.slow  # 16 s of CPU time; adding a law is seen in test_adding_a_law.py
def test_a_test_is_identified_with_the_law_of_the_page(scratch, monkeypatch):
    """The truth is computed with the same law, on a finer mesh."""
    monkeypatch.setattr(law, "_laws", dict(law._laws))
    monkeypatch.setenv("IDIC_LAWS", str(scratch / "my_law.py"))
    user_laws.load_user_laws()
    truth = {"C1": 2.5, "C2": 0.5, "kappa": 100.0}
    twin = Twin(law="yeoh_2", truth=truth, grip=tuple(np.linspace(0.0, 1.6, 6)), force_noise=0.02)
    write_folder(scratch / "test", twin, RUBBER + GRIPS)
    done = idic("--laws", "my_law.py", "identify", "test", "--out", "run", "--no-report", "--no-prefect", cwd=scratch)
    assert done.returncode == 0, done.stderr
    import json

    found = json.loads((scratch / "run" / "result.json").read_text())["parameters"]
    for name in ("C1", "C2"):
        entry = found[f"BODY.{name}"]
        assert entry["value"] == pytest.approx(truth[name], abs=4 * entry["std"] + 0.02 * truth[name])  # coarse mesh
    (scratch / "my_law.py").write_text((scratch / "my_law.py").read_text() + "\n# another version\n")
    changed = idic("--laws", "my_law.py", "identify", "test", "--out", "run", "--no-prefect", "--resume", cwd=scratch)
    assert changed.returncode == 2 and "another experiment" in changed.stderr


@pytest.mark.parametrize("name, text, problem", [
    ("law.py", "import nothing_there", "ModuleNotFoundError"), ("law.py", "x = 1", "registers none"),
    ("law.txt", "x = 1", "ending .py")])
def test_a_file_that_is_no_law_is_refused_in_one_message(name, text, problem, tmp_path, monkeypatch):
    (tmp_path / name).write_text(text)
    monkeypatch.setenv("IDIC_LAWS", str(tmp_path / name))
    with pytest.raises(InputError, match=re.escape(problem)):
        user_laws.load_user_laws()


def test_the_command_refuses_a_file_of_laws_that_is_not_there(tmp_path):
    missing = idic("--laws", "no.py", "laws", cwd=tmp_path)
    assert missing.returncode == 2 and "no such file of laws" in missing.stderr
