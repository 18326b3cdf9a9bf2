#!/usr/bin/env bash
# A Prefect server with a password, deploy/prefect_deploy.py, a worker, and runs of its deployments, one with a pause.
# Needs `python` (or $PYTHON) with idic installed. Five minutes.
set -euo pipefail
source "$(dirname "$0")/common.sh"
need ss curl
port=$(free_port)
children=()
clean() {
  local code=$?
  trap - EXIT
  for child in "${children[@]}"; do kill "$child" 2>/dev/null || true; done
  wait 2>/dev/null || true
  [ $code = 1 ] && tail -n 30 "$scratch"/*.log >&2
  rm -rf "$scratch"
  exit $code
}
trap clean EXIT
export PREFECT_HOME=$scratch/home PREFECT_API_URL=http://127.0.0.1:$port/api IDIC_DATA_ROOT=$scratch/data
export PREFECT_SERVER_API_AUTH_STRING=idic:$(od -An -N16 -tx1 /dev/urandom | tr -d ' \n')
export PREFECT_API_AUTH_STRING=$PREFECT_SERVER_API_AUTH_STRING
export DO_NOT_TRACK=1 PREFECT_SERVER_ANALYTICS_ENABLED=false PREFECT_CLIENT_SERVER_VERSION_CHECK_ENABLED=false
mkdir -p "$scratch/data"
prefect() { "$python" -m prefect "$@"; }
"$python" -m prefect server start --host 127.0.0.1 --port "$port" > "$scratch/server.log" 2>&1 & children+=($!)
wait_for $patience curl -fsS "http://127.0.0.1:$port/api/health" || fail "the server does not answer"
[ -z "$(ss -Hltn "sport = :$port" | awk '{print $4}' | grep -v '^127\.0\.0\.1:')" ] || fail "the server listens beyond loopback"
ok "the server listens on the loopback interface only"
code=$(curl -s -o /dev/null -w '%{http_code}' -X POST -H 'Content-Type: application/json' -d '{}' "http://127.0.0.1:$port/api/flows/filter")
[ "$code" = 401 ] || fail "the server answers without the password: $code"
ok "nothing without the password"

"$python" "$deploy/prefect_deploy.py" > "$scratch/deploy.log" 2>&1 || fail "the deployments"
"$python" "$deploy/prefect_deploy.py" > "$scratch/deploy.log" 2>&1 || fail "the deployments for the second time"
prefect work-pool set-concurrency-limit idic 1 > /dev/null
(cd "$scratch"; exec "$python" -m prefect worker start --pool idic --type process) > "$scratch/worker.log" 2>&1 & children+=($!)
idic example demo --reduced --out "$scratch/data/test" > /dev/null
start() { prefect deployment run "$@" --watch --watch-interval 2 --watch-timeout $((5 * patience)); }

start idic-identify-deployed/idic -p experiment="$scratch/data/test" -p out="$scratch/data/run" -p workers=1 > "$scratch/identify.log" 2>&1 \
  || fail "the deployed identification"
grep -q '"status": "converged"' "$scratch/data/run/result.json" && [ -s "$scratch/data/run/report.html" ] || fail "no result"
ok "idic-identify-deployed/idic by a worker: converged, with its report"

cp -r "$scratch/data/test" "$scratch/data/staged"
printf '\n[[stage]]\nfree = ["sheet.E", "sheet.nu"]\nmax_iterations = 2\n[[stage]]\nfree = "all"\n' >> "$scratch/data/staged/experiment.toml"
"$python" "$deploy/checks/resume_paused_run.py" "$scratch/data/staged" "$scratch/data/paused" $((5 * patience)) > "$scratch/pause.log" 2>&1 \
  || { cat "$scratch/pause.log" >&2; fail "the run with a pause"; }
ok "suspended after the first stage of its schedule, with a report; resumed in Prefect, converged"

start idic-diagnose-deployed/idic -p run="$scratch/data/run" -p workers=1 -p quick=true > "$scratch/diagnose.log" 2>&1 \
  || fail "the deployed diagnosis"
[ -s "$scratch/data/run/diagnosis.html" ] || fail "no page of the diagnosis"
ok "idic-diagnose-deployed/idic by a worker: its page"

start idic-batch-deployed/idic -p experiments="[\"$scratch/data/test\"]" -p out="$scratch/data/batch" -p starts=2 -p workers=2 \
  > "$scratch/batch-run.log" 2>&1 || fail "the deployed batch"
[ "$("$python" -c "import json; print(json.load(open('$scratch/data/batch/batch.json'))['converged'])")" = 2 ] || fail "the batch"
ok "idic-batch-deployed/idic by a worker: 2 of 2 converged"

code=0
start idic-identify-deployed/idic -p experiment=/etc -p out="$scratch/data/outside" > "$scratch/outside.log" 2>&1 || code=$?
[ $code != 0 ] && [ ! -e "$scratch/data/outside" ] && grep -q "outside of the data" "$scratch/worker.log" || fail "a path outside of the data was taken"
ok "a path outside of IDIC_DATA_ROOT fails with the reason, nothing is written"
