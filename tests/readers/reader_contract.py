"""What every reader of files keeps to: a class of tests that the tests of each kind of file inherit.

A reader turns a file that exists into arrays. It executes nothing, writes nothing, and refuses a damaged file with one
`InputError` that names the file and says what was expected, what was found and what to do.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from idic.errors import InputError

SPOILT = {"empty": lambda content: b"", "zeros": lambda content: bytes(len(content)),
          "noise": lambda content: np.random.default_rng(1).bytes(600), "text": lambda content: b"no data\n" * 20}


class ReaderContract:
    """files : name of a file -> function that writes it at a path; read : reads it"""

    files: dict[str, Callable[[Path], object]]

    def read(self, path: Path):
        raise NotImplementedError

    def pytest_generate_tests(self, metafunc):
        if "file_name" in metafunc.fixturenames:
            metafunc.parametrize("file_name", self.files)

    @pytest.fixture
    def written(self, file_name, tmp_path) -> Path:
        path = tmp_path / file_name
        self.files[file_name](path)
        return path

    def refused(self, path: Path) -> InputError:
        with pytest.raises(InputError) as refusal:
            self.read(path)
        error = refusal.value
        assert Path(str(error.file)).name == path.name and error.remedy and error.expected and error.found, str(error)
        return error

    def test_a_whole_file_is_read_and_nothing_is_written(self, written):
        before = written.read_bytes()
        assert self.read(written) is not None
        assert list(written.parent.iterdir()) == [written] and written.read_bytes() == before

    @pytest.mark.parametrize("spoilt", SPOILT)
    def test_a_file_of_other_contents_is_refused(self, written, spoilt):
        written.write_bytes(SPOILT[spoilt](written.read_bytes()))
        self.refused(written)

    def test_a_file_that_is_cut_is_refused_or_read_as_far_as_it_goes(self, written):
        content = written.read_bytes()
        for share in (0.1, 0.5, 0.9):
            written.write_bytes(content[:int(share * len(content))])
            try:
                self.read(written)
            except InputError as error:
                assert error.remedy and error.found, str(error)
