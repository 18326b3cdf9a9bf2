"""Figures drawn by a second process are those that this process draws."""

import threading
from functools import partial

import pytest
from made_up_run import make_record

from idic.report import draw_sections, parts, plan_sections
from idic.run import drawing_beside

FEW = dict(reference=None, nodes_px=None, cells=(), residuals=None, fields=None, sensitivities=None, channels=(),
           views=(), free_fields=None)  # what a figure needs little time for


def test_the_second_process_draws_the_same_pictures_to_the_last_byte():
    record = make_record(**FEW)
    here = [draw() for draw in parts(plan_sections(record))]
    assert sum(picture is not None for picture in here) >= 3

    at_first = set(threading.enumerate())

    def wait(*_):
        for thread in set(threading.enumerate()) - at_first:  # it hands out the other parts
            thread.join(90.0)

    def refuse():
        raise AssertionError("drawn in this process")

    with drawing_beside() as second:
        second.start()
        drawn = second.draw_all(record, [wait, *[refuse] * (len(here) - 1)])
    assert drawn[1:] == here[1:]


@pytest.mark.parametrize("begun", [False, True])
def test_without_the_second_process_everything_is_drawn_here(begun):
    with drawing_beside() as second:
        if begun:
            second.start()
            second._process.kill()  # out of memory
        assert second.draw_all(make_record(**FEW), [partial(int, k) for k in range(5)]) == [0, 1, 2, 3, 4]


def test_an_error_of_a_figure_is_raised_here():
    def broken():
        raise ValueError("no such colour")

    with drawing_beside() as second, pytest.raises(ValueError, match="no such colour"):
        second.draw_all(make_record(**FEW), [broken])


@pytest.mark.slow  # all figures
def test_the_whole_page_has_the_same_pictures(sections):
    record = make_record()
    with drawing_beside() as second:
        second.start()
        assert draw_sections(record, partial(second.draw_all, record)) == sections
