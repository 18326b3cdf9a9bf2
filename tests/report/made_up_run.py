"""A made-up but plausible run: a waisted strip in tension, 20 frames, four parameters."""

from __future__ import annotations

import numpy as np

from idic.report import ChannelRecord, FieldFrames, ResidualMaps, RunRecord, Sensitivities
from idic.report.result.record import FrameView, FreeFields, LawCurve, NoiseFloor, Practice

NAMES = ("sheet.E", "sheet.nu", "sheet.yield_stress", "sheet.hardening_modulus")
VALUES = (70012.3, 0.3004, 199.8, 2005.0)
STARTS = (60000.0, 0.33, 230.0, 1700.0)
STDS = (55.1, 0.0011, 0.24, 21.0)
UNITS = ("MPa", "-", "MPa", "MPa")
SHAPE = (200, 300)
SIGMA = 2.55


def waisted_strip(n=(28, 14)):
    a, b = np.meshgrid(np.linspace(-1, 1, n[0] + 1), np.linspace(-1, 1, n[1] + 1))
    half = 80.0 - 30.0 * np.exp(-((2.5 * a) ** 2))
    nodes = np.stack([150.0 + 135.0 * a, 100.0 - half * b], axis=-1).reshape(-1, 2)
    i = np.arange(n[0])[None, :] + (n[0] + 1) * np.arange(n[1])[:, None]
    conn = np.stack([i, i + 1, i + n[0] + 2, i + n[0] + 1], axis=-1).reshape(-1, 4)
    return nodes, conn


def make_result(status="converged", chi2=1.004, not_identifiable=()):
    dropped = {n for n, _ in not_identifiable}
    parameters = {}
    for n, v, s, d, u in zip(NAMES, VALUES, STARTS, STDS, UNITS, strict=True):
        lost = n in dropped
        parameters[n] = {
            "value": s if lost else v,
            "std": None if lost else d,
            "systematic_std": None if lost else 0.4 * d,
            "discretisation_bias": None if lost else -0.2 * d,
            "unit": u,
            "start": s,
            "free": True,
            "ci95": None if lost else [v - 1.96 * d, v + 1.96 * d],
        }
    parameters["sheet.density"] = {"value": 1.0, "std": None, "unit": "-", "start": 1.0, "free": False, "ci95": None}
    rms = 3.38 * np.sqrt(chi2)
    return {
        "schema": "idic.result/1",
        "status": status,
        "parameters": parameters,
        "derived": {"G": {"value": 26920.0, "std": 22.0, "unit": "MPa"}},
        "iterations": 7,
        "forward_runs": 8,
        "noise": {"std_gv": SIGMA, "source": "still_frames"},
        "residual": {
            "image_rms_gv": rms,
            "image_chi2_dof": chi2,
            "channel_rms": {"force_N": 4.9},
            "channel_chi2_dof": {"force_N": 0.97},
        },
        "correlation": {
            "names": list(NAMES),
            "matrix": [[1, 0.2, -0.1, 0.05], [0.2, 1, 0.1, -0.3], [-0.1, 0.1, 1, -0.83], [0.05, -0.3, -0.83, 1]],
        },
        "eigenvalues": [],
        "not_identifiable": [{"name": n, "reason": r, "together_with": []} for n, r in not_identifiable],
        "frames": [
            {"frame": k, "label": f"frame_{k:03d}.tif", "status": "ok", "rms_gv": rms, "chi2_dof": chi2}
            for k in range(20)
        ],
        "cost": {"wall_s": 41.2, "forward_s": 30.1, "image_s": 3.0, "peak_rss_mb": 900},
    }


def make_curve(missing=()) -> LawCurve:
    if missing:
        return LawCurve("sheet", "j2_linear", *[np.zeros(0)] * 4, 19.0, tuple(missing))
    strain = np.linspace(0, 0.03, 60)
    stress = np.minimum(70e3 * strain, 200.0 + 2000.0 * strain)
    return LawCurve("sheet", "j2_linear", strain, stress, 0.001 * stress, 1.1 * stress, 19.0)


def make_practice(**changes) -> Practice:
    facts = dict(
        version="0.1.0", setup={"camera": "a camera of 5 megapixels", "lens": "telecentric, 1:1"}, columns=SHAPE[1],
        rows=SHAPE[0], depth="uint8", frame_s=1.0, reference="frame_000.tif", n_references=1, n_pixels=31000,
        speckle_px=4.3, contrast=40.0, grey_range=(12.0, 240.0), saturated=0.0, lowpass_px=0.6,
        interpolation="quintic", brightness="frame", edge_margin_px=3, n_elements=392, cell="quad4", element_px=9.6,
        smallest_px=5.1, kind="plane_stress", estimator="generalised",
        floor=NoiseFloor(0.011, 3e-4, 2.1e-4, 5e-6, 19), channel_noise=(("force_N", "N", 5.0, "given"),))
    return Practice(**(facts | changes))


def make_record(**changes) -> RunRecord:
    rng = np.random.default_rng(0)
    nodes, conn = waisted_strip()
    x, y = (nodes[:, 0] - 150.0) / 135.0, (nodes[:, 1] - 100.0) / 80.0
    stretch = np.tanh(3.0 * x) * 2.5
    frames = (5, 12, 19)
    u = np.stack([np.stack([k / 19 * stretch + 0.1, -0.7 * k / 19 * y * np.exp(-4 * x**2)], axis=1) for k in frames])
    phi = np.stack(
        [
            np.stack([1e-3 * np.sin(3 * x), 5e-4 * y], 1),
            np.stack([0 * x, -3e-3 * y * np.exp(-(x**2))], 1),
            np.stack([0.012 * x * np.exp(-4 * x**2), -5e-3 * y], 1),
            np.stack([8e-3 * np.sin(5 * x), 3e-3 * y * x], 1),
        ]
    )
    inside = np.zeros(SHAPE, dtype=bool)
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    a = (columns - 150.0) / 135.0
    inside = (np.abs(a) < 1) & (np.abs(rows - 100.0) < 80.0 - 30.0 * np.exp(-((2.5 * a) ** 2)))
    after = np.where(inside, 3.38 * rng.standard_normal((3, *SHAPE)), np.nan)
    wave = np.array([2.0, 12.0, 25.0])[:, None, None] * np.exp(-4 * a**2) * np.sin(columns / 3.0) * np.cos(rows / 4.0)
    time = np.arange(20.0)
    force = 4000.0 * np.tanh(time / 6.0) + 40.0 * time
    values = [
        {n: s + (v - s) * (1 - q) for n, v, s in zip(NAMES, VALUES, STARTS, strict=True)}
        for q in (1, 0.4, 0.4, 0.05, 3e-3, 1e-4, 3e-6, 0)
    ]
    history = tuple(
        {"evaluation": k, "stage": 0 if k < 2 else 1, "accepted": k != 2, "phi": p, "damping": 0.0, "values": v}
        for k, (p, v) in enumerate(zip((9e6, 2e6, 3e6, 7e5, 6.02e5, 6.0e5, 5.99e5, 5.99e5), values, strict=True))
    )
    D = np.diag([1.0 / (s / v) for s, v in zip(STDS, VALUES, strict=True)])
    result = make_result()
    fields = dict(
        title="Waisted strip, tension",
        result=result,
        history=history,
        names=NAMES,
        M=D @ np.linalg.inv(np.array(result["correlation"]["matrix"])) @ D,
        reference=np.where(inside, 120 + 40 * rng.standard_normal(SHAPE), 15.0),
        nodes_px=nodes,
        cells=(("quad4", conn),),
        times=time,
        time_label="time [s]",
        rms_before=3.38 + 1.2 * time**1.2 / 4,
        rms_after=np.full(20, 3.38) + 0.02 * rng.standard_normal(20),
        channels=(ChannelRecord("force_N", "N", force + 5 * rng.standard_normal(20), force, 5.0, 1.08 * force),),
        fields=FieldFrames(
            frames,
            u,
            {"equivalent plastic strain [–]": np.stack([k / 19 * 0.05 * np.exp(-8 * x**2) for k in frames])},
        ),
        sensitivities=Sensitivities(NAMES, 19, phi, ("1 %",) * 4),
        residuals=ResidualMaps(frames, after + np.where(inside, wave, np.nan), after),
        notes=("Noise: from 2 still frames.", "Poisson's ratio has no unit."),
        pixel_size_mm=0.05,
        views=tuple(FrameView(k, 120 + 40 * rng.standard_normal(SHAPE), nodes + u[i], after[i])
                    for i, k in enumerate(frames)),
        free_fields=FreeFields(frames, 0.01 * rng.standard_normal((3, len(nodes), 2)),
                        np.where(inside, 3.3 * rng.standard_normal((3, *SHAPE)), np.nan),
                        np.array([1.0, 1.01, 0.99]), 24.0),
        curves=(make_curve(),),
        practice=make_practice(),
    )
    return RunRecord(**(fields | changes))
