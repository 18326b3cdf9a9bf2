#!/usr/bin/env bash
# A real Slurm of one node in a scratch folder (its own munged, slurmctld, slurmd), and what deploy/slurm.md says on it:
# workers as jobs, a job lost, jobs at their walltime, the batch script that requeues itself.
# Needs root, the packages slurm-wlm and munge, and `python` (or $PYTHON) with idic and dask-jobqueue. Six minutes.
set -euo pipefail
source "$(dirname "$0")/common.sh"
export PATH=$PATH:/usr/sbin:/sbin
[ "$(id -u)" = 0 ] || cannot_run "Slurm of one's own needs root here"
need slurmctld slurmd munged sbatch squeue openssl
"$python" -c "import dask_jobqueue" 2>/dev/null || cannot_run "no dask-jobqueue"
getent hosts "$(hostname -s)" >/dev/null || cannot_run "the name of this machine does not resolve"
clean() {
  local code=$?
  trap - EXIT
  scancel --user=root 2>/dev/null || true
  sleep 2
  [ -n "${prefect_server:-}" ] && kill "$prefect_server" 2>/dev/null || true
  for name in slurmd slurmctld munged; do [ -e "$scratch/$name.pid" ] && kill "$(cat "$scratch/$name.pid")" 2>/dev/null || true; done
  sleep 1
  [ $code = 1 ] && tail -n 30 "$scratch"/*.log "$scratch"/logs/* "$scratch"/slurm-*.out >&2 2>/dev/null
  rm -rf "$scratch"
  exit $code
}
trap clean EXIT
mkdir "$scratch/state" "$scratch/spool" "$scratch/munge"
dd if=/dev/urandom of="$scratch/munge.key" bs=128 count=1 2>/dev/null; chmod 600 "$scratch/munge.key"
munged --force --key-file="$scratch/munge.key" --socket="$scratch/munge/socket" --pid-file="$scratch/munged.pid" \
  --log-file="$scratch/munged.log" --seed-file="$scratch/munge.seed" 2> "$scratch/munge-start.log" || cannot_run "munged does not start: $(tail -n 1 "$scratch/munge-start.log")"
cat > "$scratch/slurm.conf" <<END
ClusterName=check
SlurmctldHost=$(hostname -s)
SlurmctldPort=$(free_port)
SlurmdPort=$(free_port)
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$scratch/munge/socket
StateSaveLocation=$scratch/state
SlurmdSpoolDir=$scratch/spool
SlurmctldPidFile=$scratch/slurmctld.pid
SlurmdPidFile=$scratch/slurmd.pid
SlurmctldLogFile=$scratch/slurmctld.log
SlurmdLogFile=$scratch/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
SwitchType=switch/none
SchedulerType=sched/backfill
SchedulerParameters=requeue_setup_env_fail
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
ReturnToService=2
KillWait=5
NodeName=$(hostname -s) CPUs=$(nproc --all) RealMemory=2000 State=UNKNOWN
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP
END
export SLURM_CONF=$scratch/slurm.conf
slurmctld; slurmd
idle() { sinfo --noheader --format=%t | grep -q idle; }
wait_for $patience idle || fail "the node does not come up: $(sinfo 2>&1)"
ok "Slurm $(sinfo --version | cut -d' ' -f2) runs"

"$deploy/certificates.sh" "$scratch/tls" 2 > /dev/null
idic example demo --reduced --out "$scratch/test" > /dev/null
reference "$scratch/test" "$scratch/here" > "$scratch/here.log" 2>&1

one_prefect_server
configure() {  # configure WALLTIME: two jobs of one worker
  sed -e 's/^jobs = .*/jobs = 2/' -e "s|^certificates = .*|certificates = \"$scratch/tls\"|" -e 's/^processes = .*/processes = 1/' \
    -e "s|^log_directory = .*|log_directory = \"$scratch/logs\"|" -e "s|^local_directory = .*|local_directory = \"$scratch\"|" \
    -e "s/^walltime = .*/walltime = \"$1\"\npython = \"${python//\//\\/}\"/" -e 's/^interface = .*/interface = "lo"/' \
    -e 's/^prologue = .*/prologue = []/' -e 's/^skip = .*/skip = ["--mem"]/' "$deploy/slurm.toml" > "$scratch/slurm.toml"
}
on_jobs() { "$python" "$deploy/slurm_cluster.py" "$scratch/slurm.toml" "$python" -m idic "$@"; }
running() { [ "$(squeue --noheader --states=R | wc -l)" -ge "$1" ]; }

configure 00:30:00
on_jobs identify "$scratch/test" --out "$scratch/lost" > "$scratch/lost.log" 2>&1 & run=$!
wait_for_evaluation "$scratch/lost" $run || fail "no first evaluation"
running 2 || running 1 || fail "no jobs"
grep -rq "BEGIN" "$scratch"/logs && fail "a key stands in a log" || true
victim=$(squeue --noheader --states=R --format=%A | head -n 1)
scancel --signal=KILL --full "$victim"
wait $run || fail "the run that lost a job"
same_numbers "$scratch/here" "$scratch/lost" || fail "other numbers on Slurm"
ok "idic identify on Slurm jobs over TLS, one job lost: the numbers of one machine, to the last bit"
wait_for $patience sh -c '[ -z "$(squeue --noheader)" ]' || fail "jobs stay behind: $(squeue)"
ok "no job stays behind"

on_jobs batch "$scratch/test" --starts 2 --out "$scratch/batch" > "$scratch/batch.log" 2>&1 & run=$!
wait_for $patience running 2 || fail "the batch has no jobs"
before=$(squeue --noheader --states=R --format=%A | sort)
sleep 20
scancel --signal=KILL --full $(echo $before)
replaced() { [ -n "$(squeue --noheader --states=R --format=%A | sort | comm -13 <(echo "$before") -)" ]; }
wait_for $patience replaced || fail "the lost jobs were not replaced"
wait $run || fail "the batch that lost all its jobs"
grep -q "2 of 2 runs converged" "$scratch/batch.log" || fail "the batch"
ok "idic batch with all jobs lost at once: $(grep -c replacing "$scratch/batch.log") replacement(s), 2 of 2 converged"

cd "$scratch"
PYTHON=$python sbatch --cpus-per-task=2 --time=00:10:00 "$deploy/idic.sbatch" identify "$scratch/test" --out "$scratch/single" > "$scratch/sbatch.log"
job=$(grep -o '[0-9]*$' "$scratch/sbatch.log")
wait_for $patience evaluated "$scratch/single" 1 || fail "the batch script does not get to work"
scancel --signal=TERM --batch "$job"      # what Slurm sends 120 s before the walltime
wait_for $patience grep -q "interrupted" "$scratch/slurm-$job.out" || fail "the command was not told to stop"
if ! wait_for $patience grep -q "converged" "$scratch/slurm-$job.out"; then scontrol show job "$job" >&2; fail "it was not taken up again"; fi
same_numbers "$scratch/here" "$scratch/single" || fail "other numbers after the requeue"
ok "idic.sbatch: stopped before its walltime, requeued by itself, the same numbers"
