"""Numbers of evidence/polycarbonate.md that the study does not give: time steps, forward runs, first-order results.

Run with ``python studies/evidence/polycarbonate/numbers.py steps|starts [elements along] [across]``, or with
``python studies/evidence/polycarbonate/numbers.py causes|bits|misfit [reduced|full]``; prints tables.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from idic.correlation import build_experiment_reference, nodal_equations, residual_map
from idic.errors import NotConverged
from idic.experiment_file import load_experiment
from idic.identification import identify, scaled_system
from idic.images import ArrayStack, RoundedStack, prefilter
from idic_studies.cases.polycarbonate import SPLINE_FLOOR, scaled
from idic_studies.examples.polycarbonate import FULL, REDUCED, Size, necking_strip
from idic_studies.examples.polycarbonate_model import TRUTH, Divisions, pull, strip_mesh
from idic.virtual_tests import write_virtual_model

PIXEL = 0.0931  # mm
FRAMES = 200


def time_steps(mesh) -> None:
    """In-plane displacement and force with coarser increments than 2000, and extrapolated from two runs."""
    runs = {n: pull(mesh, FRAMES, n) for n in (1, 2, 5, 10)}
    fine = runs[10]
    rows = {f"{FRAMES * n} increments": (run.u, run.force) for n, run in runs.items() if n < 10}
    rows["extrapolated from 200 and 400"] = tuple(2 * b - a for a, b in zip(
        (runs[1].u, runs[1].force), (runs[2].u, runs[2].force), strict=True))
    rows["extrapolated from 400 and 1000"] = tuple((5 * b - 2 * a) / 3 for a, b in zip(
        (runs[2].u, runs[2].force), (runs[5].u, runs[5].force), strict=True))
    for name, (u, force) in rows.items():
        gap = np.linalg.norm((u - fine.u)[..., :2], axis=-1).max(axis=1) / PIXEL  # (n_frames,) px
        print(f"| {name} | {gap[:46].max():.3f} | {gap.max():.2f} (at {gap.argmax()} s) | {gap[100:].max():.2f} | "
              f"{np.abs(force - fine.force).max():.1f} |")


def starts(mesh, n_sets: int = 20, spread: float = 0.5) -> None:
    """Forward runs with all ten parameters independently off by up to +-50 %."""
    rng = np.random.default_rng(0)
    truth = np.array(list(TRUTH.values()))
    for k in range(n_sets):
        values = truth * (1.0 + rng.uniform(-spread, spread, len(truth)))
        began = time.process_time()
        try:
            run = pull(mesh, FRAMES, 1, values)
            outcome = f"{run.steps} increments, peak force {run.force.max():.0f} N"
        except NotConverged as problem:
            outcome = f"failed: {problem}"
        print(f"{k:2d}  {outcome}, {time.process_time() - began:.1f} s", flush=True)


def causes(size: Size) -> None:
    """First-order result without rounding, with one property of a real camera or of the defaults at a time."""
    blurred, close_border = {"options.lowpass_px": 0.6}, {"options.border_px": 0, "options.edge_margin_px": 3}
    images_by_samples = {n: _images(size, n) for n in (1, 5)}
    for label, samples, overrides in (("as the study", 1, {}),
                                      ("low-pass of 0.6 px", 1, blurred | {"options.camera_blur_px": 0.0}),
                                      ("up to the border, 3 px from edges", 1, close_border),
                                      ("pixels that integrate over their area", 5, {}),
                                      ("all three", 5, blurred | close_border)):
        _print_step(label, images_by_samples[samples], 0, overrides)


def misfit(size: Size) -> None:
    """chi^2 of images of 8 bit at the true motion: mean over every seventh frame, and the last of them."""
    matched = {"options.camera_blur_px": 0.0}
    border = {"options.lowpass_px": 0.0, "options.border_px": 6, "options.edge_margin_px": 6}
    for samples, kinds in ((3, {"the defaults": {}, "no border left out": {"options.border_px": 0},
                                "no low-pass": border}),
                           (1, {"camera_blur_px = 0": matched, "no low-pass": border})):
        test, stack = _images(size, samples)
        for label, overrides in kinds.items():
            for name, chi2 in _misfits(test, RoundedStack(stack, 8), overrides).items():
                print(f"| {samples} x {samples} | {label}, {name} | {np.mean(chi2):.2f} | {chi2[-1]:.2f} |",
                      flush=True)


def _misfits(test, stack, overrides: Mapping[str, object]) -> dict[str, list[float]]:
    with TemporaryDirectory() as folder:
        write_virtual_model(Path(folder), test, floor_gv=SPLINE_FLOOR)
        experiment = load_experiment(folder, {"options.element_order": "as_given", **overrides}, stack=stack)
    nodes, project = experiment.model.mesh.nodes, experiment.model.camera.project
    matched_reference = build_experiment_reference(experiment, experiment.model.camera)
    chi2: dict[str, list[float]] = {"blur matched": [], "blur as it is": []}
    for frame in range(7, stack.n_frames, 7):
        u = project(nodes + np.pad(test.displacements[frame][:len(nodes)], ((0, 0), (0, 1)))) - project(nodes)
        for name, reference in zip(chi2, (matched_reference, replace(matched_reference, image_gv=None)), strict=True):
            spline = prefilter(stack.frame(frame), reference.degree, reference.lowpass_px)
            light = nodal_equations(reference, spline, u).brightness_fit().coefficients
            chi2[name].append(residual_map(reference, spline, u, "frame", light).chi2_dof(12**-0.5))
    return chi2


def bits(size: Size) -> None:
    """First-order result of images rounded to 8, 12 and 16 bits."""
    images = _images(size, 1)
    for number in (8, 12, 16):
        _print_step(f"{number} bit", images, number, {})


def _images(size: Size, supersampling: int):
    test = necking_strip(size, supersampling=supersampling)
    with TemporaryDirectory() as folder:
        stack = write_virtual_model(Path(folder), test, floor_gv=SPLINE_FLOOR)
        return test, ArrayStack(np.stack([stack.frame(k) for k in range(stack.n_frames)]))


def _print_step(label: str, images, n_bits: int, overrides: Mapping[str, object]) -> None:
    """One Gauss-Newton step from the truth: to first order, the end of every identification."""
    test, stack = images
    with TemporaryDirectory() as folder:
        write_virtual_model(Path(folder), test, floor_gv=SPLINE_FLOOR)
        experiment = load_experiment(folder, {**scaled(1.0), "options.max_iterations": 1, **overrides}, stack=stack)
    if n_bits:
        rounded = RoundedStack(stack, n_bits)
        std = float(np.hypot(SPLINE_FLOOR, rounded.step / np.sqrt(12.0)))
        experiment = replace(experiment, recording=replace(experiment.recording, stack=rounded,
                                                           noise=replace(experiment.recording.noise, std_gv=std)))
    identification = identify(experiment)
    system = identification.point.system
    parameters, noise = identification.experiment.model.parameters, identification.weights.image_noise
    scaled_up = scaled_system(system, parameters, identification.point.reference_gram, noise)
    directions = scaled_up.spectrum()
    step, stds = directions.inverse @ scaled_up.b, np.sqrt(np.diagonal(scaled_up.covariance(directions)))
    relative = scaled_up.slopes / np.array([parameters[name].value for name in parameters.free])
    rms = np.sqrt(sum(f.rr for f in system.frames) / sum(f.n_pixels for f in system.frames))
    cells = " | ".join(f"{100 * e:+.3f} ({100 * s:.3f})" for e, s in zip(step * relative, stds * np.abs(relative),
                                                                               strict=True))
    print(f"| {label} | {cells} | {rms:.3f} |", flush=True)


if __name__ == "__main__":
    if sys.argv[1] in ("causes", "bits", "misfit"):
        {"causes": causes, "bits": bits, "misfit": misfit}[sys.argv[1]](FULL if sys.argv[2:3] == ["full"] else REDUCED)
        sys.exit()
    along, across = (int(n) for n in (sys.argv[2:4] or ("40", "4")))
    {"steps": time_steps, "starts": starts}[sys.argv[1]](strip_mesh(Divisions(along, across)))
