"""A strip with a hole: from images, mesh and log to parameters, in memory.

`write_example` stands for the laboratory: it writes images, log and mesh of a virtual test with known truth.
"""

import json
import tempfile
from pathlib import Path

import idic

folder = Path(tempfile.mkdtemp()) / "strip"
idic.write_example("demo", folder, reduced=True)

result = idic.identify(folder)
truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))["parameters"]
for name, estimate in result.parameters.items():
    print(f"{estimate}   truth {truth[name]:g}")

result.plot.residual(frame=-1).savefig("residual.png", dpi=100)
result.plot.channels().savefig("force.png", dpi=100)
