#!/usr/bin/env python3
"""Prints where every byte of a program lies, from the linker's map: section, module, bytes.
Usage: memory_table.py PROGRAM.map [--cortex-m]
--cortex-m: by memory, with an STM32F746's limits; fails when the image holds a heap."""
import collections
import re
import sys

MEMORIES = {"FLASH": (1024, (".vectors", ".text", ".rodata", ".model", ".init_array", ".data")),
            "RAM": (320, (".stack", ".data", ".bss"))}
HEAP = ("malloc", "free", "realloc", "calloc", "_malloc_r", "_free_r", "_sbrk", "sbrk", "_sbrk_r",
        "_Znwj", "_Znaj", "_ZdlPv", "_ZdlPvj", "_ZdaPv")


def module_of(path):
    """`libivfm_nn.a(model_view.cpp.obj)` is ivfm_nn, a program's own object its file."""
    archive = re.search(r"lib([^/]+)\.a\(", path)
    return archive.group(1) if archive else re.sub(r"\.o(bj)?$", "", path.rsplit("/", 1)[-1])


def read_map(lines):
    """Sizes of output sections in memory, bytes by section and module, and heap functions."""
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
        if re.match(r"^ ?[.*_]\S+$", line):  # a long name: the rest stands on the next line
            pending = line
        elif output := re.match(r"^([._]\S+)\s+0x([0-9a-f]+)\s+0x([0-9a-f]+)", line):
            # What is not loaded (debug information) has no address; a Cortex-M's vectors lie at 0.
            loaded = int(output.group(2), 16) > 0 or output.group(1) == ".vectors"
            section = output.group(1) if loaded else None
            if loaded:
                sizes[section] = int(output.group(3), 16)
        elif part := re.match(r"^ (\S+)\s+0x[0-9a-f]+\s+0x([0-9a-f]+)(?:\s+(\S.*))?$", line):
            filler = part.group(1) == "*fill*" or not part.group(3)
            name = "(alignment)" if filler else module_of(part.group(3))
            modules[section, name] += int(part.group(2), 16)
    return sizes, modules, heap


def rows_of(section, sizes, modules):
    """(module, bytes) of a section, largest first; what no module claims is alignment."""
    if section == ".stack":
        return [("(stack)", sizes.get(section, 0))]
    rows = collections.Counter({m: b for (s, m), b in modules.items() if s == section and b > 0})
    rest = sizes.get(section, 0) - sum(rows.values())
    if rest > 0:
        rows["(alignment)"] += rest
    return rows.most_common()


def print_rows(section, rows):
    for module, size in rows:
        print(f"                {section:18} {module:28} {size:10}")


def print_image(sizes, modules, heap):
    for memory, (limit, sections) in MEMORIES.items():
        print(f"{memory} ({limit} KiB)   section            module                            bytes")
        for section in sections:
            print_rows(section, rows_of(section, sizes, modules))
        total = sum(sizes.get(section, 0) for section in sections)
        print(f"                total {'':41} {total:10}, {total / 10.24 / limit:.1f} % of it\n")
    if heap:
        sys.exit(f"{sys.argv[1]}: a heap is linked in: {', '.join(sorted(set(heap)))}")
    print("no heap is linked in")


def print_program(sizes, modules):
    """Modules below a thousandth of the whole are summed up."""
    total = sum(sizes.values())
    print("program         section            module                            bytes")
    for section, size in sorted(sizes.items(), key=lambda item: -item[1]):
        rows = rows_of(section, sizes, modules)
        small = [row for row in rows if row[1] < total / 1000]
        rows = [row for row in rows if row[1] >= total / 1000]
        if small:
            rows.append((f"({len(small)} others)", sum(row[1] for row in small)))
        print_rows(section, rows)
    print(f"                total {'':41} {total:10}")


def main():
    with open(sys.argv[1]) as file:
        sizes, modules, heap = read_map(file)
    if "--cortex-m" in sys.argv:
        print_image(sizes, modules, heap)
    else:
        print_program(sizes, modules)


main()
