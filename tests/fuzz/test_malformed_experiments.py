"""experiment.toml changed at random: understood, or refused with one message."""

from __future__ import annotations

import pytest
from base_experiments import BASES, base_folder
from commands import campaign, check, copy_of, idic
from hypothesis import strategies as st
from spoil_toml import changed_experiments, splices

from idic.cli.outcomes import DONE


@pytest.mark.parametrize("name", BASES)
def test_the_experiments_that_are_changed_here_are_well_formed(name):
    with copy_of(base_folder(name)) as folder:
        assert idic("check", folder).code == DONE


def changed_tables(changed, picture):
    with copy_of(base_folder(changed.base)) as folder:
        (folder / "experiment.toml").write_text(changed.text, encoding="utf-8")
        check(folder, picture)


def spoilt_text(base, spoilt):
    with copy_of(base_folder(base)) as folder:
        data = (folder / "experiment.toml").read_bytes()
        for splice in spoilt:
            data = splice(data)
        (folder / "experiment.toml").write_bytes(data)
        check(folder)


test_changed_tables, test_many_changed_tables = campaign(
    30, changed_tables, changed=changed_experiments(), picture=st.just(False)
)
test_a_drawn_one, test_many_drawn_ones = campaign(
    4, changed_tables, share=0.4, changed=changed_experiments(), picture=st.just(True)
)
test_spoilt_text, test_many_spoilt_texts = campaign(
    20, spoilt_text, base=st.sampled_from(sorted(BASES)), spoilt=st.lists(splices, min_size=1, max_size=2)
)
