"""What a point of every law costs: stress, stress with tangent, and nine derivatives; beside another version of idic.

Two processes, one for each version, measure in turns: ratios are of the same seconds. IDIC_OTHER names a checkout of
the other version: git worktree add FOLDER 3c8fed03.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.bench, pytest.mark.slow]
ROUNDS = 5
MODES = {0: "solid", 1: "plane strain", 2: "plane stress"}
PROCESS = """
import sys, json, time
sys.path.insert(0, sys.argv[1])
import numpy as np
try:
    from idic.laws import all_laws, compile, directional_stresses, point_stresses, point_tangents
except ImportError:
    from idic.materials import all_laws, compile
    from idic.materials.core.points import directional as directional_stresses
    from idic.materials.core.points import stress as point_stresses, tangent as point_tangents
N, STEPS, REPEATS, cases = 2000, 4, 4, {}

def prepared(name, kinematics, mode):
    law = compile(name, kinematics)
    d = 3 if mode == 0 else 2
    rng = np.random.default_rng(0)
    way = rng.standard_normal((N, d, d))
    way /= np.linalg.norm(way, axis=(1, 2))[:, None, None]
    params, state = law.spec.defaults(), np.tile(law.initial_state(mode), (N, 1))
    for k in range(STEPS):
        F, old = np.eye(d) + 0.004 * (k + 1) * way, state
        P, state, ok = point_stresses(law, mode, F, old, params, 1.0)
        assert ok, name
    unit = np.tile(np.eye(d * d).reshape(d * d, d, d), (N, 1, 1, 1))
    dstate = np.zeros((N, d * d, state.shape[1]))
    dparams = np.zeros((d * d, len(params)))
    guess = {"guess": np.ascontiguousarray(state[:, -1])} if mode == 2 else {}
    A, B = np.empty((N, d * d, d * d)), (np.empty_like(unit), np.empty_like(dstate))
    return (lambda: point_stresses(law, mode, F, old, params, 1.0, out=(P, state)),
            lambda: point_tangents(law, mode, F, old, params, 1.0, out=(P, state, A)),
            lambda: directional_stresses(law, mode, F, old, params, 1.0, unit, dstate, dparams, out=B, **guess))

for line in sys.stdin:
    case = tuple(json.loads(line))
    if case == ("laws",):
        answer = [(name, kinematics) for name, spec in all_laws().items() for kinematics in spec.kinematics]
    else:
        if case not in cases:
            cases.clear()
            cases[case] = prepared(*case)
            [function() for function in cases[case]]
        answer = []
        for function in cases[case]:
            moments = [time.process_time()]
            for _ in range(REPEATS):
                function()
                moments.append(time.process_time())
            answer.append(1e6 * np.diff(moments).min() / N)
    print(json.dumps(answer), flush=True)
"""


class Version:
    """A process with one version of idic: asked by a list, it answers by a list."""

    def __init__(self, checkout):
        self.process = subprocess.Popen([sys.executable, "-c", PROCESS, str(checkout)], stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE, text=True)

    def __call__(self, *case):
        self.process.stdin.write(json.dumps(case) + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def close(self):
        self.process.stdin.close()
        self.process.wait()


@pytest.fixture(scope="module")
def versions():
    other = os.environ.get("IDIC_OTHER", "")
    if not (Path(other) / "idic" / "__init__.py").exists():
        pytest.skip("IDIC_OTHER names no checkout of another version")
    pair = Version(Path(__file__).parents[2]), Version(Path(other).resolve())
    yield pair
    for version in pair:
        version.close()


@pytest.mark.parametrize("mode", MODES, ids=MODES.values())
def test_points_beside_another_version(measured, versions, mode):
    """Least of some rounds. IDIC_BENCH_LAWS: beginnings of the names of the laws to measure, with commas between."""
    this, other = versions
    wanted = tuple(os.environ.get("IDIC_BENCH_LAWS", "").split(","))
    slowest = {}
    for name, kinematics in this("laws"):
        if not name.startswith(wanted):
            continue
        times = [[], []]
        for _ in range(ROUNDS):
            for version, rows in zip((this, other), times, strict=True):
                rows.append(version(name, kinematics, mode))
        new, old = ([min(column) for column in zip(*rows, strict=True)] for rows in times)
        stress, tangent, derivatives = (before / now for before, now in zip(old, new, strict=True))
        measured(f"{name}, {kinematics}, {MODES[mode]}",
                 f"stress {new[0]:.2f}, with tangent {new[1]:.2f} us ({1.0 / new[1]:.2f} M/s), "
                 f"derivatives {new[2]:.2f} us",
                 f"{old[0]:.2f}, {old[1]:.2f}, {old[2]:.2f} us: {stress:.2f}, {tangent:.2f}, {derivatives:.2f} times")
        slowest[name, kinematics] = tangent
    assert min(slowest.values()) > 0.9
