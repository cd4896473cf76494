#!/usr/bin/env bash
# For changes of behaviour on purpose: pins the recordings' new hashes, or records them anew.
# Usage: tests/replay/record_replays.sh BUILD_FOLDER [--pin | MODEL]
#   --pin   keeps the recordings; enough as long as replay_test complains about hashes only
#   MODEL   replaces the model beside the recordings, e.g. models/NAME.ivfm
set -euo pipefail

build=$(realpath "${1:?usage: record_replays.sh BUILD_FOLDER [--pin | MODEL]}")
choice=${2-}
[[ -z $choice || $choice == --pin ]] || choice=$(realpath "$choice")
cd "$(dirname "$0")"
tools=$build/tests/replay
cmake --build "$build" --target replay_agent
if [[ $choice != --pin ]]; then
  cmake --build "$build" --target record_agent
  if [[ -n $choice ]]; then
    cp "$choice" replay_model.ivfm
  elif [[ ! -f replay_model.ivfm ]]; then
    "$tools/record_agent" model replay_model.ivfm
  fi
fi
hashes=
for recording in corridor matching arena; do
  if [[ $choice != --pin ]]; then
    "$tools/record_agent" "$recording" replay_model.ivfm "$recording.replay"
  fi
  output=$("$tools/replay_agent" "$recording.replay" replay_model.ivfm)
  hashes+="$recording ${output##*hash }"$'\n'
done
printf '%s' "$hashes" | tee golden_hashes.txt
