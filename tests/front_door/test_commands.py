"""What a user meets first: help, exit codes, messages that say what to do."""

import io
import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
import typer
from prefect.exceptions import TerminationSignal
from typer.testing import CliRunner

from idic.cli.app import app, exit_code, read_overrides
from idic.cli.outcomes import outcome
from idic.errors import InputError, NotConverged


def idic(*arguments, **options):
    command = [sys.executable, "-m", "idic", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, **options)


def test_help_lists_every_command_of_the_contract():
    answer = idic("--help")
    assert answer.returncode == 0
    for command in ("demo", "init", "example", "check", "design", "simulate", "identify", "diagnose", "report",
                    "compare",
                    "laws", "physics"):
        assert f"  {command} " in answer.stdout


def test_help_answers_at_once():
    code = "import sys, idic.__main__, idic.cli.app; print('numba' in sys.modules, 'prefect' in sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert loaded.stdout.split() == ["False", "False"]  # what costs the seconds; studies/bench measures them


def test_the_version_is_that_of_the_package():
    from importlib.metadata import version

    assert idic("--version").stdout.strip() == f"idic {version('idic')}"


def test_identify_has_the_common_options():
    text = idic("identify", "--help").stdout
    assert all(option in text for option in ("--out", "--resume", "--workers", "--scheduler", "--sensitivity", "--set"))


def test_the_laws_are_listed_with_units_and_null_values():
    answer = idic("laws", "j2_linear", env={**os.environ, "COLUMNS": "120"})
    assert answer.returncode == 0
    assert all(word in answer.stdout for word in ("yield_stress", "MPa", "null", "hardening_modulus"))
    assert "sigma = yield_stress + hardening_modulus p" in answer.stdout and "doi:" in answer.stdout


# bad input: exit code 2, one message, nothing written ---------------------------------------------
@pytest.mark.parametrize(
    "arguments",
    [["check", "missing"], ["init", "missing"], ["report", "missing"], ["laws", "--plot", "x.png"],
     ["example", "no_such_example", "--out", "there"], ["identify", "missing", "--out", "RUN", "--set", "nonsense"],
     ["no-such-command"], ["example", "demo", "--out", "there", "--seed", "-1"],
     ["example", "demo", "--out", "there", "--bits", "9"], ["identify", "--workers", "x"]],
    ids=" ".join,
)  # fmt: skip
def test_bad_input_ends_with_code_2_and_writes_nothing(arguments, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    answer = CliRunner().invoke(app, arguments)
    assert answer.exit_code == 2, answer.stderr
    assert answer.stderr and "Traceback" not in answer.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("arguments", [["identify", "missing", "--out", "RUN", "--no-prefect"],
                                       ["laws", "no_such_law"]], ids=" ".join)
def test_a_process_ends_with_code_2_on_bad_input_and_writes_nothing(arguments, tmp_path):
    answer = idic(*arguments, cwd=tmp_path)
    assert answer.returncode == 2, answer.stderr
    assert answer.stderr and "Traceback" not in answer.stderr
    assert not list(tmp_path.iterdir())


def test_settings_are_key_and_value():
    assert read_overrides(["a.b=1", "title = x=y"]) == {"a.b": "1", "title": "x=y"}
    with pytest.raises(InputError, match="not a setting"):
        read_overrides(["a.b"])


@pytest.mark.parametrize(
    "status, code",
    [("converged", 0), ("stalled", 3), ("max_iterations", 3), ("at_bound", 3), ("forward_failed", 3),
     ("interrupted", 4)],
)
def test_the_status_decides_the_exit_code(status, code):
    assert exit_code(status) == code


# how a command ends -------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "problem, code, words",
    [(InputError("no force", file="loads.csv", remedy="add it"), 2, "loads.csv: no force"),
     (NotConverged("at t = 3 s"), 3, "did not converge"),
     (KeyboardInterrupt(), 4, "--resume"),
     (OSError(28, "No space left on device", "x"), 2, "No space left"),
     (ZeroDivisionError("oops"), 1, "bug in idic")],
)  # fmt: skip
def test_every_end_has_its_code_and_its_words(problem, code, words, tmp_path, capsys):
    with pytest.raises(typer.Exit) as end, outcome(run=tmp_path, resume=True):
        raise problem
    assert end.value.exit_code == code
    message = capsys.readouterr().err
    assert words in message and "Traceback" not in message
    assert (tmp_path / "log.txt").exists() == (code == 1)


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="needs a file system that takes no folders")
def test_a_place_that_takes_no_folder_is_the_users_business(tmp_path, capsys):
    with pytest.raises(typer.Exit) as end, outcome(run=tmp_path):
        Path("/proc/idic/run").mkdir(parents=True)
    assert end.value.exit_code == 2 and "choose another path" in capsys.readouterr().err


def test_noise_below_zero_is_refused():
    answer = idic("simulate", "missing", "--out", "there", "--noise-gv", "-3")
    assert answer.returncode == 2 and "--noise-gv" in answer.stderr


def test_a_bug_leaves_its_traceback_in_the_log_of_the_run(tmp_path):
    with pytest.raises(typer.Exit), outcome(run=tmp_path):
        raise ZeroDivisionError("oops")
    log = (tmp_path / "log.txt").read_text()
    assert "Traceback" in log and "oops" in log and "numpy " in log


def test_a_bug_without_a_run_leaves_its_traceback_in_a_file_of_its_own(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    with pytest.raises(typer.Exit), outcome():
        raise ZeroDivisionError("oops")
    (file,) = tmp_path.iterdir()
    assert str(file) in capsys.readouterr().err and "oops" in file.read_text()


@pytest.mark.skipif(os.name != "posix", reason="sends POSIX signals")
@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_ends_with_code_4_and_says_how_to_go_on(stop):
    code = """
        import time, typer
        from idic.cli.outcomes import outcome
        app = typer.Typer()
        @app.command()
        def identify(folder: str, out: str = ""):
            with outcome(resume=True):
                print("working", flush=True)
                time.sleep(30)
        app()
    """
    command = [sys.executable, "-c", textwrap.dedent(code), "my test", "--out", "RUN"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "working\n"
    process.send_signal(stop)
    _, errors = process.communicate(timeout=10)
    assert process.returncode == 4
    assert "idic 'my test' --out RUN --resume" in errors and "Traceback" not in errors


@pytest.mark.parametrize("stop", [KeyboardInterrupt, lambda: TerminationSignal(signal.SIGTERM)])
def test_failures_during_an_interruption_are_reported_as_the_interruption(stop, capsys):
    """Whatever Dask, Prefect or asyncio still had open: the run can go on, and no bug is reported."""
    with pytest.raises(typer.Exit) as ended, outcome(resume=True):
        try:
            raise stop()
        finally:
            try:
                raise OSError(9, "Bad file descriptor")
            finally:
                raise RuntimeError("event loop is closed")
    assert ended.value.exit_code == 4
    said = capsys.readouterr().err
    assert "--resume" in said and "bug" not in said


def test_a_failure_that_an_interruption_did_not_cause_stays_one(tmp_path):
    with pytest.raises(typer.Exit) as ended, outcome(run=tmp_path, resume=True):
        raise OSError(9, "Bad file descriptor")
    assert ended.value.exit_code == 1


def test_the_shell_completes_commands_and_options(monkeypatch):
    monkeypatch.setenv("_IDIC_COMPLETE", "complete_bash")
    for words, expected in (("idic cal", "calibrate"), ("idic identify --res", "--resume")):
        monkeypatch.setenv("COMP_WORDS", words)
        monkeypatch.setenv("COMP_CWORD", str(words.count(" ")))
        assert expected in CliRunner().invoke(app, prog_name="idic").output.split()


@pytest.mark.parametrize("encoding", ["latin-1", "cp1252", "ascii", "utf-8"])
def test_a_letter_that_the_terminal_does_not_have_ends_no_command(encoding, monkeypatch):
    """The minus sign and the chi of the tables, and a file name that is no UTF-8."""
    from idic.cli import app as program

    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(io.BytesIO(), encoding=encoding))
    monkeypatch.setattr("idic.cli.app.use_one_thread", lambda: None)
    monkeypatch.setattr("idic.cli.app.app", lambda: print("−3 °C, χ² \udcff"))
    program.main()
    sys.stdout.flush()
    assert b"3" in sys.stdout.buffer.getvalue()


def test_a_command_is_a_flow_where_somebody_can_look(tmp_path):
    """A terminal shows the address of Prefect's pages; a configured server has them; the option decides."""
    code = "from idic.cli.app import is_watched; print(is_watched(None), is_watched(True), is_watched(False))"
    bare = {name: value for name, value in os.environ.items() if not name.startswith("PREFECT_")}
    bare["PREFECT_HOME"] = str(tmp_path)

    def answer(stderr, **more):
        return subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=stderr, text=True,
                              env=bare | more).stdout.split()

    terminal, far_end = os.openpty()
    try:
        assert answer(subprocess.PIPE) == ["False", "True", "False"]
        assert answer(far_end) == ["True", "True", "False"]
        assert answer(subprocess.PIPE, PREFECT_API_URL="http://127.0.0.1:4200/api") == ["True", "True", "False"]
    finally:
        os.close(terminal)
        os.close(far_end)
