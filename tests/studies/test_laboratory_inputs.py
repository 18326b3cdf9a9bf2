"""The count of laboratory inputs judges them, and none of the quick ones is read wrongly."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

STUDY = Path(__file__).resolve().parents[2] / "studies" / "evidence" / "laboratory_inputs"


def counted(*words):
    """Exit code and table of a part of the inputs."""
    ended = subprocess.run([sys.executable, STUDY, *words], capture_output=True, text=True, check=False)
    return ended.returncode, ended.stdout


def test_no_deck_and_no_image_is_read_wrongly():
    code, output = counted("decks and meshes", "axes of files")
    assert code == 0 and "| all | 47 | 13 | 0 |" in output, output


def test_an_input_that_is_read_wrongly_is_counted(tmp_path):
    script = ("import sys; sys.path.insert(0, sys.argv[1]); import outcome; "
              "print(outcome.outcome(outcome.Input('a', 'b', lambda folder: 1 / 0), None)[0], "
              "outcome.outcome(outcome.Input('a', 'b', lambda folder: outcome.right_if(False)), None)[0])")
    shown = subprocess.run([sys.executable, "-c", script, STUDY], capture_output=True, text=True, check=True)
    assert shown.stdout.split() == ["wrong", "wrong"]
