#!/usr/bin/env python3
"""Measures the live page with 20 robots on a map of 125 x 100 m: updates, bytes and work a second.

Usage: measure_page.py IVFM EMULATED_FLEET SYNTHESIZE_RUN
"""
import pathlib
import subprocess
import sys
import tempfile
import time

from browser import Browser
from page_test import Server, states, wait_until

SECONDS = 20
COUNT = """
const model = ivfmPage.model, take = model.take.bind(model);
window.measured = {answers: 0, bytes: 0, tiles: 0, busyMs: 0, longest: 0, frames: 0};
model.take = buffer => {
  const begin = performance.now(), news = take(buffer), ms = performance.now() - begin;
  measured.answers += 1; measured.bytes += buffer.byteLength; measured.tiles += news?.tiles.length ?? 0;
  measured.busyMs += ms; measured.longest = Math.max(measured.longest, ms);
  return news;
};
const frame = () => { measured.frames += 1; requestAnimationFrame(frame); };
requestAnimationFrame(frame);
"""


def main():
    ivfm, fleet_program, synthesize = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        database = str(pathlib.Path(folder) / "run.db")
        subprocess.run([synthesize, database, "20", "2000"], check=True)
        server = Server(ivfm, database)
        fleet = subprocess.Popen([fleet_program, server.udp, "20", "300"])
        browser = Browser()
        try:
            browser.size(1400, 860)
            browser.open(server.link)
            wait_until("20 robots drive", lambda: states(browser).count("exploring") == 20)
            browser.run(COUNT)
            time.sleep(SECONDS)
            m = browser.run("return {...measured, map: ivfmPage.model.tiles.size}")
            print(f"{m['map']} tiles of 1.6 x 1.6 m; {m['answers'] / SECONDS:.1f} answers a second of "
                  f"{m['bytes'] / m['answers'] / 1024:.1f} KiB and {m['tiles'] / m['answers']:.1f} "
                  f"tiles; {m['frames'] / SECONDS:.0f} frames a second; taking one over "
                  f"{m['busyMs'] / m['answers']:.1f} ms, longest {m['longest']:.0f} ms")
        finally:
            browser.close()
            fleet.terminate()
            fleet.wait(10)
            server.stop()


if __name__ == "__main__":
    sys.exit(main())
