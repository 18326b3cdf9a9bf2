"""Sealed truths and the register of a blind trial: written before the tool runs, opened by the evaluation.

::

    OUT/register.json          hash of every truth, thresholds and commit of the tool, every run of the trial
    OUT/sealed/ID.json         the truth and its salt; sha256 of these bytes is in the register
    OUT/motions/ID.npz         motion and force of the solver
    OUT/answers/ID.json        the answer of the tool

An ID is random and independent of the truth.
"""

from __future__ import annotations

import hashlib
import json
import secrets
import subprocess
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages
from typing import Any

import idic
from idic.errors import InputError
from idic.run import run_lock, write_json
from idic_studies.trial.plan import KNOWN_WORLDS, WORLDS, Campaign, Trial, Truth, draw

REGISTER = "register.json"
DIAGNOSIS = "idic.diagnose"  # its numeric constants are frozen ...
CATALOGUE = "idic.diagnose.candidates"  # ... except those of the candidates


@dataclass(frozen=True)
class Folder:
    """The folder of a trial."""

    out: Path

    def sealed(self, number: str) -> Path:
        return self.out / "sealed" / f"{number}.json"

    def motion(self, number: str) -> Path:
        return self.out / "motions" / f"{number}.npz"

    def answer(self, number: str) -> Path:
        return self.out / "answers" / f"{number}.json"

    @property
    def register(self) -> dict:
        """The register; empty before the first run."""
        path = self.out / REGISTER
        return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}

    def unanswered(self, numbers: Iterable[str]) -> list[str]:
        """The trials without an answer."""
        return [number for number in numbers if not self.answer(number).exists()]

    def write_register(self, content: Mapping) -> None:
        write_json(self.out / REGISTER, content)


Draws = Callable[[Callable[[Trial], Truth], Sequence[Trial]], Iterable[Truth]]


def seal(folder: Folder, campaign: Campaign, chosen: Sequence[Trial], tool: Mapping[str, Any],
         draws: Draws = map) -> dict[str, str]:
    """Draw and seal the chosen truths that are not sealed yet; enter this run in the register.

    Parameters
    ----------
    tool : see `tool_state`
    draws : `map`, or that of a pool of processes

    Returns
    -------
    {key: ID} of the chosen trials.

    Raises
    ------
    InputError
        If the folder holds another campaign, or another process is sealing in it.
    """
    folder.out.mkdir(parents=True, exist_ok=True)
    with run_lock(folder.out):
        return _sealed(folder, campaign, chosen, tool, draws)


def _sealed(folder: Folder, campaign: Campaign, chosen: Sequence[Trial], tool: Mapping[str, Any],
            draws: Draws) -> dict[str, str]:
    if campaign.size == WORLDS and (tool["changed"] is not False or not tool["commit"]):
        raise InputError("kinds of effects that development must not see", key="size", expected="a tool as committed",
                         found="a tool with changes, or outside its repository",
                         remedy=f'commit and run from a clone, or choose the size "{KNOWN_WORLDS}"')
    register = folder.register or {"schema": "idic.trial/1", "size": campaign.size, "seed": campaign.seed,
                                   "tool": dict(tool), "truths": {}, "runs": []}
    if (register["size"], register["seed"]) != (campaign.size, campaign.seed):
        raise InputError("the folder holds another trial", file=folder.out / REGISTER,
                         expected="the same size and seed", found=f"{register['size']}, seed {register['seed']}",
                         remedy="choose another --out")
    number_of_key = {opened(folder, number).key: number for number in register["truths"]}
    unsealed = [trial for trial in chosen if trial.key not in number_of_key]
    for truth in draws(partial(draw, seed=campaign.seed), unsealed):
        number = secrets.token_hex(4)
        text = json.dumps(truth.content | {"salt": secrets.token_hex(16)}, indent=1)
        folder.sealed(number).parent.mkdir(parents=True, exist_ok=True)
        folder.sealed(number).write_bytes(text.encode())
        register["truths"][number] = hashlib.sha256(text.encode()).hexdigest()
        number_of_key[truth.key] = number
    register["runs"].append({"began": time.strftime("%Y-%m-%d %H:%M:%S"), "trials": len(chosen),
                             "already_answered": sum(folder.answer(number_of_key[t.key]).exists() for t in chosen),
                             "tool": dict(tool)})
    register["truths"] = dict(sorted(register["truths"].items()))  # sorted: the order of the campaign would reveal them
    folder.write_register(register)
    return {trial.key: number_of_key[trial.key] for trial in chosen}


def opened(folder: Folder, number: str) -> Truth:
    """The truth behind an ID.

    Raises
    ------
    InputError
        If its hash differs from the sealed one.
    """
    data = folder.sealed(number).read_bytes()
    promised = folder.register.get("truths", {}).get(number)
    if hashlib.sha256(data).hexdigest() != promised:
        raise InputError("this truth is not the one that was sealed", file=folder.sealed(number), expected=promised,
                         found=hashlib.sha256(data).hexdigest(), remedy="begin another trial")
    return Truth.read(json.loads(data))


def answered(folder: Folder) -> dict[str, dict]:
    """Answers of the tool by ID."""
    return {number: json.loads(folder.answer(number).read_text(encoding="utf-8"))
            for number in folder.register.get("truths", {}) if folder.answer(number).exists()}


def tool_state() -> dict[str, Any]:
    """The tool on trial.

    Returns
    -------
    ``version``; ``commit`` ("" outside a repository); ``changed``: the files of the tool differ from that commit (None:
    not known); ``thresholds``: numeric constants of the diagnosis by module and name.
    """
    root = _git("rev-parse", "--show-toplevel")
    # not another project around it
    is_ours = root is not None and Path(root) == Path(idic.__file__).resolve().parents[1]
    differs = _git("status", "--porcelain", "--", "idic", "flows", "studies") if is_ours else None
    return {"version": idic.__version__, "commit": (_git("rev-parse", "HEAD") if is_ours else None) or "",
            "changed": None if differs is None else bool(differs), "thresholds": _thresholds()}


def _thresholds() -> dict[str, float]:
    packages = walk_packages(import_module(DIAGNOSIS).__path__, f"{DIAGNOSIS}.")
    modules = [import_module(module.name) for module in packages if not module.name.startswith(CATALOGUE)]
    return {f"{module.__name__}.{name}": value for module in modules for name, value in vars(module).items()
            if name.isupper() and isinstance(value, int | float) and not isinstance(value, bool)}


def _git(*arguments: str) -> str | None:
    try:
        process = subprocess.run(["git", *arguments], cwd=Path(idic.__file__).parents[1], capture_output=True,
                                 text=True,
                              timeout=20, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return process.stdout.strip() if process.returncode == 0 else None
