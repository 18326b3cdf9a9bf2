# What the checks share. Source it; then: cannot_run REASON, ok TEXT, fail TEXT, wait_for SECONDS COMMAND...
# Exit codes: 0 everything holds, 1 something does not, 77 this machine cannot run the check.
deploy=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
python=${PYTHON:-python}
scratch=$(mktemp -d)
chmod 755 "$scratch"
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 NUMBA_NUM_THREADS=1 DASK_LOGGING__DISTRIBUTED=error

cannot_run() { echo "cannot run here: $*"; exit 77; }
ok() { echo "ok: $*"; }
fail() { echo "FAILED: $*" >&2; exit 1; }
need() { for program; do command -v "$program" >/dev/null || cannot_run "no $program"; done; }
wait_for() {  # wait_for SECONDS COMMAND...: until it succeeds
  local end=$((SECONDS + $1)); shift
  until "$@" >/dev/null 2>&1; do [ $SECONDS -lt $end ] || return 1; sleep 0.5; done
}
free_port() { "$python" -c "import socket; s = socket.socket(); s.bind(('127.0.0.1', 0)); print(s.getsockname()[1])"; }
idic() { "$python" -m idic "$@"; }
use_certificates() {  # use_certificates DIR: of everything started from now on
  export DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION=true DASK_DISTRIBUTED__COMM__TLS__CA_FILE="$1/ca.pem"
  local role
  for role in SCHEDULER WORKER CLIENT; do
    export DASK_DISTRIBUTED__COMM__TLS__${role}__CERT="$1/cert.pem" DASK_DISTRIBUTED__COMM__TLS__${role}__KEY="$1/key.pem"
  done
}
reference() {  # reference EXPERIMENT RUN: the numbers of one process, without Prefect and Dask
  "$python" -c 'import sys, idic; idic.identify(sys.argv[1], sys.argv[2])' "$1" "$2"
}
patience=${PATIENCE:-180}  # s for one step; a busy machine needs more
evaluations() {  # evaluations RUN: how many points it has evaluated
  "$python" -c 'import json, sys; print(json.load(open(sys.argv[1] + "/state.json"))["state"]["evaluations"])' "$1" 2>/dev/null || echo 0
}
evaluated() { [ "$(evaluations "$1")" -ge "$2" ]; }  # evaluated RUN NUMBER
wait_for_evaluation() {  # wait_for_evaluation RUN PID: until the process has evaluated a point; fails where it ended
  local end=$((SECONDS + 3 * patience))
  until evaluated "$1" 1; do kill -0 "$2" 2>/dev/null && [ $SECONDS -lt $end ] || return 1; sleep 1; done
}
one_prefect_server() {  # one_prefect_server [PREFIX...]: for all runs to come, on the loopback interface (of a host)
  export PREFECT_HOME=$scratch/prefect DO_NOT_TRACK=1 PREFECT_SERVER_ANALYTICS_ENABLED=false
  local port end=$((SECONDS + 3 * patience))
  port=$(free_port)
  "$@" "$python" -m prefect server start --host 127.0.0.1 --port $port > "$scratch/prefect.log" 2>&1 &
  prefect_server=$!
  until "$@" "$python" -c "import urllib.request as u; u.urlopen('http://127.0.0.1:$port/api/health')" 2> /dev/null; do
    kill -0 $prefect_server 2>/dev/null && [ $SECONDS -lt $end ] || fail "no Prefect server"
    sleep 1
  done
  export PREFECT_API_URL=http://127.0.0.1:$port/api
}
same_numbers() {  # same_numbers RUN RUN: the same values and standard deviations, to the last bit
  "$python" - "$1" "$2" <<'END'
import json, sys
a, b = (json.load(open(f"{run}/result.json")) for run in sys.argv[1:])
same = a["status"] == b["status"] == "converged" and a["parameters"] == b["parameters"]
sys.exit(0 if same else f"{a['status']} {a['parameters']}\n{b['status']} {b['parameters']}")
END
}
