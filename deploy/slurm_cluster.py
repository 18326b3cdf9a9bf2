"""Run an idic command on workers that are Slurm jobs.

    python deploy/slurm_cluster.py CONFIG idic batch list.toml --out /scratch/me/batch --resume

Starts a Dask scheduler on this machine, reachable over TLS only, submits jobs as CONFIG (deploy/slurm.toml) says, runs
the command with ``--scheduler ADDRESS`` added, replaces jobs that are lost or have reached their walltime, and cancels
all of them at the end. The exit code is the command's. Needs dask-jobqueue: ``pip install ".[slurm]"``.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Mapping
from pathlib import Path

import dask
from dask_jobqueue import SLURMCluster
from distributed.security import Security

from idic.run.workers.dask_settings import KEEP_MEMORY, ONE_THREAD

LOOK_SECONDS = 10.0  # between looks at the queue
MARGIN_SECONDS = 120.0  # before the walltime a worker hands over what it holds, and ends
ROLES = ("SCHEDULER", "WORKER", "CLIENT")


def main(arguments: list[str]) -> int:
    """Exit code of the command; 2 where CONFIG or the certificates are not usable."""
    if len(arguments) < 2:
        return _refuse("usage: slurm_cluster.py CONFIG COMMAND...   (COMMAND: idic identify ..., idic batch ...)")
    config = tomllib.loads(Path(arguments[0]).read_text(encoding="utf-8"))
    tls = Path(config["certificates"]).expanduser().resolve()
    missing = [name for name in ("ca.pem", "cert.pem", "key.pem") if not (tls / name).is_file()]
    if missing:
        return _refuse(f"{tls} has no {', '.join(missing)}; make certificates: deploy/certificates.sh {tls}")
    if (tls / "key.pem").stat().st_mode & 0o077:
        return _refuse(f"others can read {tls}/key.pem: chmod 600 it, or make new certificates")
    # a lost job is someone else's preemption, not the fault of the run it held
    dask.config.set({"distributed.scheduler.allowed-failures": 20})
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # jobs are cancelled on the way out
    with start_cluster(config, tls) as cluster:
        keeper = Keeper(cluster, config)
        while not cluster.scheduler_info["workers"]:  # the queue may be long
            time.sleep(LOOK_SECONDS)
            if not keeper.replace_lost():
                return 1
        command = [*arguments[1:], "--scheduler", cluster.scheduler_address]
        with subprocess.Popen(command, env=environment(tls)) as process:
            for number in (signal.SIGTERM, signal.SIGINT):  # the command ends in good order, then so do the jobs
                signal.signal(number, lambda received, _: process.send_signal(received))
            return keep_alive(keeper, process)


def start_cluster(config: Mapping, tls: Path) -> SLURMCluster:
    """The scheduler here and the first jobs."""
    job, security = config["job"], certificates(tls)
    Path(config["log_directory"]).mkdir(parents=True, exist_ok=True)
    # a job that may run 4 h has a lifetime of 4 h less the margin; staggered, so that not all of them end at once
    lifetime = seconds(job["walltime"]) - MARGIN_SECONDS
    if lifetime < MARGIN_SECONDS:
        raise SystemExit(f"walltime {job['walltime']}: shorter than {2 * MARGIN_SECONDS / 60:g} min is not worth it")
    cluster = SLURMCluster(
        cores=job["processes"], processes=job["processes"], memory=job["memory"], walltime=job["walltime"],
        queue=job.get("queue"), account=job.get("account"), interface=job["interface"], protocol="tls://",
        security=security, scheduler_options={"interface": job["interface"], "dashboard_address": "127.0.0.1:0"},
        worker_extra_args=["--dashboard-address", "127.0.0.1:0", "--lifetime", f"{lifetime:.0f}s",
                           "--lifetime-stagger", f"{lifetime / 20:.0f}s"],
        job_script_prologue=[*job.get("prologue", ()),
                             *(f"export {name}={value}" for name, value in {**ONE_THREAD, **KEEP_MEMORY}.items()),
                             "export DASK_DISTRIBUTED__WORKER__MEMORY__PAUSE=false"],
        job_extra_directives=list(job.get("directives", ())), job_directives_skip=list(job.get("skip", ())),
        log_directory=config["log_directory"], local_directory=config["local_directory"],
        python=job.get("python", "python"))
    cluster.scale(jobs=config["jobs"])
    return cluster


def certificates(tls: Path) -> Security:
    """The same certificate for everybody; files, so that no key stands in a job script."""
    pair = {f"tls_{role.lower()}_{what}": str(tls / f"{what}.pem") for role in ROLES for what in ("cert", "key")}
    return Security(require_encryption=True, tls_ca_file=str(tls / "ca.pem"), **pair)


def environment(tls: Path) -> dict[str, str]:
    """What the command needs to reach the scheduler."""
    names = {"DASK_DISTRIBUTED__COMM__TLS__CA_FILE": str(tls / "ca.pem")}
    for role in ROLES:
        names |= {f"DASK_DISTRIBUTED__COMM__TLS__{role}__{what.upper()}": str(tls / f"{what}.pem")
                  for what in ("cert", "key")}
    return {**os.environ, **names}


class Keeper:
    """Replaces the jobs that Slurm no longer knows (Dask does not do so by itself), up to a limit."""

    def __init__(self, cluster: SLURMCluster, config: Mapping):
        self._cluster, self._config, self._replaced = cluster, config, 0

    def replace_lost(self) -> bool:
        """Look once; False where so many were lost that something is wrong with the jobs themselves."""
        lost = lost_jobs(self._cluster)
        self._replaced += len(lost)
        if self._replaced > self._config.get("max_replacements", 10 * self._config["jobs"]):
            print(f"{self._replaced} jobs were lost, see {self._config['log_directory']}; --resume continues with the "
                  "command", file=sys.stderr)
            return False
        if lost:
            print(f"{time.strftime('%H:%M:%S')} replacing {len(lost)} lost job(s)", file=sys.stderr, flush=True)
            self._cluster.sync(self._cluster.scale_down, lost)
        self._cluster.scale(jobs=self._config["jobs"])  # also for workers that Dask itself has given up
        return True


def keep_alive(keeper: Keeper, process: subprocess.Popen) -> int:
    """The exit code of the command; its workers are replaced until it ends."""
    while True:
        try:
            return process.wait(LOOK_SECONDS)
        except subprocess.TimeoutExpired:
            if not keeper.replace_lost():
                process.send_signal(signal.SIGTERM)
                return process.wait()


def lost_jobs(cluster: SLURMCluster) -> list[str]:
    """Names of the workers whose job was submitted and is no longer in the queue, for whatever reason."""
    answer = subprocess.run(["squeue", "--noheader", "--format=%A", f"--user={os.getuid()}"], capture_output=True,
                            text=True)
    if answer.returncode:
        return []  # the controller does not answer just now; nothing is known
    queued = set(answer.stdout.split())
    return [name for name, worker in list(cluster.workers.items())
            if getattr(worker, "job_id", None) and str(worker.job_id) not in queued]


def seconds(walltime: str) -> float:
    """Of a time as `sbatch --time` reads it: minutes, minutes:seconds, hours:minutes:seconds, days-hours[:...]."""
    days, dash, clock = walltime.rpartition("-")
    parts = [float(part) for part in clock.split(":")]
    units = (3600.0, 60.0, 1.0) if dash or len(parts) == 3 else (60.0, 1.0)
    return 86400.0 * float(days or 0) + sum(part * unit for part, unit in zip(parts, units, strict=False))


def _refuse(text: str) -> int:
    print(text, file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
