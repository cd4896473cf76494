#!/usr/bin/env bash
# Builds the fuzzers and runs each for some seconds, two at a time. Usage: run.sh [SECONDS] [ONLY...]
set -euo pipefail
cd "$(dirname "$0")/../.."
seconds=${1:-5}
shift || true
[[ -f build/fuzz/build.ninja ]] || cmake --preset fuzz >/dev/null
cmake --build build/fuzz --target fuzzers >build/fuzz/build.log || { cat build/fuzz/build.log; exit 1; }
mkdir -p build/fuzz/crashes
build/fuzz/tests/fuzz/fuzz_seeds build/fuzz/corpus

fuzz() {  # PROGRAM: its last words, and all of them when it failed
  local name=${1##*/} log
  name=${name%_fuzz}
  log=build/fuzz/$name.log
  if "$1" build/fuzz/corpus/"$name" -max_total_time="$seconds" -max_len=4096 -timeout=10 \
    -rss_limit_mb=2048 -close_fd_mask=1 -artifact_prefix=build/fuzz/crashes/"$name"- >"$log" 2>&1; then
    printf '%-12s %s\n' "$name" "$(grep -a '^Done' "$log")"
  else
    cat "$log"
    return 1
  fi
}
export -f fuzz
export seconds
programs=(build/fuzz/tests/fuzz/*_fuzz)
(($# == 0)) || programs=("${@/#/build/fuzz/tests/fuzz/}")
printf '%s\n' "${programs[@]}" | xargs -P 2 -I{} bash -c 'fuzz {}'
