"""The tables of evidence/choosing.md: bias and standard deviation over elements, interpolant, margin, weights.

    python studies/evidence/choosing_numbers.py FOLDER [GROUP ...]      # some minutes; prints Markdown tables

The images have no noise and no rounding, so that value less truth is bias; the standard deviations are those that noise
of 2 grey values would bring. The truth is simulated on elements half as large as the finest of the models.
"""

from __future__ import annotations

import shutil
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from idic.correlation import build_experiment_reference
from idic.experiment_file import load_experiment
from idic.identification import identify
from idic.images import dense_speckle
from idic.measure import Seen
from idic.run import identify_run
from idic.report import noise_floor
from idic.virtual_tests import DemoSize, painted, strip, write_images, write_virtual_model

NOISE_GV = 2.0
TRUE_MESH = (9, 12, 7)
BASE = {"options.estimator": "ordinary", "boundary.1.ux": {"column": "grip_displacement_mm"}}
FINE, FINE_SIGMA_PX = "fine speckle", 0.75
FINER_STEPS = 256.0  # of 16 bit images, per grey value of 8 bit
NAMES = {"sheet.E": "E", "sheet.nu": "nu", "sheet.yield_stress": "yield stress", "sheet.hardening_modulus": "H"}


def groups():
    """{group: [(label, division of the mesh, cell, overrides)]}"""
    usual = (3, 4, 2)
    elements = [(f"{cell}, {label}", division, cell, {"options.element_order": "as_given"})
                for cell in ("quad4", "quad8") for label, division in
                (("29 px", (1, 2, 1)), ("16 px", (2, 3, 1)), ("11 px", (3, 4, 2)), ("8 px", (4, 6, 3)))]
    images = [(f"{kind}, low-pass {blur} px", usual, "quad8",
               {"options.interpolation": kind, "options.lowpass_px": blur})
              for kind in ("cubic", "quintic") for blur in (0.0, 0.6, 1.0)]
    fine = [(label, division, cell, overrides | {FINE: True}) for label, division, cell, overrides in images]
    margins = [(f"{margin} px", usual, "quad8", {"options.edge_margin_px": margin}) for margin in (0, 1, 3, 6)]
    weights = [("noise (default)", usual, "quad8", {})] + [
        (f"paper, alpha = {alpha}", usual, "quad8", {"options.weighting": "paper", "options.alpha": alpha})
        for alpha in (0.5, 0.01, 0.0001)]
    estimators = [(name, usual, "quad8", {"options.estimator": name}) for name in ("ordinary", "generalised")]
    return {"elements": elements, "images": images, "fine": fine, "margin": margins, "weighting": weights,
            "estimator": estimators}


def test_of(division, cell: str, overrides):
    """The test with a mesh for the model, and the remaining overrides."""
    test = strip(replace(DemoSize.of_example(reduced=True), true=TRUE_MESH, user=division))
    test = replace(test, mesh=DemoSize.mesh(cell, division))
    overrides = dict(overrides)
    if overrides.pop(FINE, False):
        test = replace(test, texture=lambda rng, levels: painted(dense_speckle(
            rng, FINE_SIGMA_PX, 0.08 * levels, 0.92 * levels, 1.2 * max(test.shape)), test.camera))
    return test, BASE | overrides


def experiment_of(folder: Path, division, cell: str, overrides):
    """The test with noise-free images in memory."""
    test, overrides = test_of(division, cell, overrides)
    folder.mkdir(parents=True, exist_ok=True)
    return load_experiment(folder, overrides, stack=write_virtual_model(folder, test, floor_gv=NOISE_GV))


def from_files(folder: Path, division, cell: str, overrides) -> dict:
    """The result of a whole run: weighting as published wants one. 16 bit, whose rounding is far below the noise."""
    test, overrides = test_of(division, cell, overrides)
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "images").mkdir(parents=True)
    stack = write_virtual_model(folder, test, floor_gv=FINER_STEPS * NOISE_GV)
    write_images(folder, (np.rint(FINER_STEPS * stack.frame(k)).astype(np.uint16) for k in range(stack.n_frames)))
    return identify_run(folder, folder / "run", overrides=overrides)


def row(folder: Path, label: str, division, cell: str, overrides) -> str:
    """A line of a table."""
    began = time.process_time()
    if "options.weighting" in overrides:
        result = from_files(folder, division, cell, overrides)
    else:
        result = identify(experiment_of(folder, division, cell, overrides)).result
    cpu, cells = time.process_time() - began, []
    for name, true in DemoSize.TRUTH.items():
        entry = result["parameters"][name]
        cells.append("–" if entry["std"] is None else
                     f"{100 * (entry['value'] / true - 1):+.2f} ± {100 * entry['std'] / true:.2f}")
    status = "" if result["status"] == "converged" else f" ({result['status']})"
    return f"| {label}{status} | " + " | ".join(cells) + f" | {cpu:.1f} |"


def free_displacement(folder: Path) -> None:
    """Noise of a free FE-DIC over the size of its elements."""
    sys.stdout.write("\n**free FE-DIC**\n\n| elements | displacement [px] | strain [µm/m] |\n| --- | --- | --- |\n")
    for number, (label, division, cell, overrides) in enumerate(groups()["elements"]):
        experiment = experiment_of(folder / f"free-{number}", division, cell, overrides)
        inputs = Seen.by(experiment, build_experiment_reference(experiment, experiment.model.camera))
        floor = noise_floor(inputs, None, {}, inputs.reference)
        sys.stdout.write(f"| {label} | {floor.free_px:.3f} | {1e6 * floor.free_strain:.0f} |\n")


def main(folder: str, selected_groups: list[str]) -> None:
    if not selected_groups or "free" in selected_groups:
        free_displacement(Path(folder))
    for group, rows in groups().items():
        if selected_groups and group not in selected_groups:
            continue
        sys.stdout.write(f"\n**{group}**\n\n| | " + " | ".join(f"{n} [%]" for n in NAMES.values()) + " | CPU [s] |\n")
        sys.stdout.write("| --- " * (len(NAMES) + 2) + "|\n")
        for number, entry in enumerate(rows):
            sys.stdout.write(row(Path(folder) / f"{group}-{number}", *entry) + "\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
