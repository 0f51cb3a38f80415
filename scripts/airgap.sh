#!/usr/bin/env bash
# Shows that nothing leaves: a run, or all tests, where there is no interface and with every socket
# call traced. Exit code 1 if anything asked for another machine.
#
#   scripts/airgap.sh             the demo's job (karma eval eval/demo.toml)
#   scripts/airgap.sh tests       the whole test suite, some minutes
#   scripts/airgap.sh COMMAND...  any command
#
# Without `unshare` (or the leave to use it) the command runs with the interfaces that are there, and
# without `strace` only the guard watches, which fails the command; it says which.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
export OMP_NUM_THREADS=1
case "${1:-demo}" in
    demo) command=(.venv/bin/karma eval eval/demo.toml --fresh --out "$folder/run") ;;
    tests) # but for the test that gives leave, to an address of its own that plays another machine
        leave=tests/plugins/hosted/test_hosted.py::test_other_machine_is_reached_with_leave_only_and_the_header_says_so
        command=(.venv/bin/python -m pytest -q -n "${WORKERS:-2}" --deselect "$leave")
        ;;
    *) command=("$@") ;;
esac

say() { printf 'airgap: %s\n' "$*"; }

apart=()
if unshare -rn true 2>/dev/null; then
    # the namespace's own loopback is down at first; tests talk to servers of theirs over it
    apart=(unshare -rn sh -c 'ip link set lo up 2>/dev/null || true; exec "$@"' apart)
    say "no interface but a loopback of its own (unshare -rn)"
else
    say "unshare is not permitted here: the interfaces stay"
fi

say "1. ${command[*]}"
"${apart[@]}" "${command[@]}"

calls=connect,sendto,sendmsg,sendmmsg
if strace -o "$folder/try" true 2>/dev/null; then
    say "2. the same once more, traced (strace -f -e trace=$calls)"
    "${apart[@]}" strace -f -qq -e "trace=$calls" -e signal=none -o "$folder/trace" "${command[@]}" \
        >"$folder/out" || { tail -n 20 "$folder/out"; exit 1; }
    grep -E 'AF_INET|sin_addr|sin6_addr' "$folder/trace" >"$folder/asked" || true
    grep -vE 'inet_addr\("127\.|inet_pton\(AF_INET6, "(::1|::ffff:127\.)' "$folder/asked" \
        >"$folder/foreign" || true
    say "$(wc -l <"$folder/trace") calls, $(wc -l <"$folder/asked") to addresses," \
        "$(wc -l <"$folder/foreign") of them off this machine"
else
    say "2. no strace here: the guard alone watched run 1"
    : >"$folder/foreign"
fi
[ ! -s "$folder/foreign" ] || { head -n 20 "$folder/foreign"; exit 1; }
say "nothing asked for another machine"
