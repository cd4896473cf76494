#!/usr/bin/env bash
# Builds the robot binary a second time, from a copy of the sources elsewhere and without the
# compiler cache, packs it, and compares with what lies in a folder.
# Usage: packaging/check_reproducible.sh PRESET PACKAGE_FOLDER
set -euo pipefail
preset=${1:?usage: check_reproducible.sh PRESET PACKAGE_FOLDER} first=$(realpath "$2")
cd "$(dirname "$0")/.."

SOURCE_DATE_EPOCH=$(git log -1 --format=%ct)
export SOURCE_DATE_EPOCH CCACHE_DISABLE=1
copy=$(mktemp -d)
trap 'rm -rf "$copy"' EXIT
git ls-files -z --cached --others --exclude-standard | tar -c --null -T - | tar -x -C "$copy"
mkdir -p "$copy/build/$preset"
[[ ! -d build/$preset/libsodium ]] ||
  ln -s "$PWD/build/$preset/libsodium" "$copy/build/$preset/libsodium"
cmake -S "$copy" --preset "$preset" >/dev/null
cmake --build "$copy/build/$preset" --target ivfm-agent >"$copy/build.log" 2>&1 || {
  cat "$copy/build.log" >&2
  exit 1
}
"$copy/packaging/pack.sh" "$preset" "$copy/build/$preset/firmware/agent/linux/ivfm-agent" \
  "$copy/packages" >"$copy/sums"
if ! (cd "$first" && sha256sum --quiet -c "$copy/sums"); then
  echo "$preset: a second build differs" >&2
  exit 1
fi
echo "$preset: a second build elsewhere gives the same packages"
