#!/usr/bin/env python3
"""Takes the pictures of the live page in docs/images while a demonstration runs.

Usage: take_pictures.py IVFM FOLDER [arguments of ivfm demo ...]
"""
import pathlib
import re
import subprocess
import sys
import tempfile
import time

from browser import Browser
from page_test import take_pictures

SECONDS = 25  # of the demonstration, before the first picture


def main():
    ivfm, folder, *arguments = sys.argv[1:]
    with tempfile.TemporaryDirectory() as out:
        command = [ivfm, "demo", "--out", out, "--until", "0.9", *arguments]
        demo = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        browser = None
        try:
            lines = iter(demo.stdout.readline, "")
            link = next(m[1] for m in (re.search(r"live page (\S+)", l) for l in lines) if m)
            browser = Browser()
            browser.size(1400, 860)
            browser.open(link)
            time.sleep(SECONDS)
            take_pictures(browser, pathlib.Path(folder))
        finally:
            if browser:
                browser.close()
            demo.terminate()
            demo.communicate(timeout=60)


if __name__ == "__main__":
    sys.exit(main())
