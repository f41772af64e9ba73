"""How soon a page is ready in headless Chromium, and how long a turned frame takes: 4000 and 20 000 sources.

Run as `python benchmarks/pages.py` with the extra `browser`; the second figure is at a quarter of the speed.
"""

import shutil
import tempfile
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright

import sim
from fit.commands.fit import main

FRAME = """() => {
    const sky = document.querySelector("canvas").sky, times = [];
    for (let i = 0; i < 8; i++) {
        sky.projection.rotate([7 * i, 3 * i]);
        const start = performance.now();
        sky.paint();
        times.push(performance.now() - start);
    }
    return times.sort((a, b) => a - b)[4];
}"""


def measure(browser, path, slower):
    """Milliseconds until a page is ready, the least of three, and of a frame."""
    ready = []
    for _ in range(3):
        context = browser.new_context(viewport={"width": 1280, "height": 900})
        tab = context.new_page()
        context.new_cdp_session(tab).send("Emulation.setCPUThrottlingRate", {"rate": slower})
        tab.goto(path.as_uri())
        tab.wait_for_selector("body[data-ready]", timeout=20_000)
        ready.append(float(tab.evaluate("document.body.dataset.ready")))
        frame = tab.evaluate(FRAME)
        context.close()
    return min(ready), frame


if __name__ == "__main__":
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as started:
        browser = started.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
        print("| sources, degree | MB | ready [ms] | at a quarter [ms] | a frame [ms] |\n|---|---|---|---|---|")
        for number, lmax in ((4000, 3), (20_000, 10)):
            table, page = Path(folder, f"{number}.fits"), Path(folder, f"{number}.html")
            quasars = sim.quasars(number, rng=np.random.default_rng(1))
            sim.observe(quasars, sim.spin((1, 2, 3)), rng=2).write(table)
            assert main([str(table), "--lmax", str(lmax), "--html", str(page), "--quiet"]) == 0
            (ready, frame), (slow, _) = measure(browser, page, 1), measure(browser, page, 4)
            print(f"| {number}, {lmax} | {page.stat().st_size / 1e6:.1f} | {ready:.0f} | {slow:.0f} | {frame:.0f} |")
        browser.close()
