"""An identification without a RUN, of a body that an external program simulates."""

from strip import write_strip

import idic


def test_without_files_an_external_program_gives_the_bits_of_a_run(tmp_path):
    folder = write_strip(tmp_path / "strip")
    in_memory, in_run = idic.identify(folder).content, idic.identify(folder, tmp_path / "run").content
    assert in_memory["status"] == "converged"
    for key in ("parameters", "M", "correlation", "history", "discrepancy", "frames"):
        assert in_memory[key] == in_run[key]
    assert in_memory["residual"] == {key: in_run["residual"][key] for key in in_memory["residual"]}
