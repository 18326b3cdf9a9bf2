"""Kills at random instants, of whatever belongs to a run: it ends with the bits of the run that nothing disturbed.

A few in the default tests; IDIC_KILLS (50) of them with ``-m slow``, in turn over runs of the plain loop, of two worker
processes, and of the command with its Prefect server.
"""

from __future__ import annotations

import os
import signal
from collections import Counter

import numpy as np
import psutil
import pytest
from fault_runs import (command_line, descendants, evaluations, finish, is_at, kill, outcome, plain_run, still_alive,
                        stored_system)

KILLS = int(os.environ.get("IDIC_KILLS", "50"))
WAYS = {
    "plain": ("driver",),
    "workers": ("driver", "worker"),
    "command": ("driver", "worker", "server", "sigterm", "ctrl_c"),
}


def start(way: str, small, run):
    if way == "command":
        return command_line(
            "identify", small.experiment, "--out", run, "--prefect", "--workers", 2,
            *(["--resume"] if run.exists() else [])
        )
    return plain_run(small.experiment, run, 2 if way == "workers" else 0)


def members(process, victim: str) -> list[psutil.Process]:
    """Worker processes, or the Prefect server, of a running command."""
    mark = "spawn_main" if victim == "worker" else "uvicorn"
    found = []
    for member in descendants(process):
        try:
            if mark in " ".join(member.cmdline()):
                found.append(member)
        except psutil.Error:
            continue
    return found


def strike(process, victim: str, generator, run) -> bool:
    """Kill one of a run; whether the run is over now (dead, or it ended with code 4 and said how to go on)."""
    family = descendants(process)
    if victim in ("worker", "server"):
        chosen = members(process, victim)
        if not chosen:
            return strike(process, "driver", generator, run)
        chosen[int(generator.integers(len(chosen)))].kill()
        return False
    if victim == "driver" or not (run / "run.zarr").exists():  # before that, Python itself may still be starting
        kill(process)
        assert not still_alive(family), "processes without their driver"
        return True
    if victim == "sigterm":
        process.send_signal(signal.SIGTERM)
    else:
        os.killpg(process.pid, signal.SIGINT)
    code, said = finish(process)
    assert code in (0, 4), said  # 0: it was over already
    assert code == 0 or ("--resume" in said and "Traceback" not in said), said
    assert not still_alive(family)
    return True


def campaign(small, folder, seed: int, kills: int, ways=tuple(WAYS)) -> Counter:
    """Runs of every way in turn, each struck again and again until it ends or `kills` are used up; ends compared."""
    generator, done, number, whole = np.random.default_rng(seed), Counter(), 0, evaluations(small.run)
    while sum(done.values()) < kills:
        way, run = ways[number % len(ways)], folder / f"run-{number}"
        number += 1
        while True:
            process = start(way, small, run)
            over = False
            while not over and sum(done.values()) < kills and is_at(run, process, generator.uniform(0.0, 1.2), whole):
                victim = WAYS[way][int(generator.integers(len(WAYS[way])))]
                over = strike(process, victim, generator, run)
                done[f"{way}: {victim}"] += 1
            if not over:
                code, said = finish(process)
                assert code == 0, said
                break
        assert outcome(run) == small.result
        assert stored_system(run) == small.system
        assert not [path for path in run.rglob(".*") if path.name.endswith((".tmp", ".old"))]
    return done


@pytest.mark.slow  # 40 s of CPU time; test_resume.py kills a command with its workers
@pytest.mark.parametrize("way", ["workers", "plain"])
def test_a_run_with_and_one_without_workers_are_killed(small, tmp_path, way):
    campaign(small, tmp_path, seed=1, kills=1, ways=(way,))


@pytest.mark.slow
def test_the_prefect_server_is_killed_and_the_command_goes_on(small, tmp_path):
    """Without an interruption: it gets a successor, and where that is too late the run goes on without."""
    run = tmp_path / "run"
    process = start("command", small, run)
    while not (run / "state.json").exists():
        assert process.poll() is None, finish(process)
    (server,) = members(process, "server")
    server.kill()
    family = descendants(process)
    code, said = finish(process)
    assert code == 0 and "internal error" not in said, said
    assert outcome(run) == small.result and not still_alive(family)


@pytest.mark.slow
def test_many_kills_at_random_instants(small, tmp_path, capsys):
    done = campaign(small, tmp_path, seed=int(os.environ.get("IDIC_SEED", "7")), kills=KILLS)
    with capsys.disabled():
        print(f"\n{sum(done.values())} kills: {dict(sorted(done.items()))}")
    assert sum(done.values()) >= KILLS
