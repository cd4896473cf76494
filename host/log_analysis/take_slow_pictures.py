#!/usr/bin/env python3
"""Pictures of the reports of three slow runs, made without robots, for docs/log.md.

Usage: take_slow_pictures.py IVFM SYNTHESIZE_RUN FOLDER
"""
import pathlib
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "dashboard"))
from browser import Browser  # noqa: E402


def main():
    ivfm, synthesize, folder = sys.argv[1:]
    browser = Browser()
    try:
        with tempfile.TemporaryDirectory() as out:
            for trouble in ("blocked", "lossy", "meeting"):
                run, page = f"{out}/{trouble}.db", f"{out}/{trouble}.html"
                subprocess.run([synthesize, run, "2", "300", trouble], check=True)
                subprocess.run([ivfm, "log", "report", run, "-o", page], check=True)
                browser.size(1180, 900)
                browser.open(f"file://{page}")
                # What cost time, and what each robot did when.
                browser.run("""
                  const wanted = ['What cost time', 'Where the time went', 'What happened when'];
                  let keep = true;
                  for (const node of [...document.querySelector('main').children]) {
                    if (node.tagName === 'H1') keep = true;
                    else if (node.tagName === 'H2') keep = wanted.includes(node.textContent);
                    else if (node.className === 'figures') keep = false;
                    if (!keep) node.remove();
                  }""")
                height = browser.run("return document.querySelector('main').scrollHeight")
                browser.size(1180, height)
                browser.screenshot(f"{folder}/slow-{trouble}.png")
    finally:
        browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
