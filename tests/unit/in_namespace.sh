#!/bin/sh
# Runs a test with a /dev/shm, a /tmp and a loopback of its own: in_namespace.sh TEST PROGRAM...,
# where the programs are arguments of the test.
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
  programs=
  for program in "$@"; do
    cp "$program" /run/ledgerline-test/
    programs="$programs ./$(basename "$program")"
  done
  mount -t tmpfs -o size=256m tmpfs /dev/shm
  mount -t tmpfs tmpfs /tmp
  cd /run/ledgerline-test
  exec $programs
' sh "$@"
