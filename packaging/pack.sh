#!/usr/bin/env bash
# Packs the robot binary of a cross build with its model, configuration, units and udev rule, as
# ivfm-agent-PRESET.tar.gz and as a Debian package. The same sources give the same bytes.
# Usage: packaging/pack.sh PRESET BINARY OUT_FOLDER     (aarch64, armhf or x86_64)
set -euo pipefail
preset=${1:?usage: pack.sh PRESET BINARY OUT_FOLDER} binary=$(realpath "$2")
mkdir -p "$3" && out=$(realpath "$3")
cd "$(dirname "$0")/.."

case $preset in
  aarch64) arch=arm64 strip=aarch64-linux-gnu-strip ;;
  armhf) arch=armhf strip=arm-linux-gnueabihf-strip ;;
  x86_64) arch=amd64 strip=strip ;;
  *) echo "pack: '$preset' is none of aarch64, armhf, x86_64" >&2; exit 2 ;;
esac
version=$(sed -n 's/^project(ivfm VERSION \([0-9.]*\).*/\1/p' CMakeLists.txt)
# Time stamps in the packages: of the commit, not of the build.
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct)}
export SOURCE_DATE_EPOCH
umask 022
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
root=$work/root doc=$work/root/usr/share/doc/ivfm-agent
install -d "$root"/{etc/ivfm,usr/bin,usr/share/ivfm,lib/systemd/system,lib/udev/rules.d} "$doc" \
  "$root/DEBIAN" "$root/usr/share/man/man1"

models=(models/*.ivfm)
install -m 755 "$binary" "$root/usr/bin/ivfm-agent"
"$strip" --strip-all "$root/usr/bin/ivfm-agent"
install -m 644 "${models[0]}" "$root/usr/share/ivfm/explorer.ivfm"
install -m 644 firmware/wheel_drive/ivfm_{bus.dbc,drive.eds} "$root/usr/share/ivfm/"
install -m 644 packaging/*.service "$root/lib/systemd/system/"
install -m 644 packaging/60-ivfm-lidar.rules "$root/lib/udev/rules.d/"
sed -e 's|^lidar = "[^"]*" *|lidar = "/dev/ivfm-lidar"     |' \
    -e 's|^model = "" *|model = "/usr/share/ivfm/explorer.ivfm"  |' \
  firmware/agent/agent.example.toml >"$root/etc/ivfm/agent.toml"
grep -q '^lidar = "/dev/ivfm-lidar"' "$root/etc/ivfm/agent.toml"
grep -q '^model = "/usr/share' "$root/etc/ivfm/agent.toml"
gzip -9n <packaging/ivfm-agent.1 >"$root/usr/share/man/man1/ivfm-agent.1.gz"
install -m 644 docs/first_start.md docs/safety.md "$doc/"
install -m 644 "${models[0]%.ivfm}.md" "$doc/model_card.md"
tar --sort=name --owner=0 --group=0 --numeric-owner --mtime=@"$SOURCE_DATE_EPOCH" \
  --exclude=./DEBIAN --exclude=./usr/share/lintian -C "$root" -c . |
  gzip -9n >"$out/ivfm-agent-$preset.tar.gz"

{ printf 'Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/\n\n'
  printf 'Files: *\nCopyright: 2026, the ivfm authors\nLicense: BSD-3-Clause\n'
  sed -e '1,4d' -e 's/^$/./' -e 's/^/ /' LICENSE; } >"$doc/copyright"
printf 'ivfm-agent (%s) stable; urgency=medium\n\n  * Built from the source tree.\n\n -- %s  %s\n' \
  "$version" "ivfm <maintainers@ivfm.invalid>" "$(date -Ru -d @"$SOURCE_DATE_EPOCH")" |
  gzip -9n >"$doc/changelog.gz"
install -D -m 644 packaging/lintian-overrides "$root/usr/share/lintian/overrides/ivfm-agent"
echo /etc/ivfm/agent.toml >"$root/DEBIAN/conffiles"
install -m 755 packaging/{postinst,prerm,postrm} "$root/DEBIAN/"
sed -e "s/@VERSION@/$version/" -e "s/@ARCH@/$arch/" \
    -e "s/@SIZE@/$(du -sk --exclude=DEBIAN --apparent-size "$root" | cut -f1)/" \
  packaging/control >"$root/DEBIAN/control"
(cd "$root" && find . -type f ! -path './DEBIAN/*' -printf '%P\0' | sort -z |
  xargs -0 md5sum >DEBIAN/md5sums)
find "$root" -exec touch -hd @"$SOURCE_DATE_EPOCH" {} +
dpkg-deb --root-owner-group -Zxz --build "$root" "$out/ivfm-agent_${version}_$arch.deb" >/dev/null
(cd "$out" && sha256sum "ivfm-agent-$preset.tar.gz" "ivfm-agent_${version}_$arch.deb")
