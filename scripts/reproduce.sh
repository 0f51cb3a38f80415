#!/usr/bin/env bash
# Every table and figure of the paper, and ALFWorld-R as episodes, with the nano models; resumes where
# it was stopped.
#
#   scripts/reproduce.sh            into runs/paper, and the reference results into eval/results
#   scripts/reproduce.sh fig4 table2        only those
#
# Environment: OUT (runs/paper), RESULTS (eval/results), WORKERS (0: as many as cores and memory
# allow). What needs the reference data ($KARMA_SHARED or ../shared) is left out, by name, without.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
OUT=${OUT:-runs/paper} RESULTS=${RESULTS:-eval/results} WORKERS=${WORKERS:-0}
shared=${KARMA_SHARED:-../shared}
karma=.venv/bin/karma
begun=$SECONDS

say() { printf 'paper: %s\n' "$*"; }

figure() {
    $karma eval "eval/paper/$1.toml" --out "$OUT/$1"
    mkdir -p "$RESULTS/paper"
    cp "$OUT/$1/results.json" "$RESULTS/paper/$1.json"
    cp "$OUT/$1/claims.md" "$RESULTS/paper/$1.md"
}

table() {
    local file="eval/paper/$1.toml"
    [ -f "$file" ] || file="eval/$1.toml"
    $karma eval "$file" --out "$OUT/$1" --workers "$WORKERS"
    $karma table "$OUT/$1" --out "$RESULTS/paper/$1"
    $karma report "$OUT/$1"
}

wanted=("$@")
[ $# -gt 0 ] || wanted=(fig4 fig5 fig6 fig7 table2 table1 table1_authors alfworld_r)
for name in "${wanted[@]}"; do
    say "$name ($(((SECONDS - begun) / 60)) min so far)"
    case "$name" in
        fig*) figure "$name" ;;
        table1_authors)
            if [ -d "$shared/data/alfred_l" ]; then table "$name"; else
                say "left out: needs $shared/data/alfred_l (set KARMA_SHARED)"
            fi
            ;;
        *) table "$name" ;;
    esac
done
say "done in $(((SECONDS - begun) / 60)) min; pictures and pages in $OUT, figures in $RESULTS/paper"
