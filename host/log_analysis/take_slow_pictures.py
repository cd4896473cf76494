#!/usr/bin/env python3
"""Real runs with one trouble each, and pictures of what their reports say of it, for docs/log.md.

Usage: take_slow_pictures.py IVFM FOLDER [TROUBLE ...]
Prints what each report gives as reasons. Wants a machine with little else to do: robots whose
drives are served too late go into fault, which the reports then tell as well.
"""
import pathlib
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "dashboard"))
from browser import Browser  # noqa: E402

CELL_M = 0.05
# Worlds of rooms: left, low, right and high edge in metres.
HALL = [(.5, 3.5, 13.5, 5.5), (1, .5, 5, 3), (2.6, 2.9, 3.6, 3.6), (8, .5, 12, 3),
        (9.6, 2.9, 10.6, 3.6), (1, 6, 6, 8.5), (3, 5.4, 4, 6.1)]
CLOSET = (9, 6, 11.5, 8)  # beside the hall, without a door
# A niche whose only way out, in its middle, each of the two robots in it closes to the other.
YARD = [(3.05, 4, 3.95, 4.5), (3.25, 4.4, 3.75, 6), (.5, 5.9, 7, 8), (6.9, 6.5, 9, 7.2), (8.9, 2, 12, 8),
        (11.9, 2.5, 14, 3.2), (13.9, .5, 17, 6)]
RUNS = {
    "blocked": ([*HALL, CLOSET], ["--start=2,4.5,0", "--start=10.2,7,0", "--until", "0.9",
                                  "--time-limit", "150"]),
    "lossy": (HALL, ["--start=2,4.5,0", "--start=3,4.5,0", "--until", "0.9", "--time-limit", "150",
                     "--radio", "drop=0.5,partition@20s+30s"]),
    "meeting": (YARD, ["--robots", "3", "--start=3.2,4.25,0", "--start=3.8,4.25,180",
                       "--start=1.5,7,0", "--until", "0.9", "--time-limit", "150"]),
}


def write_world(path, rooms):
    width = round((max(room[2] for room in rooms) + .5) / CELL_M)
    height = round((max(room[3] for room in rooms) + .5) / CELL_M)
    rows = [bytearray(width) for _ in range(height)]
    for edges in rooms:
        left, low, right, high = (round(edge / CELL_M) for edge in edges)
        for row in rows[low:high]:
            row[left:right] = b"\xfe" * (right - left)
    path.write_bytes(b"P5\n%d %d\n255\n" % (width, height) + b"".join(reversed(rows)))


def picture(browser, page, file):
    browser.size(1180, 900)
    browser.open(f"file://{page}")
    browser.run("""
      const wanted = ['What cost time', 'Map', 'Where the time went', 'What happened when'];
      let keep = true;
      for (const node of [...document.querySelector('main').children]) {
        if (node.tagName === 'H1') keep = true;
        else if (node.tagName === 'H2') keep = wanted.includes(node.textContent);
        if (!keep) node.remove();
      }""")
    browser.size(1180, browser.run("return document.querySelector('main').scrollHeight"))
    browser.screenshot(file)
    return browser.run("return document.querySelector('.reasons')?.innerText ?? 'no reasons'")


def main():
    ivfm, folder, *wanted = sys.argv[1:]
    browser = Browser()
    try:
        with tempfile.TemporaryDirectory() as scratch:
            for trouble in wanted or RUNS:
                rooms, arguments = RUNS[trouble]
                world, out = pathlib.Path(scratch) / f"{trouble}.pgm", f"{scratch}/{trouble}"
                write_world(world, rooms)
                # Its exit code says that the goal was missed, which is the point.
                subprocess.run([ivfm, "demo", "--world", world, "--resolution", str(CELL_M),
                                "--time-scale", "2", "--out", out, *arguments],
                               stdout=subprocess.DEVNULL)
                text = picture(browser, f"{out}/report.html", f"{folder}/slow-{trouble}.png")
                print(f"== {trouble}\n{text}", flush=True)
    finally:
        browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
