#!/usr/bin/env python3
"""The deepest stack a Cortex-M image can need, from its machine code: every function's frame, along
the longest chain of calls from reset. Usage: stack_depth.py IMAGE.elf STACK_BYTES

Frames: all pushes of a function added up, whether or not they happen on one way through it. Calls
through a register: virtual ones (the code loads a slot of a table) may go to that slot of any
virtual table in the image; others to any function whose address lies somewhere in the image. Such
a call that would return into its own chain is not followed, and listed: the core has no recursion.
Fails for direct recursion, for frames of variable size, and when the stack is too small. Interrupt
handlers come on top (the image has none)."""
import bisect
import collections
import re
import subprocess
import sys

TOOLS = "arm-none-eabi-"
REGISTERS = ["r%d" % n for n in range(13)] + ["sp", "lr", "pc"]


def run(tool, *arguments):
    return subprocess.run([TOOLS + tool, *arguments], check=True, text=True,
                          stdout=subprocess.PIPE).stdout


def registers_in(text):
    """How many registers {r4, r5-r7, lr} or {d8-d9} names."""
    count = 0
    for part in text.replace(" ", "").split(","):
        first, _, last = part.partition("-")
        named = {"fp": "r11", "ip": "r12", "sl": "r10"}
        first, last = named.get(first, first), named.get(last, last)
        count += int(last[1:]) - int(first[1:]) + 1 if last else 1
    return count


class Function:
    def __init__(self, address, name):
        self.address, self.name = address, name
        self.frame = 0
        self.calls = set()         # addresses
        self.slots = set()         # of virtual calls, in bytes
        self.calls_anything = False
        self.variable = False


def decode(function, instructions):
    loads = {}  # register -> offset of the last load into it
    for mnemonic, operands in instructions:
        mnemonic = mnemonic.removesuffix(".n").removesuffix(".w")
        if mnemonic in ("push", "stmdb") and (mnemonic == "push" or operands.startswith("sp!")):
            function.frame += 4 * registers_in(operands[operands.index("{") + 1:-1])
        elif mnemonic == "vpush" or mnemonic.startswith("vstmdb") and operands.startswith("sp!"):
            names = operands[operands.index("{") + 1:-1]
            function.frame += (8 if names.startswith("d") else 4) * registers_in(names)
        elif mnemonic in ("sub", "subw") and re.match(r"sp, (sp, )?", operands):
            amount = re.search(r"#(\d+)", operands)
            function.variable |= amount is None
            function.frame += int(amount.group(1)) if amount else 0
        elif store := re.match(r"\w+, (?:\w+, )?\[sp, #-(\d+)\]!", operands):
            function.frame += int(store.group(1))
        elif load := re.match(r"(\w+), \[\w+(?:, #(\d+))?\]$", operands):
            if mnemonic == "ldr":
                loads[load.group(1)] = int(load.group(2) or 0)
        elif target := re.match(r"([0-9a-f]+) <", operands):
            if mnemonic.startswith("b") or mnemonic in ("cbz", "cbnz"):
                function.calls.add(int(target.group(1), 16))
        elif mnemonic == "blx" or mnemonic == "bx" and operands != "lr":
            if operands in loads:
                function.slots.add(loads[operands])
            else:
                function.calls_anything = True


def read_code(elf):
    """Functions by address."""
    functions, current, instructions = {}, None, []
    for line in run("objdump", "-d", "--no-show-raw-insn", elf).splitlines() + ["0 <end>:"]:
        if head := re.match(r"([0-9a-f]+) <(.+)>:$", line):
            if current:
                decode(current, instructions)
            current, instructions = Function(int(head.group(1), 16), head.group(2)), []
            if head.group(2) != "end":
                functions[current.address] = current
        elif code := re.match(r"\s+[0-9a-f]+:\t(\S+)\t?([^@;]*)", line):
            instructions.append((code.group(1), code.group(2).strip()))
    for function in functions.values():  # a branch into its own body is no call
        starts = sorted(functions)
        end = starts[bisect.bisect(starts, function.address):][:1]
        inside = range(function.address, end[0] if end else 2**32)
        function.calls = {call for call in function.calls
                          if call not in inside or call == function.address}
    return functions


def read_words(elf, functions):
    """Addresses of functions that lie as data in the image, and virtual tables' slots."""
    words = {}
    for section in (".vectors", ".text", ".rodata", ".init_array", ".data"):
        dump = subprocess.run([TOOLS + "objdump", "-s", "-j", section, elf], text=True,
                              capture_output=True).stdout
        for line in dump.splitlines():
            if not (row := re.match(r" ([0-9a-f]+) ((?:[0-9a-f]{8} ?){1,4}) ", line)):
                continue
            for i, word in enumerate(row.group(2).split()):
                words[int(row.group(1), 16) + 4 * i] = int.from_bytes(bytes.fromhex(word), "little")
    taken = {word - 1 for word in words.values() if word % 2 and word - 1 in functions}
    slots = collections.defaultdict(set)
    for line in run("nm", "-S", elf).splitlines():
        fields = line.split()
        if len(fields) == 4 and fields[3].startswith("_ZTV"):
            begin, size = int(fields[0], 16), int(fields[1], 16)
            for slot in range(0, size - 8, 4):  # after the offset to top and the type information
                target = words.get(begin + 8 + slot, 0) - 1
                if target in functions:
                    slots[slot].add(target)
    return taken, slots


class Search:
    """Longest way through the graph of calls."""

    def __init__(self, functions, taken, slots):
        self.functions, self.taken, self.slots = functions, taken, slots
        self.done, self.chain, self.cut = {}, [], set()

    def targets(self, function):
        for call in function.calls:
            if call in self.functions:
                yield call, True
        for slot in function.slots:
            # A slot that no table has is a plain pointer to a function.
            for target in self.slots.get(slot) or self.taken:
                yield target, False
        if function.calls_anything:
            for target in self.taken:
                yield target, False

    def deepest(self, address):
        """(bytes, [names]) of the worst chain from this function on."""
        if address in self.done:
            return self.done[address]
        function = self.functions[address]
        self.chain.append(address)
        best = (0, [])
        for target, direct in self.targets(function):
            if target in self.chain:
                if direct:
                    sys.exit(f"{function.name} calls itself, through "
                             f"{self.functions[target].name}: no bound for the stack")
                self.cut.add((function.name, self.functions[target].name))
                continue
            best = max(best, self.deepest(target))
        self.chain.pop()
        if function.variable:
            sys.exit(f"{function.name} has a frame of variable size: no bound for the stack")
        self.done[address] = (function.frame + best[0],
                              [f"{function.frame:6}  {function.name}"] + best[1])
        return self.done[address]


def main():
    elf, reserved = sys.argv[1], int(sys.argv[2])
    sys.setrecursionlimit(10_000)
    functions = read_code(elf)
    search = Search(functions, *read_words(elf, functions))
    start = next(f for f in functions.values() if f.name == "ivfm_reset")
    depth, chain = search.deepest(start.address)
    names = subprocess.run([TOOLS + "c++filt", "-p"], input="\n".join(chain), text=True,
                           stdout=subprocess.PIPE, check=True).stdout
    print("deepest stack, bytes of each frame:\n" + names)
    for caller, target in sorted(search.cut):
        print(f"not followed, as it would be recursion: {caller} -> {target}")
    print(f"stack: at most {depth} of {reserved} bytes")
    if depth > reserved:
        sys.exit(f"{elf}: the stack can need {depth} bytes and has {reserved}")


main()
