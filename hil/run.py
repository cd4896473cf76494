#!/usr/bin/env python3
"""Hardware in the loop: the packed robot in an emulated machine with real drivers, the world
outside it. Plays scenarios, judges them by the recorded CAN frames, prints a table."""
import argparse
import concurrent.futures
import os
import pathlib
import re
import shutil
import sqlite3
import subprocess
import sys
import time
import tomllib

import cpio
import judge
import machine

ROOT = machine.ROOT
OUT = ROOT / "out/hil"
IVFM = ROOT / "build/host/host/cli/ivfm"
COMPARE_MAPS = ROOT / "build/host/hil/compare_maps"
ALLOCATE = ("malloc", "calloc", "realloc", "memalign", "posix_memalign", "aligned_alloc")
LIMIT_S = 1200  # real seconds for a machine: a busy host is slow, and nothing else


class MapServer:
    """`ivfm serve` outside the machine, which reaches it as 10.0.2.2, and a key for the robot."""

    def __init__(self, folder):
        self.database = folder / "run.db"
        keys = folder / "keys"
        machine.run(IVFM, "keygen", "--robots", "1", "--out", keys)
        self.robot_key = keys / "robot1.key"
        self.process = subprocess.Popen(
            [IVFM, "serve", "--listen", "127.0.0.1:0", "--db", self.database,
             "--keys", keys / "server.keys"], stdout=subprocess.PIPE, text=True)
        listening = re.match(r"listening on \S+:(\d+),", self.process.stdout.readline())
        if listening is None:
            self.stop()
            raise RuntimeError("the map server does not start")
        self.port = int(listening.group(1))

    def stop(self):
        self.process.terminate()
        self.process.wait()


def first_start_lines(scenario):
    """The commands of docs/first_start.md: all that the machine can obey, or where the key goes."""
    sections = (ROOT / "docs/first_start.md").read_text().split("\n## ")
    install, by_hand = ([line.split("  #")[0].strip() for line in section.splitlines()
                         if line.startswith("    ") and not line.startswith("    apt ")]
                        for section in sections if section.startswith(("3. ", "4. ")))
    if not scenario.get("first_start"):
        return [line for line in install if line.startswith(("install ", "ln "))]
    return install + [f"timeout --preserve-status -s INT 8 {line}" for line in by_hand]


def prepare(scenario, folder, start, server):
    """Writes the machine's initramfs for this scenario."""
    architecture = machine.ARCHITECTURES[scenario["machine"]]
    overlay = folder / "overlay"
    shutil.copytree(ROOT / "hil/machine", overlay)
    build = ROOT / "build" / architecture.preset
    shutil.copy(build / "hil/can_bridge", overlay / "usr/lib/hil/can_bridge")
    package = next((ROOT / "build/packages").glob(f"*_{architecture.debian}.deb"))
    for name in ("bin", "lib"):  # as in the image
        (overlay / "usr" / name).mkdir(exist_ok=True)
        (overlay / name).symlink_to(f"usr/{name}")
    machine.unpack(package, overlay)
    can = scenario.get("can", "can0")
    drives = "can1" if can == "can0" else can
    (overlay / "etc/hil.env").write_text(f"DRIVES={drives}\n")
    config = overlay / "etc/ivfm/agent.toml"
    changes = {"can": f'"socketcan:{can}"', "start": f"[{start}]", "telemetry": '"json"',
               "dump-map": '"/var/lib/ivfm/map"'}
    if server is not None:
        changes |= {"server": f'"10.0.2.2:{server.port}"', "key": '"/var/lib/ivfm/radio.key"'}
        (overlay / "root").mkdir()
        shutil.copy(server.robot_key, overlay / "root/robot1.key")
        (overlay / "etc/hil.first_start").write_text(
            "".join(f"{line}\n" for line in first_start_lines(scenario)))
    lines = []
    for line in config.read_text().splitlines():
        key = line.removeprefix("# ").split(" = ")[0]
        lines.append(f"{key} = {changes[key]}" if key in changes else line)
    config.write_text("\n".join(lines) + "\n")
    # QEMU's adapter is an FTDI, the lidar's a CP2102.
    rule = overlay / "usr/lib/udev/rules.d/60-ivfm-lidar.rules"
    rule.write_text(rule.read_text().replace("10c4", "0403").replace("ea60", "6001"))
    if scenario.get("allocations"):
        (overlay / "etc/hil.probes").write_text(probes(build / "firmware/agent/linux/ivfm-agent"))
    _, base = machine.build_base(architecture)
    with open(folder / "initramfs", "wb") as file:
        file.write(base.read_bytes())
        file.write(cpio.archive(overlay))


def probes(program):
    """Kernel probes (uprobe_events) on every function of a static program that allocates."""
    headers = machine.run("readelf", "-lW", program)
    loads = [[int(word, 16) for word in line.split()[1:5]]
             for line in headers.splitlines() if line.split()[:1] == ["LOAD"]]
    lines = []
    for line in machine.run("nm", program).splitlines():
        address, *_, name = line.split()
        if name not in ALLOCATE:
            continue
        for offset, begin, _, size in loads:
            if begin <= int(address, 16) < begin + size:
                lines.append(f"p:{name} /usr/bin/ivfm-agent:{int(address, 16) - begin + offset:#x}")
    if len(lines) < 3:
        raise RuntimeError(f"{program}: no allocating functions found")
    return "\n".join(lines) + "\n"


def judge_memory(scenario, out):
    """Verdicts on what the kernel says about the agent's memory."""
    verdicts = []
    if "most_resident_mib" in scenario:
        most = scenario["most_resident_mib"]
        peak = re.search(r"VmHWM:\s+(\d+) kB", (out / "agent.status").read_text())
        mib = int(peak.group(1)) / 1024
        verdicts.append(judge.Verdict("resident, most", f"below {most:.0f} MiB", f"{mib:.1f} MiB",
                                      mib < most))
    if scenario.get("allocations"):
        before, _, after = (out / "allocations").read_text().partition("started")
        calls = [sum(re.search(rf" {name}: ", line) is not None
                     for line in text.splitlines() for name in ALLOCATE)
                 for text in (before, after)]
        verdicts.append(judge.Verdict("allocations", "0 after start", f"{calls[1]}",
                                      calls[0] > 0 and after != "" and calls[1] == 0))
    return verdicts


def judge_first_start(out):
    """Verdicts on the lines that a person types in: each must end well."""
    text = (out / "first_start.log").read_text()
    codes = re.findall(r"^exit (\d+)$", text, re.MULTILINE)
    good = codes.count("0")
    return [judge.Verdict("lines obeyed", f"{len(codes)}, all", f"{good}", 0 < len(codes) == good),
            judge.Verdict("by hand", "explores", "yes" if '"exploring"' in text else "no",
                          '"exploring"' in text)]


def judge_server(scenario, folder, server):
    """Verdicts on what the map server knows in the end, and when it heard the robot."""
    compared = subprocess.run([COMPARE_MAPS, server.database, folder / "out/agent.map"], text=True,
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    verdicts = [judge.Verdict("server's map", "the robot's", compared.stdout.strip()[-200:],
                              compared.returncode == 0)]
    database = sqlite3.connect(server.database)
    heard = [uptime_ms / 1000 for uptime_ms, in
             database.execute("SELECT uptime_ms FROM status ORDER BY uptime_ms")]
    database.close()
    least = max((event.get("least_silence_s", 0) for event in scenario.get("event", [])), default=0)
    if least:
        silence = max((b - a for a, b in zip(heard, heard[1:])), default=0)
        verdicts.append(judge.Verdict("no radio for", f"at least {least} s", f"{silence:.1f} s",
                                      silence >= least))
    return verdicts


def play(name):
    """Plays one scenario in its own folder; returns (scenario, verdicts, seconds it took)."""
    path = ROOT / "hil/scenarios" / f"{name}.toml"
    scenario = {"machine": "arm64", **tomllib.loads(path.read_text())}
    folder = OUT / name
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "out").mkdir(parents=True)
    began = time.monotonic()
    with open(folder / "simulator.log", "w") as log:
        simulator = subprocess.Popen(
            [ROOT / "build/host/hil/machine_simulator", path, "--memory", folder / "exchange",
             "--lidar", folder / "lidar", "--monitor", folder / "monitor",
             "--truth", folder / "truth.csv"], stdout=subprocess.PIPE, stderr=log, text=True)
    server = None
    try:
        start = simulator.stdout.readline().removeprefix("start ").strip()
        if not start:
            raise RuntimeError((folder / "simulator.log").read_text())
        server = MapServer(folder) if scenario.get("map_server") else None
        prepare(scenario, folder, start, server)
        subprocess.run(machine.command(machine.ARCHITECTURES[scenario["machine"]], folder),
                       stdin=subprocess.DEVNULL, timeout=LIMIT_S, check=True,
                       stdout=subprocess.DEVNULL)
        verdicts = judge.judge(scenario, (folder / "out/can.log").read_text())
        verdicts += judge_memory(scenario, folder / "out")
        if scenario.get("first_start"):
            verdicts += judge_first_start(folder / "out")
        if server is not None:
            server.stop()
            verdicts += judge_server(scenario, folder, server)
    except (OSError, RuntimeError, ValueError, subprocess.SubprocessError) as error:
        verdicts = [judge.Verdict("the machine runs", "to its end", str(error)[-200:], False)]
    finally:
        if server is not None:
            server.stop()
        simulator.terminate()
        (folder / "simulator.log").write_text(simulator.communicate()[0])
    for leftover in ("initramfs", "overlay", "exchange", "monitor", "keys"):
        target = folder / leftover
        shutil.rmtree(target) if target.is_dir() else target.unlink(missing_ok=True)
    return scenario, verdicts, time.monotonic() - began


def row(*cells):
    print(f"{cells[0]:20} {cells[1]:7} {cells[2]:6} {cells[3]:14} {cells[4]:16} {cells[5]:10} "
          f"{cells[6]}", flush=True)


def main():
    known = sorted(path.stem for path in (ROOT / "hil/scenarios").glob("*.toml"))
    parser = argparse.ArgumentParser(description=__doc__.replace("\n", " "))
    parser.add_argument("scenarios", nargs="*", metavar="SCENARIO", help=", ".join(known))
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="machines at a time")
    arguments = parser.parse_args()
    unknown = set(arguments.scenarios) - set(known)
    if unknown:
        parser.error(f"no such scenario: {', '.join(sorted(unknown))}; there are {', '.join(known)}")
    names = arguments.scenarios or known
    for kind in {tomllib.loads((ROOT / f"hil/scenarios/{name}.toml").read_text())
                 .get("machine", "arm64") for name in names}:
        machine.build_base(machine.ARCHITECTURES[kind])
    row("scenario", "machine", "bus", "what", "required", "measured", "")
    failures = 0
    with concurrent.futures.ThreadPoolExecutor(arguments.jobs) as pool:
        for name, (scenario, verdicts, _) in zip(names, pool.map(play, names)):
            first = (name, scenario["machine"], scenario.get("can", "can0"))
            for verdict in verdicts:
                row(*first, verdict.what, verdict.required, verdict.measured,
                    "pass" if verdict.good else "FAIL")
                first = ("", "", "")
                failures += not verdict.good
    if failures:
        sys.exit(f"hil: {failures} failed; the records lie in {OUT}")
    print(f"hil: {len(names)} scenarios passed; the records lie in {OUT}")


if __name__ == "__main__":
    main()
