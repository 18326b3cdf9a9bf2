"""Output files as a student's solver writes them: what would be read as wrong numbers is refused, the rest is read."""

from dataclasses import replace

import numpy as np
import pytest
from strip import write_strip

import idic
from idic.errors import NotConverged
from idic.fe import ExpectedOutput, gathered

U = {1: (0.0, 0.0), 2: (0.1, 0.0), 7: (0.1, -0.02)}  # node -> motion in the last frame, mm
WANTED = ExpectedOutput(np.array([1, 2, 7]), 2, np.array([1.0, 2.0]), ("RIGHT.x",), {"RIGHT": np.array([1, 2])}, 6.0,
                {"boundary.RIGHT.x": (np.array([2, 4]), np.array([0.0, 0.05, 0.1]))})


def rows(clock=(0.0, 1.0, 2.0), scale=1.0, loads=(0.0, 0.5, 1.0)):
    return [f"{t!r},{node},{scale * load * ux!r},{scale * load * uy!r}"
            for t, load in zip(clock, loads, strict=True) for node, (ux, uy) in reversed(U.items())]


def written(folder, motion, force=("0,0", "1,5", "2,10"), head="time,node,ux,uy", clock="time"):
    (folder / "displacements.csv").write_text("\n".join([head, *motion]) + "\n")
    (folder / "forces.csv").write_text("\n".join([f"{clock},RIGHT.x", *force]) + "\n")
    return folder


def test_order_further_nodes_further_times_and_a_byte_order_mark_do_not_matter(tmp_path):
    written(tmp_path, ["2.0,99,5,5", "2.0,99,6,6", "1.5,1,9,9", *rows()[::-1]], head="\ufefftime,node,ux,uy")
    found = gathered("csv", tmp_path, "job", WANTED)
    np.testing.assert_allclose(found.u[2], [U[1], U[2], U[7]])
    np.testing.assert_allclose(found.forces["RIGHT.x"], [0.0, 5.0, 10.0])


def test_a_step_may_repeat_the_last_frame_of_the_step_before(tmp_path):
    written(tmp_path, rows((0.0, 1.0, 1.0), loads=(0.0, 0.5, 0.50001)) + rows()[-3:], ("1,5", "1,5.0001", "2,10"))
    assert gathered("csv", tmp_path, "job", WANTED).u[1, 1, 0] == pytest.approx(0.05, rel=1e-4)


@pytest.mark.parametrize("motion, said", [
    (rows((0.0, 1.0, 2.0)) + rows((0.0, 1.0, 2.0), loads=(1.0, 1.5, 2.0)),
     "two different displacements of node 2 at the same time"),
    (rows(scale=1e-3), "moves by 0.0001 mm in frame 2 after the reference, where 0.1 mm are prescribed"),
    (rows(scale=-1.0), "moves by -0.1 mm"),
    (rows(loads=(0.2, 0.5, 1.0)), r"displacements up to 0.02 mm at the reference \(time 0\)"),
    (["2.0,1,0.0"], "3 cells in the row")])
def test_frames_of_another_clock_units_or_axes_are_refused(tmp_path, motion, said):
    with pytest.raises(NotConverged, match=said):
        gathered("csv", written(tmp_path, motion), "job", WANTED)


def test_a_motion_below_the_decimals_of_the_file_is_not_compared(tmp_path):
    """The noise of a grip that stands still, in a table that ends at 1e-6 mm."""
    still = {"boundary.LEFT.y": (np.array([1]), np.array([0.0, 3e-8, -2e-8]))}
    written(tmp_path, rows())
    assert gathered("csv", tmp_path, "job", replace(WANTED, motions={**WANTED.motions, **still})).u[2, 1, 0] == 0.1


def test_two_forces_at_one_time_are_refused(tmp_path):
    with pytest.raises(NotConverged, match="two different RIGHT.x at time 1"):
        gathered("csv", written(tmp_path, rows(), ("1,5", "2,10", "1,7")), "job", WANTED)


def test_columns_along_other_axes_are_refused(tmp_path):
    with pytest.raises(NotConverged, match="expected time, node, ux, uy"):
        gathered("csv", written(tmp_path, rows(), head="time,node,ux,uz"), "job", WANTED)


def test_frames_counted_from_one_at_the_reference_are_refused(tmp_path):
    force_driven = replace(WANTED, motions={})
    written(tmp_path, rows((1, 2, 3)), ("1,0", "2,5", "3,10"), "frame,node,ux,uy", "frame")
    with pytest.raises(NotConverged, match="counted up to 3.*count the reference as 0"):
        gathered("csv", tmp_path, "job", force_driven)
    written(tmp_path, rows((0, 1, 2)), ("0,0", "1,5", "2,10"), "frame,node,ux,uy", "frame")
    np.testing.assert_allclose(gathered("csv", tmp_path, "job", force_driven).forces["RIGHT.x"], [0.0, 5.0, 10.0])


def test_a_missing_frame_of_a_burst_is_not_replaced_by_its_neighbour(tmp_path):
    burst = replace(WANTED, times=np.array([0.001, 0.002, 200.0]), motions={})
    written(tmp_path, rows((0.0, 0.001, 200.0)), ("0,0", "0.001,5", "200,10"))
    with pytest.raises(NotConverged, match="no displacements of frame 2"):
        gathered("csv", tmp_path, "job", burst)


def test_calculix_may_print_the_displacements_of_several_sets(tmp_path):
    block = " displacements (vx,vy,vz) for set {} and time  {:.7E}\n\n{}\n"
    lines = lambda labels, load: "".join(  # noqa: E731
        f"{n:10d} {load * U[n][0]:13.6E} {load * U[n][1]:13.6E}  0.000000E+00\n" for n in labels)
    (tmp_path / "job.dat").write_text("".join(
        block.format("ALL", time, lines((1, 2, 7), load)) + block.format("RIGHT", time, lines((2, 7), load))
        + f" total force (fx,fy,fz) for set RIGHT and time  {time:.7E}\n\n  {10.0 * load:.6E} 0.0E+00 0.0E+00\n\n"
        for time, load in ((1.0, 0.5), (2.0, 1.0))))
    found = gathered("calculix_dat", tmp_path, "job", WANTED)
    np.testing.assert_allclose(found.u[2], [U[1], U[2], U[7]])
    assert found.forces["RIGHT.x"][2] == 10.0


def test_a_solver_that_moves_less_than_prescribed_is_reported(tmp_path):
    folder = write_strip(tmp_path / "strip")
    script = folder / "strange_solver.py"
    script.write_text(script.read_text().replace("strain = motion / LENGTH", "strain = 0.9 * motion / LENGTH"))
    with (folder / "experiment.toml").open("a") as file:
        file.write("[options]\nmax_iterations = 1\n")
    notes = idic.identify(folder, tmp_path / "run")["notes"]
    assert any("boundary.RIGHT.x by 0.108 mm in frame 4" in note and "0.12 mm" in note for note in notes)


DISPLACEMENTS = """
 displacements (vx,vy,vz) for set ALL and time  {time}

         1  0.000000E+00  0.000000E+00  0.000000E+00
         2  {x}  0.000000E+00  0.000000E+00{mark}
         7  {x} {y}  0.000000E+00

 total force (fx,fy,fz) for set RIGHT and time  {time}

        {force}  2.719641E+01  1.980754E-16
"""


def calculix(folder, mark="", y="-2.000000E-02", force="1.000000E+01"):
    frames = (("0.1000000E+01", "5.000000E-02"), ("0.2000000E+01", "1.000000E-01"))
    (folder / "job.dat").write_text("".join(DISPLACEMENTS.format(time=time, x=x, y=y, mark=mark, force=force)
                                            for time, x in frames))
    return folder


def test_rows_of_calculix_in_the_axes_of_a_transform_are_refused(tmp_path):
    """ccx 2.20 marks the rows of *NODE PRINT in local axes by L; total forces stay in the axes of the mesh."""
    assert gathered("calculix_dat", calculix(tmp_path), "job", WANTED).u[2, 2, 1] == -0.02
    with pytest.raises(NotConverged, match=r"node 2 is written in the axes of its \*TRANSFORM .*GLOBAL=YES"):
        gathered("calculix_dat", calculix(tmp_path, " L"), "job", WANTED)


def test_exponents_of_three_digits_of_calculix_have_no_letter(tmp_path):
    calculix(tmp_path, y="-1.425043-118", force="1.500000+101")
    solution = gathered("calculix_dat", tmp_path, "job", WANTED)
    assert solution.u[1, 2, 1] == -1.425043e-118 and solution.forces["RIGHT.x"][1] == 1.5e101
