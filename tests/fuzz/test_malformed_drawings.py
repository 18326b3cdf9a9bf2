"""What a page could send to `idic draw`, changed at random: answered, or refused with one message; never a fault."""

from __future__ import annotations

import asyncio
import copy
import json
import sys
from functools import cache
from pathlib import Path

import httpx
import pytest
from commands import _time_limit, campaign, contents
from hypothesis import strategies as st
from scratch import lasting_folder

sys.path.insert(0, str(Path(__file__).parents[1] / "draw"))

from drawn_folder import make_folder, plan  # noqa: E402

from idic.draw.desk import Desk  # noqa: E402
from idic.draw.server import application  # noqa: E402

PORT, TOKEN = 4711, "token"
NUMBERS = [0, -1, 1, 2, 3.5, 1e-300, 1e300, -1e300, float("nan"), float("inf"), 10**30, 1e7, True]
STRANGE = [None, "", "x", "LEFT", "../x", "\x00", "\x1b[31m", "x" * 3000, [], {}, [[]], [None], {"": {}}, ["LEFT"],
           [1, 2, 3, 4], [[0, 0]], [[22.0, 32.0], [218.0, 32.0]], "nan", "force_N", "grip_displacement_mm", "p_bar",
           '"]\n[x', "\u202e", *NUMBERS]  # fmt: skip


@cache
def folder() -> Path:
    return make_folder(lasting_folder("draw") / "test")


@cache
def desk() -> Desk:
    return Desk(folder())


def asked(method: str, to: str, **more) -> httpx.Response:
    """The answer of the application, in this process; what it raises is raised here."""
    async def ask() -> httpx.Response:
        transport = httpx.ASGITransport(app=application(desk(), TOKEN, PORT))
        async with httpx.AsyncClient(transport=transport, base_url=f"http://127.0.0.1:{PORT}/{TOKEN}/api/",
                                     headers={"origin": f"http://127.0.0.1:{PORT}"}) as client:
            return await client.request(method, to, **more)

    with _time_limit():
        return asyncio.run(ask())


def places(content, at=()) -> list[tuple]:
    """Every place in nested dictionaries and lists."""
    inside = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    return [at, *(place for key, value in inside for place in places(value, (*at, key)))]


def changed(content: dict, changes: list[tuple]) -> dict:
    """A copy with another value, without one, or with one twice, at shares of the list of places."""
    content = {"whole": copy.deepcopy(content)}
    for share, how, given in changes:
        value = copy.deepcopy(given)  # or a list of the ways below would be put into itself
        there = [place for place in places(content) if place]
        *way, last = there[min(int(share * len(there)), len(there) - 1)]
        holder = content
        for key in way:
            holder = holder[key]
        if how == "replace" or last == "whole":
            holder[last] = value
        elif how == "remove":
            del holder[last]
        elif isinstance(holder, list):
            holder.insert(last, value)
        else:
            holder[f"{last}2"] = value
    return content["whole"]


def assert_fair(answer) -> None:
    assert answer.status_code in (200, 404, 422), answer.text
    if answer.status_code == 422:
        said = answer.json()
        assert said["what"] and said["remedy"] and len(answer.text) < 3000, said
        assert "\x00" not in said["what"] and "\x1b" not in said["what"], said
    elif answer.headers.get("content-type", "").startswith("application/json"):
        json.loads(answer.text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON for a browser"))


def a_changed_plan(changes, to):
    content, before = changed(plan(), changes), contents(folder())
    sketch = content.get("sketch") if isinstance(content, dict) else content
    body = {"sketch": sketch, "images": "images/*.tif"} if to == "mesh" else {"plan": content}
    assert_fair(asked("POST", to, content=json.dumps(body), headers={"content-type": "application/json"}))
    assert contents(folder()) == before, "something was written"


def a_question(question):
    to, fields = question
    assert_fair(asked("GET", to, params=fields))


_value = st.one_of(st.sampled_from(STRANGE), st.floats(), st.text(max_size=20), st.floats(-400, 400))
_how = st.sampled_from(["replace", "remove", "add"])
_changes = st.lists(st.tuples(st.floats(0, 1, exclude_max=True), _how, _value), min_size=1, max_size=3)
_words = st.one_of(st.sampled_from(["images/*.tif", "loads.csv", "run", "0", "1", "-1", "1e9", "nan", "240", "", "../x"]
                                   ), st.text(max_size=8))
_QUESTIONS = {"size": ["images"], "area": ["images"], "log": ["name", "images"], "run": ["name"],
              "part": ["images", "frame", "x0", "y0", "x1", "y1", "width"]}
_question = st.sampled_from(sorted(_QUESTIONS)).flatmap(lambda to: st.tuples(
    st.just(to), st.fixed_dictionaries({}, optional={name: _words for name in _QUESTIONS[to]})))


def test_the_plan_that_is_changed_here_is_answered():
    sketch = {"sketch": plan()["sketch"], "images": "images/*.tif"}
    assert asked("POST", "text", json={"plan": plan()}).status_code == 200
    assert asked("POST", "mesh", json=sketch).status_code == 200


test_a_changed_plan, test_many_changed_plans = campaign(
    20, a_changed_plan, changes=_changes, to=st.sampled_from(["text", "text", "mesh"]))
test_a_question, test_many_questions = campaign(15, a_question, question=_question)
