"""Packs a folder into an initramfs: make_initramfs.py FOLDER OUTPUT.gz (newc cpio, see the
kernel's Documentation/driver-api/early-userspace/buffer-format.rst)."""
import gzip
import os
import sys


def entry(inode, name, mode, data=b"", device=(0, 0)):
    name = name.encode() + b"\0"
    fields = (inode, mode, 0, 0, 1, 0, len(data), 0, 0, *device, len(name), 0)
    header = b"070701" + b"".join(b"%08X" % field for field in fields) + name
    return header + b"\0" * (-len(header) % 4) + data + b"\0" * (-len(data) % 4)


def main(folder, output):
    parts = []
    for parent, _, files in sorted(os.walk(folder)):
        inside = os.path.relpath(parent, folder)
        if inside != ".":
            parts.append(entry(len(parts) + 1, inside, 0o040755))
        for name in sorted(files):
            with open(os.path.join(parent, name), "rb") as file:
                path = os.path.normpath(os.path.join(inside, name))
                parts.append(entry(len(parts) + 1, path, 0o100755, file.read()))
    parts.append(entry(len(parts) + 1, "dev", 0o040755))
    parts.append(entry(len(parts) + 1, "dev/console", 0o020600, device=(5, 1)))
    parts.append(entry(0, "TRAILER!!!", 0))
    with gzip.open(output, "wb", 1) as archive:
        archive.write(b"".join(parts))


if __name__ == "__main__":
    main(*sys.argv[1:])
