#!/usr/bin/env bash
# Two hosts that share nothing but a cable and a file system: network namespaces with one address each. The driver and
# a Dask scheduler are on A, the workers on B, all with certificates of deploy/certificates.sh.
# Needs root (ip netns), openssl, and `python` (or $PYTHON) with idic installed. About three minutes.
set -euo pipefail
source "$(dirname "$0")/common.sh"
[ "$(id -u)" = 0 ] || cannot_run "only root may make network namespaces"
need ip openssl ss
A=idicA$$ B=idicB$$ a=10.77.83.1 b=10.77.83.2
ip netns add "$A" 2>/dev/null || cannot_run "no network namespaces"
children=()
clean() {
  local code=$?
  trap - EXIT
  for child in "${children[@]}"; do kill "$child" 2>/dev/null || true; done
  sleep 1
  for host in "$A" "$B"; do
    ip netns pids "$host" 2>/dev/null | xargs -r kill -9 2>/dev/null || true
    ip netns del "$host" 2>/dev/null || true
  done
  [ $code = 1 ] && tail -n 20 "$scratch"/*.log >&2
  rm -rf "$scratch"
  exit $code
}
trap clean EXIT
ip netns add "$B"
ip link add "v$A" netns "$A" type veth peer name "v$B" netns "$B"
for host in "$A $a" "$B $b"; do
  set -- $host
  ip -n "$1" addr add "$2/24" dev "v$1"; ip -n "$1" link set "v$1" up; ip -n "$1" link set lo up
done
on() { local host=$1; shift; ip netns exec "$host" "$@"; }
start() { local host=$1 log=$2; shift 2; ip netns exec "$host" "$@" > "$scratch/$log.log" 2>&1 & children+=($!); }

"$deploy/certificates.sh" "$scratch/tls" 2 > /dev/null
"$deploy/certificates.sh" "$scratch/stranger" 2 > /dev/null
idic example demo --reduced --out "$scratch/test" > /dev/null
reference "$scratch/test" "$scratch/here" > "$scratch/here.log" 2>&1

use_certificates "$scratch/tls"
start "$A" scheduler "$python" -m dask scheduler --host "tls://$a" --port 8786 --dashboard-address 127.0.0.1:8787
workers() { start "$B" "worker$1" "$python" -m dask worker "tls://$a:8786" --host "tls://$b" --nthreads 1 --nworkers 2 \
  --dashboard-address 127.0.0.1:0 --local-directory "$scratch/$1"; }
workers 1
first_workers=${children[-1]}
wait_for $patience on "$A" ss -Hltn "sport = :8786" || fail "no scheduler"
identify() { on "$A" "$python" -m idic identify "$scratch/test" --out "$scratch/$1" --scheduler "$2" "${@:3}" > "$scratch/$1.log" 2>&1; }
ready() { on "$A" "$python" -c "
import sys
from distributed import Client
client = Client('tls://$a:8786', timeout=5)
sys.exit(len(client.nthreads()) < 2)"; }
wait_for $patience ready || fail "the workers did not come"

listening() { on "$1" ss -Hltn | awk '{print $4}' | grep -v '^127\.0\.0\.1:' || true; }
[ "$(listening "$A")" = "$a:8786" ] || fail "A also listens on: $(listening "$A")"
! listening "$B" | grep -v "^$b:" || fail "B listens on more than its own address"
ok "only the TLS ports are open to the other host"

one_prefect_server ip netns exec "$A"
children+=($prefect_server)
healthy() { on "$A" env HEALTHCHECK_DASK="$1" "$python" "$deploy/healthcheck.py" 2> /dev/null; }
healthy "$a:8786" || fail "the health check of the image does not reach the scheduler"
! healthy "$a:8799" || fail "the health check finds a scheduler where there is none"
! (use_certificates "$scratch/stranger"; healthy "$a:8786") || fail "the health check trusts a stranger"
ok "the image's health check tells a living scheduler from none and from a stranger's"

identify there "tls://$a:8786" || fail "the run on two hosts"
same_numbers "$scratch/here" "$scratch/there" || fail "other numbers than on one host"
ok "idic identify --scheduler tls://...: the numbers of one host, to the last bit"

code=0; identify plain "tcp://$a:8786" || code=$?
[ $code = 2 ] && grep -q "over TLS only" "$scratch/plain.log" && [ ! -e "$scratch/plain" ] || fail "an open address was not refused"
ok "the same address without TLS is refused, nothing is written"

code=0; (use_certificates "$scratch/stranger"; identify strange "tls://$a:8786") || code=$?
[ $code = 2 ] && [ ! -e "$scratch/strange" ] || fail "a stranger's certificate was accepted"
ok "a certificate of another authority is turned away"

chmod 644 "$scratch/tls/key.pem"
code=0; identify open "tls://$a:8786" || code=$?
chmod 600 "$scratch/tls/key.pem"
[ $code = 2 ] && grep -q "key" "$scratch/open.log" && [ ! -e "$scratch/open" ] || fail "a key that everybody can read was used"
ok "a private key that others can read is refused"

identify cut "tls://$a:8786" & run=$!
wait_for_evaluation "$scratch/cut" $run || fail "no first evaluation"
ip -n "$B" link set "v$B" down; sleep 10; ip -n "$B" link set "v$B" up
wait $run || fail "the run with the cut cable"
same_numbers "$scratch/here" "$scratch/cut" || fail "other numbers after the cable was cut"
ok "cable cut for 10 s in the middle: the same numbers"

identify lost "tls://$a:8786" & run=$!
wait_for_evaluation "$scratch/lost" $run || fail "no first evaluation"
ip netns pids "$B" | xargs -r kill -9; sleep 2
workers 2
wait $run || fail "the run that lost all its workers"
same_numbers "$scratch/here" "$scratch/lost" || fail "other numbers after all workers were lost"
ok "host B lost with all workers and started anew: the same numbers"

code=0; on "$A" "$python" -m idic batch "$scratch/test" --starts 2 --out "$scratch/batch" --scheduler "tls://$a:8786" \
  > "$scratch/batch.log" 2>&1 || code=$?
[ $code = 0 ] && grep -q "2 of 2 runs converged" "$scratch/batch.log" || fail "the batch, exit code $code"
ok "idic batch over the same cluster"
