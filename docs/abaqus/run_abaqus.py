"""Run a job of Abaqus in the foreground, then write its results as csv: `python3 run_abaqus.py JOB`."""

import subprocess
import sys

job = sys.argv[1]
subprocess.run(["abaqus", "job=" + job, "interactive", "ask_delete=OFF"], check=True)
subprocess.run(["abaqus", "python", "extract.py", job], check=True)
