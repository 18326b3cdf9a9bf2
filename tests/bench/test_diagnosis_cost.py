"""What a diagnosis costs beside the identification that it starts from."""

import time
from pathlib import Path
from statistics import median

import pytest

import idic
from idic.run.diagnosis.diagnose import diagnose_run

pytestmark = [pytest.mark.bench, pytest.mark.slow]


def cpu(function, *arguments, **options):
    start = time.process_time()
    return function(*arguments, **options), time.process_time() - start


def timed_by_stage(run):
    """A diagnosis, its CPU seconds, and those of its longest screening."""
    moments, stages = [time.process_time()], ["start"]

    def stage(text):
        moments.append(time.process_time())
        stages.append(text)

    content = diagnose_run(run, stage=stage)
    moments.append(time.process_time())
    spent = [(b - a, text) for a, b, text in zip(moments[1:-1], moments[2:], stages[1:], strict=True)]
    screenings = [seconds for seconds, text in spent if text.startswith("screening")]
    return content, moments[-1] - moments[0], max(screenings)


def test_a_diagnosis_costs_a_few_identifications(measured, tmp_path, monkeypatch):
    """Less than one for a screening of the library, less than three for the whole.

    The twin is small (16 frames of 116 x 184 px), so that building 140 models weighs more than their simulation.
    Medians of three, each beside an identification of the same minute: a shared processor is not equally fast for long.
    """
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "diagnose")
    from material_twins import write_folder

    write_folder(tmp_path / "test", "plasticity", 3)
    idic.identify_experiment(tmp_path / "test", tmp_path / "warm-up")  # compiled laws
    idic.identify_experiment(tmp_path / "test", tmp_path / "run")
    diagnose_run(tmp_path / "run")  # compiled laws of the candidates
    pairs = [(cpu(idic.identify_experiment, tmp_path / "test", tmp_path / f"run{k}")[1],
              timed_by_stage(tmp_path / "run")) for k in range(3)]
    whole, screening = (median(diagnosed[kind] / one for one, diagnosed in pairs) for kind in (1, 2))
    one = median(one for one, _ in pairs)
    measured("diagnosis of a small twin, whole library", f"{whole * one:.1f} s", f"{whole:.1f} identifications")
    measured("one screening of the whole library", f"{screening * one:.1f} s",
             f"{screening:.2f} identifications")
    assert all(content["named"] == ["plasticity"] for _, (content, _, _) in pairs)
    assert screening < 1.0
    assert whole < 3.0
