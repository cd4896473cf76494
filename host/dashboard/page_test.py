#!/usr/bin/env python3
"""Opens the live page of a running fleet in headless Chromium and compares it with the database.

Usage: page_test.py IVFM EMULATED_FLEET [--screenshots FOLDER]
"""
import argparse
import math
import pathlib
import re
import shutil
import sqlite3
import subprocess
import sys
import tempfile
import time

from browser import Browser

SIDE = 32


def merged_tiles(database):
    """(x, y) -> visits and obstacles of the whole fleet, as docs/run_database.md says."""
    connection = sqlite3.connect(f"file:{database}?mode=ro", uri=True)
    tiles = {}
    for layer, x, y, cells in connection.execute("SELECT layer, tile_x, tile_y, cells FROM tiles"):
        tile = tiles.setdefault((x, y), ([0] * SIDE * SIDE, [0] * SIDE * SIDE))
        most = 255 if layer == 0 else 1
        for i, value in enumerate(cells):
            tile[layer][i] = min(most, tile[layer][i] + value)
    connection.close()
    return tiles


def wait_until(what, condition, seconds=60):
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"still not so after {seconds} s: {what}")
        time.sleep(0.2)


class Server:
    def __init__(self, ivfm, database, *more):
        command = [ivfm, "serve", "--listen", "127.0.0.1:0", "--db", database, "--http", "0", *more]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self.udp = re.search(r"listening on (\S+),", self.process.stdout.readline())[1]
        self.link = re.search(r"live page (\S+)", self.process.stdout.readline())[1]

    def stop(self):
        self.process.terminate()
        self.process.wait(20)


def check_drawing(browser, database):
    """Every cell: what the canvas shows against what the database holds."""
    expected = merged_tiles(database)
    assert expected, "the run is empty"
    known = browser.run("return [...ivfmPage.model.tiles.values()].map(t => [t.x, t.y])")
    # A tile of which robots said only that nothing is there need not be sent.
    expected = {place: tile for place, tile in expected.items() if any(tile[0]) or any(tile[1])}
    missing = set(expected) - {tuple(place) for place in known}
    assert not missing, f"tiles {missing} are not drawn"
    palette = browser.run("return ivfmPage.view.palette.map(c => c && '#' + "
                          "c.map(v => v.toString(16).padStart(2, '0')).join(''))")
    wall = browser.run("return '#' + ivfmPage.view.theme.obstacle"
                       ".map(v => v.toString(16).padStart(2, '0')).join('')")
    counted = [c for c in palette[1:browser.run("return ivfmPage.view.scaleEnd") + 1]]
    # Eight bits a channel tell no more than so many steps of the scale apart.
    assert len(set(counted)) >= min(len(counted), 64), "counts of visits share too few colours"
    runs = [colour for i, colour in enumerate(counted) if i == 0 or colour != counted[i - 1]]
    assert len(set(runs)) == len(runs), "counts of visits that are far apart share a colour"
    assert wall not in counted
    cells = 0
    for (x, y), (visits, obstacles) in expected.items():
        drawn = browser.run("return ivfmPage.drawnCells(...arguments)", x, y)
        wanted = [wall if o else palette[v] or "" for v, o in zip(visits, obstacles)]
        wrong = [(i, a, b) for i, (a, b) in enumerate(zip(drawn, wanted)) if a != b]
        assert not wrong, f"tile {x}, {y} is drawn wrongly in {len(wrong)} cells, as {wrong[0]}"
        cells += len(drawn)
    print(f"{cells} cells are drawn as the database says")


def click(browser, selector):
    browser.run("document.querySelector(arguments[0]).click()", selector)


def states(browser):
    return browser.run("return [...ivfmPage.model.robots.values()].map(r => r.state)")


def check_commands(browser):
    click(browser, "[data-command=stop]")
    wait_until("every robot stops", lambda: set(states(browser)) == {"stopped"})
    browser.run("document.getElementById('target').value = '2'")
    click(browser, "[data-command=start]")
    wait_until("robot 2 goes on", lambda: states(browser)[1] == "exploring")
    click(browser, "[data-command=pause]")
    wait_until("robot 2 pauses", lambda: states(browser)[1] == "stopped")
    click(browser, "[data-command=return]")
    wait_until("robot 2 returns", lambda: states(browser)[1] == "returning")
    assert states(browser)[0] == "stopped"
    browser.run("const t = document.getElementById('token'); t.value = 'wrong';"
                "t.dispatchEvent(new Event('input'))")
    click(browser, "[data-command=start]")
    answer = "return document.getElementById('answer').textContent"
    wait_until("a wrong token is refused", lambda: "token" in browser.run(answer))
    assert set(states(browser)) == {"stopped", "returning"}
    print("robots obey, but only with the token")


def check_local_map(browser, database):
    """The i-VFM of robot 1, computed here from the database."""
    click(browser, "#robots tbody button")
    last = "return ivfmPage.local.last"
    wait_until("the local map is shown", lambda: (browser.run(last) or {}).get("robot") == 1)
    local = browser.run(last)
    tiles = merged_tiles(database)
    pool = round(local["cell_m"] / browser.run("return ivfmPage.model.cellM"))
    cell_m = local["cell_m"] / pool
    left, low = (round(c / cell_m) for c in local["origin"])
    robot = browser.run("return [...ivfmPage.model.robots.values()][0]")
    checked = 0
    for i, value in enumerate(local["ivfm"]):
        x0, y0 = left + i % local["side"] * pool, low + i // local["side"] * pool
        if max(abs((x0 + pool / 2) * cell_m - robot["x"]), abs((y0 + pool / 2) * cell_m - robot["y"])) < 0.8:
            continue  # the robot's own disc, and it may have moved since
        total = 0
        for y in range(y0, y0 + pool):
            for x in range(x0, x0 + pool):
                visits, walls = tiles.get((x // SIDE, y // SIDE), (None, None))
                at = y % SIDE * SIDE + x % SIDE
                blocked = walls is not None and walls[at]
                count = visits[at] if visits is not None else 0
                total += 12 if blocked else 10 / (1 + math.exp(-count))
        assert abs(total / pool ** 2 - value) < 0.01, (i, total / pool ** 2, value)
        checked += 1
    assert checked > 900
    assert local["q"] is None or len(local["q"]) == local["side"] ** 2
    print(f"{checked} cells of the local i-VFM are as the database says")


def check_keyboard(browser):
    scale = "return ivfmPage.view.scale"
    press = ("document.getElementById('map').dispatchEvent("
             "new KeyboardEvent('keydown', {key: arguments[0]}))")
    before = browser.run(scale)
    browser.run(press, "+")
    assert browser.run(scale) > before
    browser.run(press, "0")
    unnamed = browser.run("return [...document.querySelectorAll('button, input, select')]"
                          ".filter(e => !(e.textContent.trim() || e.ariaLabel || e.labels?.length))"
                          ".length")
    assert unnamed == 0, "a control has no name"
    print("the keyboard moves the map; every control has a name")


def take_pictures(browser, folder):
    folder.mkdir(parents=True, exist_ok=True)
    for name, width, height, theme in [("page", 1400, 860, "light"), ("page-dark", 1400, 860, "dark"),
                                       ("page-phone", 390, 1500, "light")]:
        browser.size(width, height, mobile=width < 500)
        if browser.run("return document.documentElement.dataset.theme") != theme:
            click(browser, "#theme")
        click(browser, "#fit")
        time.sleep(1)
        wide = browser.run("return document.documentElement.scrollWidth")
        assert wide <= width, f"{name}: the page is {wide} pixels wide"
        browser.screenshot(folder / f"{name}.png")


def run(options, folder):
    database = str(folder / "run.db")
    server = Server(options.ivfm, database)
    fleet = subprocess.Popen([options.fleet, server.udp, "2", "300"])
    browser = None
    try:
        browser = Browser()
        browser.size(1400, 860)
        browser.open(server.link)
        wait_until("two robots", lambda: len(states(browser)) == 2)
        explored = "return ivfmPage.model.exploredM2()"
        wait_until("20 square metres are seen", lambda: browser.run(explored) > 20)
        if options.screenshots:
            take_pictures(browser, options.screenshots)
        check_commands(browser)
        time.sleep(1.5)  # what robots had still to send
        check_drawing(browser, database)
        click(browser, "#theme")
        check_drawing(browser, database)
        check_local_map(browser, database)
        check_keyboard(browser)
        problems = [p for p in browser.problems() if "403" not in p]
        assert not problems, problems
    finally:
        fleet.terminate()
        fleet.wait(10)
        if browser:
            browser.close()
        server.stop()


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("ivfm")
    parser.add_argument("fleet")
    parser.add_argument("--screenshots", type=pathlib.Path)
    options = parser.parse_args()
    if not shutil.which("chromedriver"):
        print("skipped: no chromedriver (Debian package chromium-driver)")
        return 77
    with tempfile.TemporaryDirectory() as folder:
        run(options, pathlib.Path(folder))
    return 0


if __name__ == "__main__":
    sys.exit(main())
