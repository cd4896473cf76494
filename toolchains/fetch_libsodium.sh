#!/usr/bin/env bash
# Fetches Debian's libsodium for a cross build, with a private apt state: no foreign architecture is
# added to this machine. Usage: toolchains/fetch_libsodium.sh PRESET   (to build/PRESET/libsodium)
set -euo pipefail
preset=${1:?usage: fetch_libsodium.sh PRESET}
cd "$(dirname "$0")/.."
case $preset in
  aarch64) arch=arm64 ;;
  armhf) arch=armhf ;;
  *) exit 0 ;;  # this machine's own, or none
esac
target=$PWD/build/$preset/libsodium
[[ -d $target ]] && exit 0
state=$PWD/build/$preset/apt
mkdir -p "$state"/lists/partial "$state"/cache/archives/partial
touch "$state/status"
apt=(-qq -o "Dir::State=$state" -o "Dir::State::Lists=$state/lists"
     -o "Dir::State::status=$state/status" -o "Dir::Cache=$state/cache"
     -o "APT::Architecture=$arch" -o "APT::Architectures=$arch" -o APT::Sandbox::User=root
     -o Acquire::Retries=3)
# A mirror in the middle of its own update lacks one list or another; the download decides.
apt-get "${apt[@]}" update || true
(cd "$state" && apt-get "${apt[@]}" download libsodium-dev)
rm -rf "$target.part"
dpkg-deb -x "$state"/libsodium-dev_*.deb "$target.part"
mv "$target.part" "$target"
