"""What `idic demo` compiles beside its first steps: the kernels of its own identification, and only where none are
kept."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tomllib
from string import Template

import pytest

from idic.experiment_file import load_experiment
from idic.laws import has_code_on_disk
from idic.virtual_tests import DemoSize
from idic.virtual_tests.demo import TOML
from idic.virtual_tests.rehearsal import write_rehearsal

RENDERING = {"inverse_mapping.", "pattern."}
LARGER_MESH = {"kernels.places_in_columns", "kernels.scatter", "kernels.add_stiffness_times", "multifrontal."}
REPORT = {"interpolate._sample_points"}


def test_the_rehearsal_is_the_demo_in_small(tmp_path):
    path = write_rehearsal(tmp_path / "rehearsal")
    demo = Template(TOML).substitute(pixel_size=1.0, column=0, row=0, noise_std_gv=1.0)
    written, demo = tomllib.loads(path.read_text()), tomllib.loads(demo)
    for table in ("experiment", "material", "boundary", "channel", "options"):
        assert written[table] == demo[table]
    experiment = load_experiment(path)
    assert {block.cell for block in experiment.model.mesh.blocks} == {"quad8"}
    assert max(experiment.recording.stack.shape) < DemoSize.of_example().shape[1]


def test_code_on_disk_is_told_from_none(tmp_path):
    file = tmp_path / "own_kernel.py"
    file.write_text("import numba\n\n\n@numba.njit(cache=True)\ndef twice(x):\n    return 2 * x\n")
    spec = importlib.util.spec_from_file_location("own_kernel", file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert not has_code_on_disk(module.twice)
    assert module.twice(2) == 4 and has_code_on_disk(module.twice)
    file.write_text("# changed\n" + file.read_text())
    spec.loader.exec_module(module)
    assert not has_code_on_disk(module.twice)


@pytest.mark.slow  # compiles everything: 80 s of CPU time
def test_after_the_rehearsal_the_demo_compiles_only_what_its_truth_and_its_report_need(tmp_path):
    cache = tmp_path / "cache"
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)}

    def kernels() -> set[str]:
        return {file.name.split("-")[0] for file in cache.rglob("*.nbc")}

    def python(*arguments: str) -> None:
        subprocess.run([sys.executable, *arguments], check=True, cwd=tmp_path, env=environment, capture_output=True)

    python("-m", "idic.virtual_tests.rehearsal")
    rehearsed = kernels()
    python("-m", "idic", "demo", "--no-prefect", "--out", str(tmp_path / "demo"))
    assert any(name.startswith("image_kernel.image_pass") for name in rehearsed)
    allowed = tuple(RENDERING | LARGER_MESH | REPORT)
    assert [name for name in sorted(kernels() - rehearsed) if not name.startswith(allowed)] == []
