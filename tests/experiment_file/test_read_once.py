"""Files that many experiments of one command share are read once, and again where they have changed."""

from idic.read_once import files_read_once, read_once


def test_a_file_is_read_once_within_the_block_and_again_after_a_change(tmp_path):
    path, reads = tmp_path / "mesh.inp", []
    path.write_text("first")

    def read(file):
        reads.append(file)
        return file.read_text()

    assert [read_once(read, path) for _ in range(2)] == ["first"] * 2 and len(reads) == 2
    with files_read_once():
        kept = [read_once(read, path) for _ in range(3)]
        with files_read_once():
            assert read_once(read, path) is kept[0]
        assert kept == ["first"] * 3 and len(reads) == 3
        path.write_text("another")
        assert read_once(read, path) == "another" and len(reads) == 4
    assert read_once(read, path) == "another" and len(reads) == 5
