"""Runs tutorial.md word for word, and writes what the commands print into it.

    python docs/tutorial.py FOLDER [--keep]        # FOLDER: new; --keep: tutorial.md stays as it is

Every ``sh`` block is given to a shell in FOLDER; a ``toml`` block after ``<!-- file: NAME -->`` is written to that
file; the ``text`` block after a ``sh`` block is what it printed. Ends with an error where a command does.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).parent / "tutorial.md"
BLOCK = re.compile(r"(?:<!-- file: (?P<file>\S+) -->\n)?```(?P<kind>\w+)\n(?P<text>.*?)```\n", re.DOTALL)


def run_tutorial(folder: Path, page: str) -> str:
    """The page with the outputs of its commands, which are run in `folder`.

    Raises
    ------
    subprocess.CalledProcessError
        Where a command ends with another exit code than 0.
    """
    folder.mkdir(parents=True)
    here = Path(sys.executable).parent
    environment = os.environ | {"PATH": f"{here}{os.pathsep}{os.environ['PATH']}", "COLUMNS": "110"}
    printed = ""

    def replaced(match: re.Match) -> str:
        nonlocal printed
        kind, text = match["kind"], match["text"]
        if match["file"]:
            (folder / match["file"]).write_text(text, encoding="utf-8")
        elif kind == "sh":
            done = subprocess.run(["bash", "-ec", text], cwd=folder, capture_output=True, text=True, env=environment)
            if done.returncode:
                raise subprocess.CalledProcessError(done.returncode, text, done.stdout, done.stderr)
            printed = re.sub(r"[ \t]+$", "", done.stdout.strip("\n"), flags=re.MULTILINE)
            printed = printed.replace(f"{folder.resolve()}/", "")
        elif kind == "text":
            return f"```text\n{printed}\n```\n"
        return match[0]

    return BLOCK.sub(replaced, page)


if __name__ == "__main__":
    found = run_tutorial(Path(sys.argv[1]), PAGE.read_text(encoding="utf-8"))
    if "--keep" not in sys.argv:
        PAGE.write_text(found, encoding="utf-8")
