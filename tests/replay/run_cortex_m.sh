#!/usr/bin/env bash
# Runs a bare-metal image on QEMU's mps2-an500, each instruction 1 ns of the machine's time.
# Usage: tests/replay/run_cortex_m.sh IMAGE.elf RECORDING [--each]
set -euo pipefail

image=${1:?usage: run_cortex_m.sh IMAGE.elf RECORDING [--each]}
arguments=("enable=on,target=native")
for argument in "${@:2}"; do arguments+=("arg=$argument"); done
exec timeout 600 qemu-system-arm -M mps2-an500 -cpu cortex-m7 -icount shift=0 -display none \
  -monitor none -serial none -semihosting-config "$(IFS=,; echo "${arguments[*]}")" \
  -kernel "$image" </dev/null 2>&1  # semihosting prints on standard error
