#!/usr/bin/env bash
# Boots Debian's arm64 kernel in QEMU and runs the cross-built CAN checks on its SocketCAN stack.
# Kernel and busybox are fetched once, with a private apt state, into build/hil.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
work=$root/build/hil
mkdir -p "$work"/apt/{lists/partial,cache/archives/partial} "$work"/image/{bin,modules}
touch "$work/apt/status"

apt_arm64=(-o "Dir::State=$work/apt" -o "Dir::State::Lists=$work/apt/lists"
           -o "Dir::State::status=$work/apt/status" -o "Dir::Cache=$work/apt/cache"
           -o APT::Architecture=arm64 -o APT::Architectures=arm64 -o APT::Sandbox::User=root)
fetch() {  # PACKAGE: unpacked to build/hil/PACKAGE
  [[ -d $work/$1 ]] && return
  (cd "$work/apt" && rm -f "$1"_*.deb && apt-get "${apt_arm64[@]}" -qq download "$1")
  dpkg-deb -x "$work/apt/$1"_*.deb "$work/$1.part" && mv "$work/$1.part" "$work/$1"
}
if [[ ! -e $work/kernel ]]; then
  echo "hil: fetching Debian's arm64 kernel"
  apt-get "${apt_arm64[@]}" -qq update
  kernel=$(apt-cache "${apt_arm64[@]}" depends linux-image-arm64 |
           sed -n 's/^ *Depends: *\(linux-image-[0-9].*\)$/\1/p')
  fetch busybox-static
  fetch "$kernel"
  ln -s "$kernel" "$work/kernel"
fi

echo "hil: building the checks"
[[ -f $root/build/aarch64/build.ninja ]] || (cd "$root" && cmake --preset aarch64 > /dev/null)
cmake --build "$root/build/aarch64" --target socketcan_check > "$work/build.log" ||
  { cat "$work/build.log"; exit 1; }

cp "$root/build/aarch64/hil/socketcan_check" "$work/busybox-static/bin/busybox" "$work/image/bin/"
cp "$root/hil/init" "$work/image/init"
for module in net/can/can net/can/can-raw drivers/net/can/dev/can-dev drivers/net/can/vcan; do
  cp "$work"/kernel/lib/modules/*/kernel/$module.ko "$work/image/modules/"
done
python3 "$root/hil/make_initramfs.py" "$work/image" "$work/initramfs.gz"

echo "hil: booting"
timeout 300 qemu-system-aarch64 -M virt -cpu cortex-a72 -m 256 -nic none -nographic -no-reboot \
  -kernel "$work"/kernel/boot/vmlinuz-* -initrd "$work/initramfs.gz" \
  -append "console=ttyAMA0 quiet panic=-1" < /dev/null | tee "$work/console.log"
grep -q "HIL PASSED" "$work/console.log"
