#!/usr/bin/env bash
# Builds replay_agent with several compilers and for several targets, plays the recordings on each,
# and prints a table of the hashes. Exit code 1 when one differs from its golden value.
# Usage: tests/replay/compare_targets.sh [BUILD_FOLDER]   (default build/replay)
set -euo pipefail
cd "$(dirname "$0")/../.."

build=${1-build/replay}
model=tests/replay/replay_model.ivfm
declare -A golden
while read -r recording hash; do golden[$recording]=$hash; done <tests/replay/golden_hashes.txt

# name | build type | compiler to look for | emulator | CMake arguments
targets=(
  "x86-64 gcc release|Release|g++||-DCMAKE_CXX_COMPILER=g++"
  "x86-64 gcc debug|Debug|g++||-DCMAKE_CXX_COMPILER=g++"
  "x86-64 clang release|Release|clang++-14||-DCMAKE_CXX_COMPILER=clang++-14 -DCMAKE_C_COMPILER=clang-14"
  "aarch64|Release|aarch64-linux-gnu-g++|qemu-aarch64-static|--toolchain toolchains/aarch64-linux-gnu.cmake"
  "armhf|Release|arm-linux-gnueabihf-g++|qemu-arm-static|--toolchain toolchains/arm-linux-gnueabihf.cmake"
  "cortex-m7|Release|arm-none-eabi-g++|qemu-system-arm|--toolchain toolchains/cortex-m7.cmake"
)

differing=0
row() { printf '%-22s %-34s %-8s %-9s %-17s %s\n' "$@"; }

# judge NAME COMPILER TYPE RECORDING HASH
judge() {
  local verdict=equal
  if [[ $5 != "${golden[$4]}" ]]; then
    verdict="DIFFERS, golden is ${golden[$4]}"
    differing=1
  fi
  row "$1" "$2" "$3" "$4" "$5" "$verdict"
}

compiler_version() { "$1" --version | head -n 1 | sed -E 's/ \([^)]*\)//; s/^Debian //' | cut -c1-34; }

compare() {
  local name=$1 type=$2 compiler=$3 emulator=$4 arguments=$5
  local folder=$build/${name// /-} tool recording output
  for tool in "$compiler" $emulator; do
    if ! command -v "$tool" >/dev/null; then
      row "$name" "$compiler" "$type" - - "not run: $tool is not installed"
      return
    fi
  done
  if [[ ! -f $folder/build.ninja ]]; then
    # shellcheck disable=SC2086  # several arguments
    cmake -S . -B "$folder" -G Ninja -DCMAKE_BUILD_TYPE="$type" -DIVFM_HOST=OFF \
      -DIVFM_TRAINER=OFF -DIVFM_TESTS=OFF $arguments >"$folder.log" 2>&1 || {
      cat "$folder.log" >&2
      exit 1
    }
  fi
  local program=replay_agent
  [[ $name == cortex-m7 ]] && program=replay_cortex_m
  cmake --build "$folder" --target $program >"$folder.log" 2>&1 || {
    cat "$folder.log" >&2
    exit 1
  }
  if [[ $name == cortex-m7 ]]; then
    for recording in corridor matching; do
      output=$(tests/replay/run_cortex_m.sh "$folder/tests/replay/$program.elf" \
        "tests/replay/$recording.replay")
      judge "$name" "$(compiler_version "$compiler")" "$type" "$recording" "${output##*hash }"
    done
    row "$name" "$(compiler_version "$compiler")" "$type" arena - \
      "not run: the paper profile's map alone needs 700 KiB"
    return
  fi
  for recording in corridor matching arena; do
    output=$($emulator "$folder/tests/replay/$program" "tests/replay/$recording.replay" "$model")
    judge "$name" "$(compiler_version "$compiler")" "$type" "$recording" "${output##*hash }"
  done
}

mkdir -p "$build"
row target compiler type recording hash verdict
for target in "${targets[@]}"; do
  IFS='|' read -r name type compiler emulator arguments <<<"$target"
  compare "$name" "$type" "$compiler" "$emulator" "$arguments"
done
exit "$differing"
