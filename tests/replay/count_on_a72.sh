#!/usr/bin/env bash
# Counts the instructions of decisions on a Cortex-A72: plays the corridor's recording on an emulated
# arm64 machine where an instruction takes 1 ns. Needs the kernel that `make hil` has fetched, and
# replay_agent for aarch64. Usage: tests/replay/count_on_a72.sh [HIL_FOLDER] [REPLAY_AGENT]
set -euo pipefail
cd "$(dirname "$0")/../.."

hil=${1-build/hil}
program=${2-build/aarch64/tests/replay/replay_agent}
if [[ ! -e $hil/kernel || ! -x $program ]]; then
  echo "count_on_a72: no $hil/kernel or no $program; run 'make hil cross' first" >&2
  exit 1
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$work/image/bin"
cp "$program" "$hil/busybox-static/bin/busybox" "$work/image/bin/"
cp tests/replay/corridor.replay tests/replay/replay_model.ivfm "$work/image/"
cat >"$work/image/init" <<'INIT'
#!/bin/busybox sh
/bin/replay_agent /corridor.replay /replay_model.ivfm --count
/bin/busybox poweroff -f
INIT
python3 hil/make_initramfs.py "$work/image" "$work/initramfs.gz"
timeout 500 qemu-system-aarch64 -M virt -cpu cortex-a72 -m 256 -icount shift=0,sleep=off \
  -nic none -nographic -no-reboot -kernel "$hil"/kernel/boot/vmlinuz-* \
  -initrd "$work/initramfs.gz" -append "console=ttyAMA0 quiet panic=-1" </dev/null
