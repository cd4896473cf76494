#!/usr/bin/env python3
"""Takes the pictures of the live page and of the reports in docs/images, from a demonstration.

Usage: take_pictures.py IVFM FOLDER [arguments of ivfm demo ...]
"""
import pathlib
import re
import subprocess
import sys
import tempfile

from browser import Browser
from page_test import click, take_pictures, wait_until

SECONDS = 45  # of the run, before the first picture


def picture_of_file(browser, file, picture, height):
    """The upper part of an HTML file."""
    browser.size(1180, height)
    browser.open(f"file://{file}")
    browser.screenshot(picture)
    print(picture)


def main():
    ivfm, folder, *arguments = sys.argv[1:]
    folder = pathlib.Path(folder)
    with tempfile.TemporaryDirectory() as out:
        # Long enough for the pictures of the page, which take half a minute of the run.
        command = [ivfm, "demo", "--until", "0.7", "--out", out, *arguments]
        demo = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        browser = None
        try:
            lines = iter(demo.stdout.readline, "")
            link = next(m[1] for m in (re.search(r"live page (\S+)", l) for l in lines) if m)
            browser = Browser()
            browser.size(1400, 860)
            browser.open(link)
            wait_until(f"{SECONDS} s of the run are over",
                       lambda: browser.run("return ivfmPage.model.timeS") > SECONDS)
            click(browser, "#robots tbody button")  # the first robot's local map
            wait_until("it is shown", lambda: browser.run("return ivfmPage.local.last") is not None)
            take_pictures(browser, folder)
            demo.communicate(timeout=300)
            picture_of_file(browser, f"{out}/report.html", folder / "report.png", 1500)
            subprocess.run([ivfm, "log", "can", f"{out}/can.log", "-o", f"{out}/can.html"],
                           check=True, stdout=subprocess.DEVNULL)
            picture_of_file(browser, f"{out}/can.html", folder / "can.png", 900)
        finally:
            if browser:
                browser.close()
            if demo.poll() is None:
                demo.terminate()
                demo.communicate(timeout=60)


if __name__ == "__main__":
    sys.exit(main())
