"""Command lines of random options and values, for every command that ends by itself."""

from __future__ import annotations

from functools import cache

import click

from idic_studies.evidence.hostile.bases import Base
from idic_studies.evidence.hostile.counting import Case, Scene, _program, command, copied

# commands that compute for minutes when nothing is wrong: only with a value that is none
LONG = {"demo", "gallery", "study", "trial", "example", "simulate", "systematic", "diagnose", "design", "batch",
        "identify", "report"}
WITHOUT_END = {"draw"}
WORDS = ("", "-1", "0", "1", "nan", "inf", "1e400", "10" * 12, "9" * 5000, "x", "a=b", "=", "==", "a.b=1e400",
         "--", "..", "/", "/proc/self/mem", "/dev/null", "\x1b[31m", "ä" * 200, "[", "{}", "1GB", "1e30GB", "tcp://1.2.3.4:1",
         "tls://", "http://[", "s3://", "csv", "9x9", "3x3", "9" * 3000 + "x3", "options.max_iterations=-1",
         "experiment.images=../../*", "material.sheet.E.value=nan", "options=1", "camera.pixel_size_mm=1e-300",
         "experiment.mesh=/etc/passwd", "channel[0].noise_std=0", "boundary[9].ux=1", "a.b.c.d.e.f=1",
         "experiment.kind=solid", "material.sheet.law=x", "dof[0].name=x", "experiment.exclude_frames=[1e9]")


def command_lines(base: Base) -> Case:
    """One command with up to four options or arguments of random values."""
    def case(scene: Scene) -> str:
        names = [name for name in sorted(_program().commands) if name not in WITHOUT_END]
        name = names[int(scene.rng.integers(len(names)))]
        words = [name, *_arguments(scene, base, name)]
        for _ in range(int(scene.rng.integers(0, 4))):
            words += _option(scene, name)
        if name in LONG:
            words += _wrong(scene, name)
        return command(*words)
    return case


@cache
def _options(name: str) -> tuple[click.Option, ...]:
    return tuple(option for option in _program().commands[name].params
                 if isinstance(option, click.Option) and "--allow-external" not in option.opts
                 and "--laws" not in option.opts)


def _option(scene: Scene, name: str) -> list[str]:
    options = _options(name)
    if not options:
        return ["--nothing"]
    option = options[int(scene.rng.integers(len(options)))]
    if option.is_flag:
        return [option.opts[0]]
    value = WORDS[int(scene.rng.integers(len(WORDS)))]
    if "--out" in option.opts:  # where a command may write is the user's choice
        return ["--out", str(scene.work / value.replace("/", "_").replace("\x1b", "e")[:300])]
    return [option.opts[0], value]


def _wrong(scene: Scene, name: str) -> list[str]:
    """An option that no command can follow."""
    flaws = (["--set", "no.such.key=1"], ["--workers", "-1"], ["--workers", "10" * 12], ["--nothing"])
    return list(flaws[int(scene.rng.integers(len(flaws)))])


def _arguments(scene: Scene, base: Base, name: str) -> list[str]:
    """Folders that are right or not; a RUN is a copy."""
    if not any(isinstance(word, click.Argument) for word in _program().commands[name].params):
        return []
    places = [str(scene.work), str(scene.work / "nothing"), str(base.experiment), "x" * 5000, "a b",
              str(base.experiment / "loads.csv"), "/dev/null", "/proc/self", "?"]
    if name in ("report", "fields", "clean", "compare", "diagnose"):
        places += [str(copied(base.run, scene.work / "run"))] * 4
    return [places[int(scene.rng.integers(len(places)))] for _ in range(int(scene.rng.integers(0, 3)))]
