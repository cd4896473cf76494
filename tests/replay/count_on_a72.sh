#!/usr/bin/env bash
# Counts the instructions of decisions on a Cortex-A72: plays the corridor's recording on an emulated
# arm64 machine where an instruction takes 1 ns. Needs the machine that `make hil` has fetched, and
# replay_agent for aarch64. Usage: tests/replay/count_on_a72.sh [MACHINE_FOLDER] [REPLAY_AGENT]
set -euo pipefail
cd "$(dirname "$0")/../.."

machine=${1-build/hil/arm64}
program=${2-build/aarch64/tests/replay/replay_agent}
if [[ ! -e $machine/base.cpio || ! -x $program ]]; then
  echo "count_on_a72: no $machine/base.cpio or no $program; run 'make hil cross' first" >&2
  exit 1
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir "$work/image"
cp "$program" tests/replay/corridor.replay tests/replay/replay_model.ivfm "$work/image/"
cat >"$work/image/init" <<'INIT'
#!/bin/busybox sh
/replay_agent /corridor.replay /replay_model.ivfm --count
/bin/busybox poweroff -f
INIT
chmod +x "$work/image/init"
cat "$machine/base.cpio" - >"$work/initramfs" < <(python3 hil/cpio.py "$work/image")
timeout 500 qemu-system-aarch64 -M virt -cpu cortex-a72 -m 512 -icount shift=0,sleep=off \
  -nic none -nographic -no-reboot -kernel "$machine/vmlinuz" \
  -initrd "$work/initramfs" -append "console=ttyAMA0 quiet panic=-1" </dev/null
