"""Writes folders as an initramfs: the newc format of the kernel's
Documentation/driver-api/early-userspace/buffer-format.rst. As a program: cpio.py FOLDER >ARCHIVE"""
import os
import stat
import sys


def _entry(inode, name, mode, data=b"", device=(0, 0)):
    name = name.encode() + b"\0"
    fields = (inode, mode, 0, 0, 1, 0, len(data), 0, 0, *device, len(name), 0)
    header = b"070701" + b"".join(b"%08X" % field for field in fields) + name
    return header + b"\0" * (-len(header) % 4) + data + b"\0" * (-len(data) % 4)


def _content(path, mode):
    if stat.S_ISLNK(mode):
        return os.readlink(path).encode()
    if stat.S_ISREG(mode):
        with open(path, "rb") as file:
            return file.read()
    return b""


def archive(folder):
    """Bytes of `folder`'s tree, everything owned by root, with a /dev/console. Archives may be
    put behind each other: later files replace earlier ones."""
    parts = []
    for parent, folders, files in os.walk(folder):
        folders.sort()
        for name in sorted(folders + files):
            path = os.path.join(parent, name)
            mode = os.lstat(path).st_mode
            parts.append(_entry(len(parts) + 1, os.path.relpath(path, folder), mode,
                                _content(path, mode)))
    parts.append(_entry(len(parts) + 1, "dev", 0o040755))
    parts.append(_entry(len(parts) + 1, "dev/console", 0o020600, device=(5, 1)))
    parts.append(_entry(0, "TRAILER!!!", 0))
    return b"".join(parts)


if __name__ == "__main__":
    sys.stdout.buffer.write(archive(sys.argv[1]))
