"""The live view from the hand to the eye: latencies in headless Chromium, beside the relighter's own frame time.

    python benches/view.py [a.transport] [--size 512] [--seconds 10] [--soak MINUTES]

Without a transport it makes the built-in still life at --size pixels, haar:32. WebGL is drawn by the processor here: on
a machine with a graphics card the page takes a part of what is printed. It needs Chromium, playwright and websockets.
"""

from __future__ import annotations

import argparse
import resource
import shutil
import sys
import tempfile
import time
from pathlib import Path

import deltalux as dl
import numpy as np

# What VIEWER asks: milliseconds at p95, or frames a second at least.
ASKED = {"input to picture": 33, "environment swap": 150, "exact after release": 250, "first picture": 1000}

# In the page: presses a key on the strip, and waits for the frame that follows to be drawn.
TURN = """async (count) => {
  const strip = document.getElementById("strip"), times = [];
  strip.focus();
  for (let k = 0; k < count; k++) {
    const before = deltalux.frame.n, began = performance.now();
    strip.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight", bubbles: true, cancelable: true }));
    while (!(deltalux.frame.n > before && deltalux.frame.stats) && performance.now() - began < 5000) {
      await new Promise((done) => setTimeout(done, 0));
    }
    deltalux.readPixels();
    times.push(performance.now() - began);
    await new Promise((done) => setTimeout(done, 20));
  }
  return times;
}"""
SWAP = """async (count) => {
  const thumbs = [...document.querySelectorAll('[id^="thumb-"]')], times = [];
  for (let k = 0; k < count; k++) {
    const before = deltalux.frame.n, began = performance.now();
    thumbs[k % thumbs.length].click();
    while (!(deltalux.frame.n > before && deltalux.frame.stats) && performance.now() - began < 5000) {
      await new Promise((done) => setTimeout(done, 0));
    }
    times.push(performance.now() - began);
    await new Promise((done) => setTimeout(done, 150));
  }
  return times;
}"""
REST = """async (count) => {
  const strip = document.getElementById("strip"), times = [];
  for (let k = 0; k < count; k++) {
    const before = deltalux.frame.n;
    strip.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight", bubbles: true, cancelable: true }));
    const began = performance.now();
    while (!(deltalux.frame.n > before && deltalux.frame.exact) && performance.now() - began < 20000) {
      await new Promise((done) => setTimeout(done, 1));
    }
    times.push(performance.now() - began);
  }
  return times;
}"""
DRAG = """async (seconds) => {
  const strip = document.getElementById("strip"), end = performance.now() + 1000 * seconds;
  const seen = new Set();
  while (performance.now() < end) {
    strip.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight", bubbles: true, cancelable: true }));
    await new Promise((done) => requestAnimationFrame(done));
    seen.add(deltalux.frame.n);
  }
  return seen.size / seconds;
}"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("transport", nargs="?")
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--seconds", type=float, default=10.0, help="of dragging without a pause")
    parser.add_argument("--soak", type=float, default=0.0, metavar="MINUTES", help="of dragging, with the memory told")
    chosen = parser.parse_args()
    from playwright.sync_api import sync_playwright

    names = ("chromium", "chromium-browser", "google-chrome")
    chromium = next((path for name in names if (path := shutil.which(name))), None)
    if chromium is None:
        sys.exit("expected Chromium on this machine")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        transport = _transport(chosen, Path(folder))
        own = _own_frames(transport)
        options = ["--no-sandbox", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage"]
        browser = driver.chromium.launch(executable_path=chromium, args=options)
        with dl.view(transport, browser=False, port=0) as view:
            page = browser.new_page(viewport={"width": 1280, "height": 900})
            began = time.perf_counter()
            page.goto(view.url)
            while not page.evaluate("window.deltalux?.frame?.n >= 1"):
                page.wait_for_timeout(5)
            first = [1e3 * (time.perf_counter() - began)]
            page.wait_for_timeout(1500)
            rows = {
                "first picture": first,
                "input to picture": page.evaluate(TURN, 100),
                "environment swap": page.evaluate(SWAP, 30),
                "exact after release": page.evaluate(REST, 15),
            }
            rate = page.evaluate(DRAG, chosen.seconds)
            print(f"{transport!r}, {transport.camera.width} x {transport.camera.height}, {dl.threads()} threads")
            print(f"{'':22} {'p50':>8} {'p95':>8} {'asked':>8}")
            print(f"{'relighter, a frame':22} {np.percentile(own, 50):8.2f} {np.percentile(own, 95):8.2f}   ms, PBI-30")
            for name, times in rows.items():
                p50, p95 = np.percentile(times, [50, 95])
                print(f"{name:22} {p50:8.1f} {p95:8.1f} {ASKED[name]:8} ms")
            print(f"{'pictures while dragged':22} {rate:8.1f}                   /s")
            if chosen.soak:
                _soak(page, 60 * chosen.soak)
        browser.close()


def _transport(chosen: argparse.Namespace, folder: Path) -> dl.Transport:
    if chosen.transport is not None:
        return dl.Transport(chosen.transport)
    scene = dl.Scene.builtin("still-life")
    scene = scene.with_camera(scene.camera.resized(chosen.size, chosen.size))
    return dl.precompute(scene, folder / "bench.transport", columns=dl.Haar(32))


def _own_frames(transport: dl.Transport) -> list[float]:
    """Milliseconds of frames under the same turns, without a picture."""
    env, relighter = dl.Environment.builtin("hall"), dl.Relighter(transport, dl.PerBand(terms=30))
    relighter.step(env)
    return [1e3 * relighter.step(env.rotated(5.0 * k)).seconds for k in range(1, 60)]


def _soak(page: object, seconds: float) -> None:
    """Memory of the program and of the page while the light never stands still."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        page.evaluate(DRAG, 10.0)  # type: ignore[attr-defined]
        heap = page.evaluate("performance.memory?.usedJSHeapSize ?? 0") / 1e6  # type: ignore[attr-defined]
        resident = int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 1e6
        print(f"{end - time.monotonic():6.0f} s to go: program {resident:.0f} MB, page {heap:.0f} MB", flush=True)


if __name__ == "__main__":
    main()
