#!/usr/bin/env bash
# Formats every C++ source with clang-format 14, or with --check only names those that differ.
set -euo pipefail
cd "$(dirname "$0")/.."

mapfile -t sources < <(find firmware hil host shared tests -name '*.h' -o -name '*.cpp' | sort)
if [[ ${1-} != --check ]]; then
  clang-format-14 -i "${sources[@]}"
  exit 0
fi
differing=()
for source in "${sources[@]}"; do
  clang-format-14 "$source" | cmp -s - "$source" || differing+=("$source")
done
if ((${#differing[@]} > 0)); then
  echo "not formatted (run 'make format'): ${differing[*]}" >&2
  exit 1
fi
echo "${#sources[@]} sources are formatted"
