#!/usr/bin/env bash
# Runs clang-tidy 14 on the sources that changed since a commit (default origin/main), or on all.
# Usage: toolchains/lint.sh BUILD_DIR [--all | --since COMMIT]
set -euo pipefail
cd "$(dirname "$0")/.."

build_dir=${1:?usage: lint.sh BUILD_DIR [--all | --since COMMIT]}
if [[ ! -f $build_dir/compile_commands.json ]]; then
  echo "lint: no $build_dir/compile_commands.json; run 'make lint' or configure first" >&2
  exit 1
fi
scope=${2---since}
base=${3-origin/main}
mapfile -t sources < <(git ls-files '*.cpp')
if [[ $scope != --all ]] && git rev-parse -q --verify "$base" >/dev/null; then
  mapfile -t sources < <(git diff --name-only --diff-filter=d "$base" -- '*.cpp')
fi
# Only what this build compiles: sources of other targets have no compile command.
compiled=()
for source in "${sources[@]}"; do
  grep -qF "\"file\": \"$PWD/$source\"" "$build_dir/compile_commands.json" && compiled+=("$source")
done
echo "lint: ${#compiled[@]} sources"
if ((${#compiled[@]} > 0)); then
  printf '%s\0' "${compiled[@]}" |
    xargs -0 -n 4 -P "$(nproc)" clang-tidy-14 -p "$build_dir" --quiet --warnings-as-errors='*'
fi
