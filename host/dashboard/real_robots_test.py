#!/usr/bin/env python3
"""The live page's buttons on real agents with simulated bodies: what they do is seen in the truth.

Usage: real_robots_test.py IVFM IVFM_AGENT MODEL
"""
import math
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time

from browser import Browser
from page_test import (Server, check_drawing, check_local_map, click, states, wait_until)

TIME_SCALE = "2"
STANDS_M = 0.01  # the simulator's bodies stand exactly; this is for its last tick


class Robots:
    """Two agents in the corridor, each with a simulated body, lidar and drives."""

    def __init__(self, ivfm, agent, model, server, folder):
        self.truth = folder / "truth.csv"
        command = [ivfm, "sim", "--robots", "2", "--lidar-dir", folder / "lidars",
                   "--time-scale", TIME_SCALE, "--truth", self.truth]
        self.processes = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True)]
        connections = []
        for line in self.processes[0].stdout:
            if line.startswith("robot "):
                connections.append(line.split(": ", 1)[1].split())
            if line.startswith("simulation ready"):
                break
        for number, connection in enumerate(connections, 1):
            command = [agent, *connection, "--server", server, "--robot-id", str(number),
                       "--model", model, "--time-scale", TIME_SCALE, "--telemetry", "off",
                       "--log-file", folder / f"agent{number}.log"]
            self.processes.append(subprocess.Popen(command))

    def place(self, number):
        """Where the robot truly is."""
        rows = [line.split(",") for line in self.truth.read_text().splitlines()[1:]]
        row = next((row for row in reversed(rows) if len(row) == 8 and row[1] == str(number)), None)
        return row and (float(row[2]), float(row[3]))

    def stop(self):
        while self.processes:  # agents before what they drive with
            process = self.processes.pop()
            process.terminate()
            process.wait(30)


def wait_for_state(browser, number, *wanted):
    wait_until(f"robot {number} is {' or '.join(wanted)}",
               lambda: states(browser)[number - 1] in wanted)


def command(browser, name, robot=""):
    browser.run("document.getElementById('target').value = arguments[0]", robot)
    click(browser, f"[data-command={name}]")


def check_stands(robots, *numbers):
    before = [robots.place(number) for number in numbers]
    time.sleep(2)
    for number, place in zip(numbers, before):
        assert math.dist(place, robots.place(number)) < STANDS_M, f"robot {number} moves"


def check_moves(robots, number, metres=0.1):
    before = robots.place(number)
    wait_until(f"robot {number} moves", lambda: math.dist(before, robots.place(number)) > metres)


def check_buttons(browser, robots, starts):
    command(browser, "pause", "2")
    wait_for_state(browser, 2, "stopped")
    time.sleep(0.5)
    check_stands(robots, 2)
    check_moves(robots, 1)
    command(browser, "start", "2")
    wait_for_state(browser, 2, "exploring")
    check_moves(robots, 2)
    command(browser, "return", "1")
    wait_for_state(browser, 1, "returning", "ready")
    wait_until("robot 1 is back", lambda: math.dist(starts[0], robots.place(1)) < 0.4)
    command(browser, "stop")
    wait_until("every robot stops", lambda: set(states(browser)) == {"stopped"})
    time.sleep(0.5)
    check_stands(robots, 1, 2)
    print("pause, start, return and stop move and stop the robots' bodies")


def check_places(browser, robots):
    for robot in browser.run("return [...ivfmPage.model.robots.values()]"):
        error_m = math.dist((robot["x"], robot["y"]), robots.place(robot["id"]))
        assert error_m < 0.1, f"robot {robot['id']} is drawn {error_m:.2f} m beside its place"
    print("the robots are drawn where they are")


def run(ivfm, agent, model, folder):
    server = Server(ivfm, str(folder / "run.db"), "--time-scale", TIME_SCALE)
    robots = browser = None
    try:
        robots = Robots(ivfm, agent, model, server.udp, folder)
        wait_until("the simulation runs", lambda: robots.place(2))
        starts = [robots.place(1), robots.place(2)]
        browser = Browser()
        browser.size(1400, 860)
        browser.open(server.link)
        wait_until("two robots explore", lambda: states(browser) == ["exploring"] * 2)
        for number, start in enumerate(starts, 1):
            wait_until(f"robot {number} leaves its start",
                       lambda: math.dist(start, robots.place(number)) > 0.5)
        check_buttons(browser, robots, starts)
        check_places(browser, robots)
        # Robots that stand still look around, so that their maps still change.
        robots.stop()
        time.sleep(1)
        check_drawing(browser, str(folder / "run.db"))
        check_local_map(browser, str(folder / "run.db"))
        assert not browser.problems(), browser.problems()
    finally:
        if browser:
            browser.close()
        if robots:
            robots.stop()
        server.stop()


def main():
    if not shutil.which("chromedriver"):
        print("skipped: no chromedriver (Debian package chromium-driver)")
        return 77
    ivfm, agent, model = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        run(ivfm, agent, model, pathlib.Path(folder))
    return 0


if __name__ == "__main__":
    sys.exit(main())
