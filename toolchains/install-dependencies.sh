#!/usr/bin/env bash
# Installs every Debian 12 package that building, testing and the demo need; does nothing, quickly,
# when all are there. Run by the Makefile.
set -euo pipefail

packages=(
  # Build tools
  build-essential ccache cmake git ninja-build pkg-config python3
  # Command lines, config files, JSON
  libcli11-dev libtomlplusplus-dev nlohmann-json3-dev
  # Simulator: worlds, laser scans, real recordings (mrpt-common), map files
  libmrpt-dev libyaml-cpp-dev mrpt-common zlib1g-dev
  # Pictures
  fonts-dejavu-core libopencv-dev
  # Map server's run database
  libsqlite3-dev sqlite3
  # Live page, and the browser that tests it
  libcpp-httplib-dev chromium chromium-driver
  # Evaluation on many machines; encryption of the radio, hashes of models
  libopenmpi-dev openmpi-bin libsodium-dev
  # Quantizer and training
  libeigen3-dev libtorch-dev
  # Tests and benchmarks; another project's CAN library to talk to ours
  googletest libbenchmark-dev libgmock-dev libgtest-dev python3-can python3-prometheus-client
  # Other projects' tools that read what ours write
  can-utils mandoc mrpt-apps tshark zsh
  # Robot builds and their emulators
  g++-aarch64-linux-gnu g++-arm-linux-gnueabihf
  gcc-arm-none-eabi libnewlib-arm-none-eabi libstdc++-arm-none-eabi-newlib
  qemu-system-arm qemu-system-x86 qemu-user-static
  # Packages for robots; modules of the emulated machines' kernels
  kmod lintian
  # Format and lint
  clang-14 clang-format-14 clang-tidy-14 libclang-rt-14-dev
)

say() { echo "install-dependencies: $*" >&2; }

missing=()
installed=$(dpkg-query -W -f='${db:Status-Abbrev} ${Package}\n' | sed -n 's/^ii  *//p' | sort -u)
for package in "${packages[@]}"; do
  grep -qxF -- "$package" <<<"$installed" || missing+=("$package")
done
if ((${#missing[@]} == 0)); then
  exit 0
fi

say "installing ${#missing[@]} packages: ${missing[*]}"
as_root=()
if ((EUID != 0)); then
  if ! command -v sudo >/dev/null; then
    say "needs root to install packages: run it as root, or install sudo"
    exit 1
  fi
  as_root=(sudo)
fi
apt_get() {
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -q -o Acquire::Retries=3 "$@"
}
if ! apt_get update; then
  say "apt-get update failed; the network and /etc/apt/sources.list decide about that"
  exit 1
fi
if ! apt_get install --yes --no-install-recommends "${missing[@]}"; then
  say "apt-get could not install the packages above; this project needs Debian 12 (bookworm)," \
    "its section 'main' is enough"
  exit 1
fi
