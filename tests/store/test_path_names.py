"""Labels of users as parts of paths: inside the RUN folder, whatever they are called."""

import pytest

from idic.errors import InputError
from idic.run import RunStore, group_name
from idic.path_names import MAX_BYTES, path_name

STRANGE = ["../../elsewhere", "..", ".", ".hidden", "Force/N", "a\\b", "C:", "nul", "end.", "tab\there", "100 %",
           "é" * 200, ""]


@pytest.mark.parametrize("label", STRANGE)
def test_a_label_is_one_plain_part_of_a_path(label, tmp_path):
    name = path_name(label)
    assert name and len(name.encode()) <= MAX_BYTES and not name.startswith(".") and not set(name) & set('/\\:*?"<>|\t')
    (tmp_path / name).mkdir()
    assert [entry.name for entry in tmp_path.iterdir()] == [name]


def test_different_labels_have_different_names():
    labels = [*STRANGE, "Force%2FN", "%2E.", "é" * 201, "a%5Cb"]
    assert len({path_name(label) for label in labels}) == len(labels)


@pytest.mark.parametrize("label",
                         ["base", "SPECIMEN.E", "boundary.RIGHT.x.slip", "local-0", "a part of steel", "Stück_1"])
def test_usual_labels_stay_as_they_are(label):
    assert path_name(label) == label and group_name(7, label) == f"evaluations/007/{label}"


def test_no_group_lies_outside_the_store(tmp_path):
    store = RunStore(tmp_path / "run")
    with store.claim("one"):
        (tmp_path / "elsewhere").mkdir()
        (store.path / "link").symlink_to(tmp_path / "elsewhere")
        for name in ("../elsewhere", "evaluations/../../../elsewhere", "link/group"):
            with pytest.raises(InputError, match="outside its folder"), store.building(name):
                pass
            with pytest.raises(InputError, match="outside its folder"):
                store.remove(name)
    assert not list((tmp_path / "elsewhere").iterdir())
