#!/usr/bin/env bash
# Two processes under mpirun, and a run that was cut off and goes on, print what one process prints.
set -euo pipefail

ivfm=$1
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"

as_two() { mpirun --allow-run-as-root --oversubscribe -n 2 "$ivfm" "$@"; }
arguments=(eval --world 1x --policy random --agents 2 --episodes 7 --seed 5 --json --no-timing)

"$ivfm" "${arguments[@]}" >one.json
as_two "${arguments[@]}" --resume kept.csv >two.json
cmp one.json two.json
[[ $(wc -l <kept.csv) == 7 ]]  # the first process alone writes

# Cut off in the middle of its fourth line.
head -c $(($(head -n 3 kept.csv | wc -c) + 40)) kept.csv >cut.csv
"$ivfm" "${arguments[@]}" --resume cut.csv >resumed.json
cmp one.json resumed.json

# What one process cannot do ends them all, soon, with a sentence.
if as_two eval --world nowhere >error.txt 2>&1; then exit 1; fi
grep -q "unknown world 'nowhere'" error.txt
echo "two processes, a resumed run: the same bytes"
