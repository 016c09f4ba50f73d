"""The moving picture of the README, from a page that relights by itself: `python python/docs/first_page.py`.

Exports the built-in still life, as `deltalux view still-life --export` does, turns its light in a headless Chromium,
and takes what the page shows. It needs Chromium and playwright.
"""

from __future__ import annotations

import io
import shutil
import sys
import tempfile
from pathlib import Path

import deltalux as dl
from deltalux.viewer.export import export
from PIL import Image

WIDTH, HEIGHT, FRAMES, DEGREES, MILLISECONDS = 900, 560, 48, 1.5, 80
LIGHT = "hall"
OUTPUT = Path(__file__).parent / "first-page.webp"

# Turns the light by one step with the keyboard's own events, and waits until the page has drawn a frame of it.
STEP = """async ([degrees]) => {
  const turn = document.getElementById("turn");
  turn.value = String((Number(turn.value) + degrees + 360) % 360);
  turn.dispatchEvent(new Event("input", { bubbles: true }));
  for (let k = 0; k < 3; k++) await new Promise((done) => requestAnimationFrame(done));
}"""


def recorded(page: Path) -> list[Image.Image]:
    """What the page shows while its light turns there and back."""
    from playwright.sync_api import sync_playwright

    chromium = next((found for name in ("chromium", "google-chrome") if (found := shutil.which(name))), None)
    if chromium is None:
        sys.exit("expected Chromium on this machine")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        tab = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}, color_scheme="dark")
        tab.goto(page.absolute().as_uri())
        tab.click(f"#light-{LIGHT}")
        tab.wait_for_timeout(1500)
        pictures = []
        for k in range(FRAMES):
            tab.evaluate(STEP, [DEGREES if k < FRAMES // 2 else -DEGREES])
            pictures.append(Image.open(io.BytesIO(tab.screenshot())).convert("RGB"))
        browser.close()
    return pictures


def main() -> None:
    lights = {name: dl.Environment.builtin(name) for name in ("hall", "sky", "studio")}
    with tempfile.TemporaryDirectory() as folder:
        made = export(dl.Scene.builtin("still-life"), Path(folder) / "page", lights)
        print(made)
        first, *others = recorded(made.page)
    first.save(OUTPUT, save_all=True, append_images=others, duration=MILLISECONDS, loop=0, quality=60, method=6)
    print(f"{OUTPUT}: {OUTPUT.stat().st_size / 1e3:,.0f} kB")


if __name__ == "__main__":
    main()
