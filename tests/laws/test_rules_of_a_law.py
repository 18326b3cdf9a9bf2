"""A law of the user that breaks a rule is refused when it is first used: machine code itself would return any
numbers."""

import importlib
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from numba import njit

import idic
from idic.errors import InputError
from idic.laws import point
from idic.laws import LawParameter, LawSpec, code_of, compile, get_law, is_kept, outside_values, register
from idic.laws.core import law as registry
from idic.laws.core.compilation import LINEARISE, UPDATE, UPDATE_COMPLEX, compile_cached, pointer
from idic.laws.core.update_check import check_update


def keeps(F, state, params, dt, P, state_new):
    """A spring E that weakens with the largest strain so far."""
    strain = F[0, 0] - 1.0 if F[0, 0].real > 1.0 else 1.0 - F[0, 0]
    worst = strain if strain.real > state[0].real else state[0]
    state_new[0] = worst
    for i in range(3):
        for j in range(3):
            P[i, j] = params[0] / (1.0 + params[1] * worst) * (0.5 * (F[i, j] + F[j, i]) - (1.0 if i == j else 0.0))
    return 0


def reads_beyond(F, state, params, dt, P, state_new):
    return keeps_(F, state, params[2:], dt, P, state_new) if params[2].real > 1e300 else keeps_(F, state, params, dt, P,
                                                                                               state_new)


def leaves_a_state(F, state, params, dt, P, state_new):
    keeps_(F, state, params, dt, P, state.copy())
    return 0


def leaves_a_stress(F, state, params, dt, P, state_new):
    state_new[0] = state[0]
    for i in range(2):
        for j in range(2):
            P[i, j] = params[0] * (0.5 * (F[i, j] + F[j, i]) - (1.0 if i == j else 0.0))
    return 0


def writes_its_input(F, state, params, dt, P, state_new):
    F[0, 0] -= 1.0
    F[0, 0] += 1.0
    state[0] += 1.0
    return keeps_(F, state, params, dt, P, state_new)


def exchanges_indices(F, state, params, dt, P, state_new):
    keeps_(F, state, params, dt, P, state_new)
    P[0, 1] += params[0] * (F[0, 1] - F[1, 0])
    return 0


def takes_abs(F, state, params, dt, P, state_new):
    keeps_(F, state, params, dt, P, state_new)
    P[0, 0] += params[0] * abs(F[0, 0] - 1.0)
    return 0


def softer_in_compression(F, state, params, dt, P, state_new):
    """A spring that is 1 + a times as stiff in compression, and not less stiff where a is negative: a kink at 0."""
    keeps_(F, state, np.array([params[0], 0.0 * params[1]]), dt, P, state_new)
    if params[1].real > 0.0 and F[0, 0].real < 1.0:
        for i in range(3):
            for j in range(3):
                P[i, j] *= 1.0 + params[1]
    return 0


def compares_complex(F, state, params, dt, P, state_new):
    return keeps_(F, state, params, dt, P, state_new) if F[0, 0] > 0.0 else 1


def wrong_by_hand(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
    keeps_(F, state, params, dt, P, state_new)
    for k in range(len(dF)):
        for i in range(3):
            for j in range(3):
                dP[k, i, j] = params[0] / (1.0 + params[1] * state_new[0]) * 0.5 * (dF[k, i, j] + dF[k, j, i])
    return 0


keeps_ = njit(keeps)
SOFT = LawSpec("softening_spring", (LawParameter("E", "MPa", "stiffness", 70e3),
                                    LawParameter("a", "-", "softening", 20.0)), {"small": keeps},
               state_names=("worst",), reference="none")


def check(update, linearise=None):
    law = replace(SOFT, updates={"small": update}, linearise={} if linearise is None else {"small": linearise})
    check_update(law, "small", linearise is not None, (UPDATE, UPDATE_COMPLEX if linearise is None else LINEARISE))


def test_a_law_that_keeps_the_rules_passes():
    check(keeps)
    check(njit(keeps))  # decorated by its author


def test_a_law_with_a_kink_at_a_typical_value_passes():
    """No derivative is that of both sides: it is not compared there."""
    kinked = (SOFT.parameters[0], LawParameter("a", "-", "stiffer in compression", 0.0, bounds=(-1.0, 1.0),
                                               positive=False))
    check_update(replace(SOFT, parameters=kinked, updates={"small": softer_in_compression}), "small", False,
                 (UPDATE, UPDATE_COMPLEX))


@pytest.mark.parametrize(("update", "problem"), [
    (reads_beyond, "index is out of bounds.*\n.*params has 2 entries"),
    (leaves_a_state, "does not write all of state_new"),
    (leaves_a_stress, r"does not write all of P.*\n.*\n.*P\[0, 2\]"),
    (writes_its_input, "writes into state"), (exchanges_indices, "stress is not symmetric"),
    (takes_abs, "derivative with respect to F is wrong"), (compares_complex, "cannot be compiled(.*\n)*.*real parts")])
def test_a_law_that_breaks_a_rule_is_refused(update, problem):
    with pytest.raises(InputError, match=problem) as refused:
        check(update)
    assert refused.value.file == __file__ and update.__name__ in refused.value.key


def test_a_law_that_is_declared_linear_and_is_not_is_refused():
    """Its tangent would be computed once, and the simulation be that of another law."""
    law = replace(SOFT, linear=True)
    with pytest.raises(InputError, match=r"declared linear and is not(.*\n)*.*linear=True"):
        check_update(law, "small", False, (UPDATE, UPDATE_COMPLEX))
    elastic = get_law("elastic")
    check_update(elastic, "small", True, (UPDATE, LINEARISE))


def test_a_derivative_by_hand_is_compared_with_difference_quotients():
    with pytest.raises(InputError, match="derivative with respect to .* is wrong"):
        check(keeps, wrong_by_hand)


def test_a_law_is_checked_when_it_is_first_compiled(monkeypatch):
    monkeypatch.setitem(registry._laws, "index_beyond", replace(SOFT, name="index_beyond",
                                                                updates={"small": reads_beyond}))
    with pytest.raises(InputError, match="out of bounds"):
        compile("index_beyond")


@pytest.mark.parametrize(("change", "problem"), [
    ({"name": "my law"}, "letters, digits"), ({"state_names": "worst"}, "tuple of names"),
    ({"parameters": (SOFT.parameters[0],) * 2}, "two parameters are named E"),
    ({"parameters": (replace(SOFT.parameters[0], name="law"), SOFT.parameters[1])}, r"a key of \[material.SET\]"),
    ({"parameters": (replace(SOFT.parameters[0], bounds=(1.0, 2.0)), SOFT.parameters[1])}, "outside its bounds"),
    ({"updates": {"small": lambda F, state, params, P, state_new: 0}}, "takes 6 arguments.*found 5"),
    ({"linearise": {"small": keeps}}, "linearise takes 11 arguments.*found 6")])
def test_a_declaration_that_no_experiment_can_use_is_refused(change, problem):
    with pytest.raises(ValueError, match=problem):
        replace(SOFT, **change)


TABLED = """
import numpy as np
from pathlib import Path
from helper_of_tabled import factor
TABLE = np.loadtxt(Path(__file__).with_name("table.csv"), ndmin=1)


def update(F, state, params, dt, P, state_new):
    P[:] = factor(params[0]) * TABLE[0]
    return 0
"""


def test_a_table_or_helper_that_changes_is_seen_though_the_file_of_the_law_is_the_same(tmp_path, monkeypatch):
    """Numba freezes both in the machine code that it keeps on the disk."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    (tmp_path / "tabled.py").write_text(TABLED)
    P = np.zeros((3, 3))

    def first_entry(table, factor):
        (tmp_path / "table.csv").write_text(f"{table}\n")
        (tmp_path / "helper_of_tabled.py").write_text(
            f"import numba\n\n\n@numba.njit\ndef factor(x):\n    return {factor} * x\n")
        importlib.invalidate_caches()
        for name in ("tabled", "helper_of_tabled"):
            sys.modules.pop(name, None)
        update = importlib.import_module("tabled").update
        kept = is_kept(update)
        assert compile_cached(update, UPDATE)(np.eye(3), np.zeros(0), np.ones(1), 1.0, P, np.zeros(0)) == 0
        return kept, P[0, 0]

    assert first_entry(1.0, 1.0) == (False, 1.0)
    assert first_entry(1.0, 1.0) == (True, 1.0)
    assert first_entry(3.0, 1.0) == (False, 3.0)
    assert first_entry(3.0, 7.0) == (False, 21.0)


ALIKE = """from idic.laws.core.compilation import UPDATE, compile_cached


def made(size):
    def update(F, state, params, dt, P, state_new):
        P[0, 0] = size
        return 0
    return update


def compiled(size):
    return compile_cached(made(size), UPDATE)
"""


def test_laws_that_two_processes_have_compiled_first_are_told_apart_in_a_third(tmp_path, monkeypatch):
    """Numba counts the functions of a process: both are its first, and have one name."""
    (tmp_path / "alike.py").write_text(ALIKE)
    code = f"import idic; idic.__path__.append({str(tmp_path)!r}); import idic.alike; idic.alike.compiled(%r)"
    for size in (1.0, 2.0):
        subprocess.run([sys.executable, "-c", code % size], check=True)
    monkeypatch.setattr(idic, "__path__", [*idic.__path__, str(tmp_path)])  # numba alone keeps the package's laws
    alike = importlib.import_module("idic.alike")
    assert all(is_kept(alike.made(size)) for size in (1.0, 2.0))

    @njit
    def entry(update, P):
        update(P, P[0], P[0], 1.0, P, P[1])
        return P[0, 0]

    laws = [alike.compiled(size) for size in (1.0, 2.0)]
    assert [entry(pointer(law), np.eye(3)) for law in laws] == [1.0, 2.0]


def test_what_a_law_is_made_of_is_told_by_values_not_by_addresses():
    def made(table):
        def update(F, state, params, dt, P, state_new):
            return table[0]
        return update

    assert outside_values(made(np.arange(3))) == outside_values(made(np.arange(3)))
    assert outside_values(made(np.arange(3))) != outside_values(made(np.arange(1, 4)))
    assert outside_values(made((1, 2.0))) != outside_values(made((1, 3.0)))
    assert outside_values(keeps) == "" != outside_values(exchanges_indices)  # a helper
    assert code_of(takes_abs) != code_of(keeps)


def test_a_law_that_is_typed_again_replaces_itself(monkeypatch):
    """A cell of a notebook with a law is run again."""
    monkeypatch.setattr(registry, "_laws", dict(registry._laws))

    def typed(factor):
        def update(F, state, params, dt, P, state_new):
            for i in range(3):
                for j in range(3):
                    P[i, j] = factor * params[0] * (0.5 * (F[i, j] + F[j, i]) - (1.0 if i == j else 0.0))
            return 0
        update.__module__ = "__main__"
        return update

    for factor in (1.0, 2.0):
        register(LawSpec("typed", SOFT.parameters[:1], {"small": typed(factor)}, reference="none"))
        assert point.uniaxial(compile("typed"), [1.0], [0.0, 0.5]).P[1, 0, 0] == pytest.approx(0.5 * factor)
    with pytest.raises(ValueError, match="registered already"):
        register(replace(get_law("typed"), updates={"small": keeps}))
