"""Logs of every dialect, whole and spoilt: read as the numbers that stand there, or refused with one message."""

from __future__ import annotations

import numpy as np
from base_experiments import base_folder
from commands import campaign, check, copy_of
from hypothesis import strategies as st
from spoil_log import VALUES, Damage, Dialect, LogFile, damages, dialects
from spoil_toml import splices

from idic.cli.outcomes import DONE
from idic.experiment_file import load_experiment



def a_log(dialect, spoilt):
    log = LogFile(dialect, tuple(spoilt))
    with copy_of(base_folder("cameras")) as folder:
        (folder / "loads.csv").write_bytes(log.content())
        answer = check(folder)
        if answer.code == DONE:
            assert_read_as_written(folder, log)


def assert_read_as_written(folder, log: LogFile) -> None:
    """What was accepted are the numbers of the table (but for cells that were given other numbers)."""
    experiment = load_experiment(folder)
    (force,), grip = (
        experiment.model.channels,
        next(p for p in experiment.model.prescribed if p.nodes == "TOP" and p.component == "y"),
    )
    truth = np.array(VALUES)
    spoilt = {damage.row % 4 for damage in log.damages if damage.what == "cell"}
    sure = [
        k for k in range(4) if k not in spoilt and not any(d.what in ("cut", "splice", "name") for d in log.damages)
    ]
    np.testing.assert_allclose(experiment.model.times[sure], truth[sure, 1],
                               rtol=1e-5)  # the dialects write 5 digits or more
    np.testing.assert_allclose(force.values[sure], 1e3 * truth[sure, 2], rtol=1e-5)
    np.testing.assert_allclose(grip.drive.values[sure], 1e-3 * truth[sure, 3], rtol=1e-5)
    if any(d.what == "cut" for d in log.damages) and all(d.what == "cut" for d in log.damages):  # text has no end mark
        np.testing.assert_allclose(force.values[:3], 1e3 * truth[:3, 2], rtol=1e-5)


def test_ordinary_dialects_are_read():
    for dialect in (
        Dialect(),
        Dialect(";", ","),
        Dialect("\t"),
        Dialect(newline="\r\n", encoding="utf-8-sig"),
        Dialect(quoted=True),
        Dialect(quoted=True, decimal=","),
        Dialect(";", ",", encoding="cp1252", above=("Operator{}Müller", "Specimen{}5"), units=True, excel=True),
        Dialect(";", ",", encoding="utf-16", minus="\N{MINUS SIGN}", units=True, spare_columns=2, spare_rows=3),
        Dialect("\t", ",", encoding="utf-16-le", above=("Test 7", ""), spare_columns=1),
    ):
        with copy_of(base_folder("cameras")) as folder:
            (folder / "loads.csv").write_bytes(LogFile(dialect).content())
            answer = check(folder)
            assert answer.code == DONE, answer.said
            assert_read_as_written(folder, LogFile(dialect))


def test_a_cell_too_many_before_an_empty_column_is_refused():
    with copy_of(base_folder("cameras")) as folder:
        log = LogFile(Dialect(spare_columns=1), (Damage("gain_cell", 0, 0),))  # found by the campaign: read, shifted
        (folder / "loads.csv").write_bytes(log.content())
        answer = check(folder)
        assert answer.code != DONE and "below no name" in answer.said, answer.said


def a_log_with_a_cell_that_is_no_number(dialect, row, column, text):
    log = LogFile(dialect, (Damage("cell", row, column, text),))
    with copy_of(base_folder("cameras")) as folder:
        (folder / "loads.csv").write_bytes(log.content())
        assert check(folder).code != DONE


test_a_log, test_many_logs = campaign(30, a_log, dialect=dialects(), spoilt=st.lists(damages(splices), max_size=2))
test_a_cell, test_many_cells = campaign(
    12,
    a_log_with_a_cell_that_is_no_number,
    share=0.3,
    row=st.integers(0, 3),
    column=st.integers(0, 3),
    dialect=st.sampled_from([Dialect(), Dialect(";", ","), Dialect("\t")]),
    text=st.sampled_from(["nan", "inf", "", "lost", "1_0", "٣", "0x10", "1e400", "1 2", "1e300", "1.580.000", "1'580"]),
)
