#!/usr/bin/env python3
"""Prints where every byte of a Cortex-M image lies, from the linker's map: section, module, bytes.
Fails when the image holds a heap. Usage: memory_table.py IMAGE.map"""
import collections
import re
import sys

SECTIONS = {"FLASH": (".vectors", ".text", ".rodata", ".model", ".init_array", ".data"),
            "RAM": (".stack", ".data", ".bss")}
HEAP = ("malloc", "free", "realloc", "calloc", "_malloc_r", "_free_r", "_sbrk", "sbrk", "_sbrk_r",
        "_Znwj", "_Znaj", "_ZdlPv", "_ZdlPvj", "_ZdaPv")


def module_of(path):
    """`libivfm_nn.a(model_view.cpp.obj)` is ivfm_nn, a program's own object its file."""
    archive = re.search(r"lib([^/]+)\.a\(", path)
    return archive.group(1) if archive else path.rsplit("/", 1)[-1].removesuffix(".obj")


def read_map(lines):
    """Sizes of output sections, bytes by section and module, and every symbol named in the map."""
    sizes, modules, section, pending, heap = {}, collections.Counter(), None, "", []
    started = False
    for line in lines:
        started = started or line.startswith("Linker script and memory map")
        if not started:
            continue
        if symbol := re.match(r"\s+0x[0-9a-f]+\s+(\w+)$", line):
            heap += [symbol.group(1)] if symbol.group(1) in HEAP else []
        line = pending + line.rstrip("\n")
        pending = ""
        if re.match(r"^ ?[.*]\S+$", line):  # a long name: the rest stands on the next line
            pending = line
        elif output := re.match(r"^(\.\S+)\s+0x[0-9a-f]+\s+0x([0-9a-f]+)", line):
            section = output.group(1)
            sizes[section] = int(output.group(2), 16)
        elif part := re.match(r"^ (\S+)\s+0x[0-9a-f]+\s+0x([0-9a-f]+)(?:\s+(\S.*))?$", line):
            name = module_of(part.group(3)) if part.group(3) else "(alignment)"
            modules[section, name] += int(part.group(2), 16)
    return sizes, modules, heap


def main():
    with open(sys.argv[1]) as file:
        sizes, modules, heap = read_map(file)
    for memory, limit in (("FLASH", 1024), ("RAM", 320)):
        total = 0
        print(f"{memory} ({limit} KiB)   section      module                          bytes")
        for section in SECTIONS[memory]:
            rows = [(m, b) for (s, m), b in modules.items() if s == section and b > 0]
            rest = sizes.get(section, 0) - sum(b for _, b in rows)
            if section == ".stack":
                rows, rest = [("(stack)", sizes.get(section, 0))], 0
            rows += [("(alignment)", rest)] if rest > 0 else []
            for module, size in sorted(rows, key=lambda row: -row[1]):
                print(f"                {section:12} {module:28} {size:8}")
            total += sizes.get(section, 0)
        print(f"                total {'':35} {total:8}, {total / 10.24 / limit:.1f} % of it\n")
    if heap:
        sys.exit(f"{sys.argv[1]}: a heap is linked in: {', '.join(sorted(set(heap)))}")
    print("no heap is linked in")


main()
