"""What a process holds of a simulation is a chunk of bounded size; how it is cut does not touch the result."""

from __future__ import annotations

import pytest

from experiment_file.small_experiment import write_experiment
import idic.cli  # noqa: F401 - registers every command
from idic.cli.app import app
from idic.errors import InputError
from idic.run import part_points, postprocess
from idic.run.store import layout
from idic.run import FrameArrays, checked_memory_limit, identify_run


@pytest.mark.parametrize(
    "limit, workers, scheduler, found",
    [
        ("much", 2, None, "much"),
        ("100MB", 2, None, "100MB"),
        ("2GB", 0, None, "--workers 0"),
        ("2GB", None, "tcp://127.0.0.1:8786", "--scheduler"),
        ("", 1, None, ""),
        ("-2GB", 1, None, "-2GB"),
    ],
)
def test_a_limit_that_cannot_hold_is_refused(limit, workers, scheduler, found):
    with pytest.raises(InputError) as caught:
        checked_memory_limit(limit, workers, scheduler)
    assert caught.value.key == "--memory-limit" and caught.value.found == found and caught.value.remedy



@pytest.mark.parametrize("command", ["identify TEST --out OUT", "batch TEST --out OUT", "study coverage --out OUT",
                                     "diagnose RUN", "systematic RUN"])
def test_every_command_with_workers_takes_a_limit_and_refuses_nonsense(command, gallery, tmp_path, capsys):
    """Before anything is started or written."""
    step = gallery("step")
    places = {"TEST": str(step.experiment), "OUT": str(tmp_path / "out"), "RUN": str(step.run)}
    with pytest.raises(SystemExit) as end:
        app([places.get(word, word) for word in command.split()] + ["--memory-limit", "much"])
    assert end.value.code == 2 and "--memory-limit: not a usable memory limit" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_limit_is_read_as_dask_reads_it():
    assert checked_memory_limit("2GB", 4, None) == 2_000_000_000 and checked_memory_limit(None, 0, None) is None


def test_chunks_are_bounded_in_bytes_and_in_frames():
    assert layout.stored_frames(2000, 1000) == layout.chunk_frames(2000) == 16
    assert layout.stored_frames(2000, 3_000_000) == 2
    assert layout.stored_frames(2000, 50_000_000) == 1, "a frame is never cut"
    assert layout.stored_frames(4, 1000) == layout.chunk_frames(4)


def test_the_size_of_the_chunks_does_not_touch_the_result(tmp_path, monkeypatch):
    folder = write_experiment(tmp_path / "test")
    options = {
        "options.max_iterations": 1,
        "options.element_order": "as_given",
        "experiment.reference": "frame_001.tif",
    }
    results = []
    for module in (layout, part_points, postprocess):
        monkeypatch.setattr(module, "chunk_frames", lambda n_frames: 3)  # of a test of 40 frames or more
    for size in (8_000_000, 2 * 8 * 20 * 2, 1):  # 3 frames, 2 frames, 1 frame of 20 nodes
        monkeypatch.setattr(layout, "CHUNK_BYTES", size)
        run = tmp_path / f"run-{size}"
        result = identify_run(folder, run, overrides=options)
        base = next((run / "run.zarr" / "evaluations").glob("*/base"))
        results.append((FrameArrays.open(base, "u").frames_per_chunk, result["parameters"], result["residual"]))
    assert [frames for frames, *_ in results] == [3, 2, 1]
    assert results[0][1:] == results[1][1:] == results[2][1:]
