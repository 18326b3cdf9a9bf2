"""A second author's tables: logs of machines and loggers, exports of DIC systems."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from files import FIELD_TOML
from outcome import Input, right_if
from strip import RAMP, force_of, image, write

from idic.experiment_file import load_experiment
from idic.report import check

N = len(RAMP)
TIMES = 2.0 * np.arange(N)  # s, of the images
FINE = np.arange(0.0, TIMES[-1] + 0.01, 0.2)  # s, of the log
FINE_STRAIN = np.interp(FINE, TIMES, RAMP)
EPOCH = 1762178709.0


def machine(text: str | bytes, names: tuple[str, str], folder: Path, suffix: str = ".csv", times: str = "",
            more: str = "") -> tuple[str, str]:
    """A log of a machine, matched by time: force and grip of every image are those of its moment."""
    stated = 'image_times = "times.csv"\n' if times else "frame_interval_s = 2.0\n"
    write(folder, [f"f{k:02d}.tif" for k in range(N)], [image(e, k) for k, e in enumerate(RAMP)], "", stated + more)
    (folder / "loads.csv").unlink()
    (folder / f"loads{suffix}").write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
    if times:
        (folder / "times.csv").write_text(times, encoding="utf-8")
    toml = (folder / "experiment.toml").read_text().replace("loads.csv", f"loads{suffix}")
    for key, name in zip(("force_N", "grip_mm"), names, strict=True):
        toml = toml.replace(f'"{key}"', f'"{name}"')
    (folder / "experiment.toml").write_text(toml)
    experiment = load_experiment(folder)
    force = experiment.model.channels[0].values
    return right_if(np.allclose(force, force_of(RAMP), atol=2.0), np.round(force, 1))


def table(separator: str, form: Callable[[float], tuple[str, ...]], mark: str = ".", cell: str = "{}") -> str:
    """Rows of time in the form, force and grip."""
    rows = []
    for t, e in zip(FINE, FINE_STRAIN, strict=True):
        numbers = [f"{float(force_of(e)):.3f}".replace(".", mark), f"{20 * e:.5f}".replace(".", mark)]
        rows.append(separator.join(cell.format(word) for word in (*form(t), *numbers)))
    return "\n".join(rows) + "\n"


def seconds(t: float) -> tuple[str, ...]:
    return (f"{t:.3f}",)


def comma(t: float) -> tuple[str, ...]:
    return (f"{t:.3f}".replace(".", ","),)


def clock(t: float, mark: str = ".") -> str:
    return f"10:{int(t // 60):02d}:{t % 60:06.3f}".replace(".", mark)


def lvm() -> str:
    """LabVIEW measurement file: header, then X_Value and the channels, a comment column."""
    head = ("LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n"
            "Multi_Headings\tNo\nX_Columns\tOne\nTime_Pref\tRelative\nOperator\tlab\nDate\t2025/11/03\n"
            "Time\t14:05:09.1234567890123456789\n***End_of_Header***\t\n\t\nChannels\t2\t\t\nSamples\t"
            f"{len(FINE)}\t{len(FINE)}\t\nDate\t2025/11/03\t2025/11/03\t\nTime\t14:05:09.12345\t14:05:09.12345\t\n"
            "Y_Unit_Label\tNewton\tMillimeter\t\nX_Dimension\tTime\tTime\t\nX0\t0.0\t0.0\t\nDelta_X\t0.2\t0.2\t\n"
            "***End_of_Header***\t\t\t\nX_Value\tForce [N]\tGrip [mm]\tComment\n")
    return head + table("\t", seconds).replace("\n", "\t\n")


MTS = ("MTS793|MPT|ENU|1|2|.|/|:|1|0|0|A\n\nData Header:\tTime:\t11/3/2025 2:05:09 PM\nData Acquisition:\tTimed\n"
       "Time\tAxial Force\tAxial Displacement\nSec\tN\tmm\n")
BLUEHILL = 'Specimen label,"A-1"\nGeometry,"Rectangular"\n\nTime,Load,Extension\n(s),(N),(mm)\n'
INSTRON_OLD = ('"Results Table 1"\n,"Maximum Load","Modulus"\n,"(N)","(MPa)"\n1,"22400.00","70000.0"\n\n"Time","Load",'
               '"Extension"\n"(s)","(N)","(mm)"\n')
CATMAN = ("HBM_CATMAN_DATAFILE_40\nAutomatic data file\n\nTime  1 - default sample rate [s]\tForce [N]\tGrip [mm]\n")


def logs() -> Iterator[Input]:
    """Logs of machines."""
    minutes = "time\n" + "".join(f"{clock(t)}\n" for t in TIMES)
    epoch = "time\n" + "".join(f"{EPOCH + t:.3f}\n" for t in TIMES)
    cases: dict[str, tuple] = {
        "Bluehill, units in brackets below": (BLUEHILL + table(",", seconds), ("Load", "Extension")),
        "Bluehill, results table first": (INSTRON_OLD + table(",", seconds, cell='"{}"'), ("Load", "Extension")),
        "MTS TestSuite": (MTS + table("\t", seconds), ("Axial Force", "Axial Displacement"), ".txt"),
        "testXpert, German": (("\"Prüfzeit\";\"Standardkraft\";\"Standardweg\"\n\"s\";\"N\";\"mm\"\n" + table(
            ";", comma, ",")).encode("cp1252"), ("Standardkraft", "Standardweg"), ".TRA"),
        "LabVIEW .lvm": (lvm(), ("Force [N]", "Grip [mm]"), ".lvm"),
        "catman": ((CATMAN + table("\t", comma, ",")).encode("cp1252"), ("Force [N]", "Grip [mm]"), ".asc"),
        "UTF-16, tabs": (("Time [s]\tForce [N]\tGrip [mm]\n" + table("\t", seconds)).encode("utf-16"),
                         ("Force [N]", "Grip [mm]"), ".txt"),
        "seconds of an epoch": ("time_s,force_N,grip_mm\n" + table(",", lambda t: (f"{EPOCH + t:.3f}",)),
                                ("force_N", "grip_mm"), ".csv", epoch),
        "date and time in columns of their own": (
            "Date;Time;force_N;grip_mm\n" + table(";", lambda t: ("03.11.2025", clock(t)), "."),
            ("force_N", "grip_mm"), ".csv", minutes),
        "clock of whole seconds, five rows in each": (
            "time,force_N,grip_mm\n" + table(",", lambda t: (clock(t)[:8],)), ("force_N", "grip_mm"), ".csv", minutes),
        "exponents with comma": ("Zeit [s];Kraft [N];Weg [mm]\n" + "".join(
            f"{t:.4E};{float(force_of(e)):.6E};{20 * e:.6E}\n".replace(".", ",")
            for t, e in zip(FINE, FINE_STRAIN, strict=True)), ("Kraft [N]", "Weg [mm]")),
        "milliseconds": ("time_ms,force_N,grip_mm\n" + table(",", lambda t: (f"{1000 * t:.0f}",)),
                         ("force_N", "grip_mm")),
        "pounds": ("time_s,Load (lbf),grip_mm\n" + "".join(
            f"{t:.2f},{float(force_of(e)) / 4.4482216:.4f},{20 * e:.5f}\n"
            for t, e in zip(FINE, FINE_STRAIN, strict=True)), ("Load (lbf)", "grip_mm")),
        "remarks of the operator in a last column": (
            "time_s,force_N,grip_mm,remark\n" + table(",", seconds).replace("\n", ",\n", 30).replace(
                "6.000,", "6.000,", 1), ("force_N", "grip_mm"))}
    for name, case in cases.items():
        text, names, *rest = case
        yield Input("clock times and logs", name, partial(_machine, text, names, tuple(rest)))


def _machine(text, names, rest, folder: Path) -> tuple[str, str]:
    return machine(text, names, folder, *rest)


FIELDS = FIELD_TOML.replace("stages/*.csv", "stages/*")
PX = "[camera]\npixel_size_mm = 0.05"


def field(stage: Callable, more: str, failed: int, folder: Path, suffix: str = ".csv",
          said: str = "") -> tuple[str, str]:
    """Four stages of 40 x 16 points, 0.4 % of strain each, 1.2 % at last; seven points of the last one failed."""
    (folder / "stages").mkdir(parents=True)
    x, y = (v.ravel() for v in np.meshgrid(np.arange(40) * 0.5, np.arange(16) * 0.5))
    for k in range(4):
        rng = np.random.default_rng(k)
        u, v = (0.004 * k * x + rng.normal(0, 2e-4, x.shape), -0.0012 * k * y + rng.normal(0, 2e-4, x.shape))
        content = stage(k, x, y, u, v)
        path = folder / "stages" / f"strip-{k:04d}_0{suffix}"
        path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))
    (folder / "experiment.toml").write_text(FIELDS.replace("MORE", more))
    experiment = load_experiment(folder)
    values = np.asarray(experiment.recording.stack.frame(3))
    measured = np.isfinite(values).all(axis=1)
    at = experiment.recording.points.positions_px
    slopes = [1e-3 * np.polyfit(at[measured, axis] * experiment.recording.points.pitch_mm, values[measured, axis], 1)[0]
              for axis in (0, 1)]
    report = check(experiment, draw=False)
    is_said = not said or said in " ".join([*report.warnings, *report.notes])
    is_right = (~measured).sum() == failed and abs(slopes[0] - 0.012) < 3e-4 and abs(slopes[1] + 0.0036) < 3e-4
    return right_if(is_right and is_said, ((~measured).sum(), slopes, report.warnings[:3]))


def rows(header: str, row: Callable[..., str]) -> Callable:
    """A table of a row per point; i < 7 of the last stage failed."""
    return lambda k, x, y, u, v: "\n".join([header, *(row(i, k == 3 and i < 7, *p) for i, p in enumerate(
        zip(x, y, u, v, strict=True)))]) + "\n"


def zeros_outside(k, x, y, u, v) -> str:
    """A MATLAB grid larger than the region: exact zeros outside."""
    outside = np.hypot(x - 10, y - 4) > 9.5
    return "x_mm,y_mm,ux_mm,uy_mm\n" + "".join(
        f"{a},{b},0,0\n" if out else f"{a},{b},{c:.6f},{d:.6f}\n" for a, b, c, d, out in zip(x, y, u, v, outside,
                                                                                            strict=True))


def workbook(k, x, y, u, v) -> bytes:
    """A stage saved as a workbook."""
    import io

    import openpyxl
    book = openpyxl.Workbook()
    book.active.append(["X [mm]", "Y [mm]", "U [mm]", "V [mm]"])
    for i, row in enumerate(zip(x, y, u, v, strict=True)):
        book.active.append([*map(float, row[:2]), *(("", "") if k == 3 and i < 7 else map(float, row[2:]))])
    stream = io.BytesIO()
    book.save(stream)
    return stream.getvalue()


def vtu(k, x, y, u, v) -> bytes:
    """A mesh with the displacement at its nodes, in mm, as programs of finite elements write it."""
    import tempfile

    import meshio
    corners = np.arange(16 * 40).reshape(16, 40)
    cells = np.stack([corners[:-1, :-1], corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1]], -1).reshape(-1, 4)
    made = meshio.Mesh(np.c_[x, y, 0 * x], [("quad", cells)], point_data={"displacement": np.c_[u, v, 0 * u]})
    with tempfile.TemporaryDirectory() as name:
        meshio.write(Path(name) / "a.vtu", made)
        return (Path(name) / "a.vtu").read_bytes()


def named(x: str, y: str, ux: str, uy: str, more: str = 'unit = "mm"\n') -> str:
    return f'\n[fields.columns]\nx = "{x}"\ny = "{y}"\nux = "{ux}"\nuy = "{uy}"\n{more}'


def fields() -> Iterator[Input]:
    """Exports of DIC systems."""
    def px(x: float, y: float, u: float, v: float) -> tuple[float, ...]:
        return 20 * x, 160 - 20 * y, 20 * u, -20 * v

    cases: dict[str, tuple] = {
        "VIC-2D, px beside calibrated mm": (rows(
            '"x", "y", "sigma", "x_c", "y_c", "u_c", "v_c", "exx", "u", "v"', lambda i, bad, x, y, u, v:
            "{:g}, {:g}, {}, {:g}, {:g}, {:.6f}, {:.6f}, 0, {:.5f}, {:.5f}".format(
                20 * x, 160 - 20 * y, -1 if bad else 0.008, x, y, *((9, 9) if bad else (u, v)),
                *((9, 9) if bad else (20 * u, -20 * v)))), PX, 7),
        "VIC-3D, metric and px": (rows(
            '"X","Y","Z","U","V","W","exx","sigma","x","y","u","v"', lambda i, bad, x, y, u, v:
            "0,0,0,0,0,0,0,-1,0,0,0,0" if bad else f"{x},{y},0.1,{u:.6f},{v:.6f},0.001,0.01,0.006,{20 * x},"
            f"{160 - 20 * y},{20 * u:.4f},{-20 * v:.4f}"), 'fields_unit = "mm"', 7),
        "MatchID 2D, semicolons and commas": (rows(
            "Coordinates.Image X [Pixel];Coordinates.Image Y [Pixel];disp.Horizontal Displacement U [Pixel];"
            "disp.Vertical Displacement V [Pixel]", lambda i, bad, x, y, u, v:
            ("{:.1f};{:.1f};;" if bad else "{:.1f};{:.1f};{:.5f};{:.5f}").format(*px(x, y, u, v)).replace(".", ",")),
            PX, 7),
        "DICe, header of its settings": (lambda k, x, y, u, v: (
            "*** Digital Image Correlation Engine (DICe), (git sha1: 5ebcdfaf)\n*** Reference image: ref.tif\n"
            f"*** Deformed image: def_{k}.tif\n*** DIC method : local \n***\n") + rows(
            "SUBSET_ID,COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,SIGMA,GAMMA,BETA,STATUS_FLAG",
            lambda i, bad, x, y, u, v: "{},{:.4E},{:.4E},{:.4E},{:.4E},{},{},{},{}".format(
                i, *px(x, y, *((3.3, 3.3) if bad else (u, v))), *((-1, -1, -1, 9) if bad else (0.008, 0.02, 0.01, 4))))(
                    k, x, y, u, v), PX, 7, ".txt"),
        "pyvale, NaN": (rows(
            "subset_x,subset_y,disp_u,disp_v,disp_mag,converged,cost_zncc,ftol,xtol,num_iter,",
            lambda i, bad, x, y, u, v: "{:g},{:g},{},{},{},{},{},0,0,9".format(
                *px(x, y, u, v)[:2], *(("nan", "nan", "nan", 0, "nan") if bad else (
                    20 * u, -20 * v, 0, 1, 0.998)))), PX, 7),
        "OpenCorr, ZNCC below 0 where it failed": (rows(
            "x,y,u,v,u0,v0,ZNCC,iteration,convergence", lambda i, bad, x, y, u, v:
            "{:g},{:g},{:.5f},{:.5f},0,0,{},5,0.001".format(*px(x, y, *((0.4, 0.4) if bad else (u, v))),
                                                            -4 if bad else 0.99)),
            PX + named("x", "y", "u", "v", 'unit = "px"\ny_axis = "down"\nquality = "ZNCC"\nquality_min = 0.8\n'), 7),
        "inches": (rows("x [in],y [in],u [in],v [in]", lambda i, bad, x, y, u, v: ",".join(
            f"{q / 25.4:.8f}" for q in (x, y, u, v))), "", 0),
        "mm and micrometres": (rows("x [mm],y [mm],u [µm],v [µm]", lambda i, bad, x, y, u, v:
                                    f"{x},{y},{1000 * u:.3f},{1000 * v:.3f}"), "", 0),
        "units by hand in a line below": (rows("x;y;u;v\n[mm];[mm];[mm];[mm]", lambda i, bad, x, y, u, v:
                                               f"{x};{y};;" if bad else f"{x};{y};{u:.6f};{v:.6f}"), "", 7),
        "True and False": (rows("X,Y,DX,DY,valid", lambda i, bad, x, y, u, v:
                                f"{x},{y},{9 if bad else u},{9 if bad else v},{not bad}"),
                           named("X", "Y", "DX", "DY", 'unit = "mm"\nflag = "valid"\n'), 7),
        "named columns with decimal commas": (rows(
            "Pos X;Pos Y;Verschiebung X;Verschiebung Y", lambda i, bad, x, y, u, v:
            (f"{x};{y};;" if bad else f"{x};{y};{u:.6f};{v:.6f}").replace(".", ",")),
                                              named("Pos X", "Pos Y", "Verschiebung X", "Verschiebung Y"), 7),
        "exact zeros outside of a round region": (zeros_outside, "", None),
        "-999 for a point that failed": (rows("x_mm,y_mm,ux_mm,uy_mm", lambda i, bad, x, y, u, v:
                                              f"{x},{y},{-999 if bad else u},{-999 if bad else v}"), "", 7),
        "a workbook of a stage": (workbook, "", 7, ".xlsx"),
        "VTU of finite elements": (vtu, 'fields_unit = "mm"', 0, ".vtu"),
        "a table of all stages": (lambda k, x, y, u, v: rows("x_mm,y_mm,ux_mm,uy_mm", lambda i, bad, a, b, c, d:
                                                            f"{a},{b},{'--' if bad else c},{'--' if bad else d}")(
                                                                k, x, y, u, v), "", 7)}
    for name, (stage, more, failed, *rest) in cases.items():
        judge = _region if failed is None else partial(_field, stage, more, failed, tuple(rest))
        yield Input("failed points and units", name, judge)


def _field(stage, more, failed, rest, folder: Path) -> tuple[str, str]:
    return field(stage, more, failed, folder, *rest)


def _region(folder: Path) -> tuple[str, str]:
    """Points outside of the region are no measured points that stand still."""
    (folder / "stages").mkdir(parents=True)
    x, y = (v.ravel() for v in np.meshgrid(np.arange(40) * 0.5, np.arange(16) * 0.5))
    for k in range(4):
        rng = np.random.default_rng(k)
        (folder / "stages" / f"s{k}.csv").write_text(zeros_outside(
            k, x, y, 0.004 * k * x + rng.normal(0, 2e-4, x.shape), -0.0012 * k * y + rng.normal(0, 2e-4, x.shape)))
    (folder / "experiment.toml").write_text(FIELDS.replace("MORE", ""))
    experiment = load_experiment(folder)
    values = np.asarray(experiment.recording.stack.frame(3))
    inside = np.isfinite(values).all(axis=1)
    positions = experiment.recording.points.positions_px
    slope = 1e-3 * np.polyfit(positions[inside, 0] * experiment.recording.points.pitch_mm, values[inside, 0], 1)[0]
    return right_if(abs(slope - 0.012) < 3e-4, (inside.sum(), slope))

