#!/bin/sh
# Runs a test with a /dev/shm, a /tmp and a loopback of its own: in_namespace.sh TEST ARGUMENT...
# Exit code 77: this machine does not let us.
if ! unshare -nm true 2>/dev/null; then
  echo "needs root (unshare -nm)" >&2
  exit 77
fi
# The programs may lie below /tmp: their folders stay reachable under /run.
exec unshare -nm sh -c '
  set -e
  ip link set lo up multicast on
  mkdir -p /run/ledgerline-test
  mount -t tmpfs tmpfs /run/ledgerline-test
  n=0
  for program in "$@"; do
    n=$((n + 1))
    cp "$program" "/run/ledgerline-test/$n"
  done
  mount -t tmpfs -o size=256m tmpfs /dev/shm
  mount -t tmpfs tmpfs /tmp
  cd /run/ledgerline-test
  exec ./1 ./2
' sh "$@"
