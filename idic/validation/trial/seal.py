"""Sealed truths: written and hashed before the tool sees anything, opened by the judge.

::

    OUT/register.json          hash of every truth, thresholds and commit of the tool, every run of the trial
    OUT/sealed/ID.json         the truth and its salt; sha256 of these bytes is in the register
    OUT/motions/ID.npz         what the solver made of it
    OUT/answers/ID.json        what the tool said

An ID is drawn at random and says nothing of what is in it.
"""

from __future__ import annotations

import hashlib
import json
import secrets
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from idic.errors import InputError
from idic.store.result_file import write_json
from idic.store.run_lock import run_lock
from idic.validation.trial.plan import Campaign, Trial, Truth, draw

REGISTER = "register.json"


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
        """The register; empty where there is none yet."""
        path = self.out / REGISTER
        return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}

    def write_register(self, content: Mapping) -> None:
        write_json(self.out / REGISTER, content)


def seal(folder: Folder, campaign: Campaign, chosen: Sequence[Trial], tool: Mapping[str, object]) -> dict[str, str]:
    """Draw and seal what is not sealed yet, and note this run in the register.

    Parameters
    ----------
    tool : commit and thresholds

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
        return _sealed(folder, campaign, chosen, tool)


def _sealed(folder: Folder, campaign: Campaign, chosen: Sequence[Trial], tool: Mapping[str, object]) -> dict[str, str]:
    register = folder.register or {"schema": "idic.trial/1", "size": campaign.size, "seed": campaign.seed,
                                   "tool": dict(tool), "truths": {}, "runs": []}
    if (register["size"], register["seed"]) != (campaign.size, campaign.seed):
        raise InputError("the folder holds another trial", file=folder.out / REGISTER,
                         expected="the same size and seed", found=f"{register['size']}, seed {register['seed']}",
                         remedy="choose another --out")
    known = {opened(folder, number).key: number for number in register["truths"]}
    for trial in chosen:
        if trial.key not in known:
            number = secrets.token_hex(4)
            text = json.dumps(asdict(draw(trial, campaign.seed)) | {"salt": secrets.token_hex(16)}, indent=1)
            folder.sealed(number).parent.mkdir(parents=True, exist_ok=True)
            folder.sealed(number).write_bytes(text.encode())
            register["truths"][number] = hashlib.sha256(text.encode()).hexdigest()
            known[trial.key] = number
    register["runs"].append({"began": time.strftime("%Y-%m-%d %H:%M:%S"), "trials": len(chosen),
                             "already_answered": sum(folder.answer(known[t.key]).exists() for t in chosen),
                             "tool": dict(tool)})
    register["truths"] = dict(sorted(register["truths"].items()))  # the order of drawing would give them away
    folder.write_register(register)
    return {trial.key: known[trial.key] for trial in chosen}


def opened(folder: Folder, number: str) -> Truth:
    """The truth behind an ID.

    Raises
    ------
    InputError
        If it is not the one that was sealed.
    """
    data = folder.sealed(number).read_bytes()
    promised = folder.register.get("truths", {}).get(number)
    if hashlib.sha256(data).hexdigest() != promised:
        raise InputError("this truth is not the one that was sealed", file=folder.sealed(number), expected=promised,
                         found=hashlib.sha256(data).hexdigest(), remedy="begin another trial")
    return Truth.read(json.loads(data))


def answered(folder: Folder) -> dict[str, dict]:
    """What the tool said, by ID."""
    return {number: json.loads(folder.answer(number).read_text(encoding="utf-8"))
            for number in folder.register.get("truths", {}) if folder.answer(number).exists()}
