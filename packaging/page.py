#!/usr/bin/env python3
"""Times of a web page of `export` in headless Chromium without a graphics card: `packaging/page.py SCENE.html [640,360]`.

Printed are the milliseconds from opening to the first picture, and the pictures a second of eight seconds of orbiting. Each
picture is read back, so that none is only queued.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

MEASURE = """<script>
const waiting = setInterval(() => {
  if (![...document.querySelectorAll("body *")].some((e) => !e.children.length && e.textContent.startsWith("Drag: orbit"))) return;
  clearInterval(waiting);
  requestAnimationFrame(() => {
    const canvas = document.querySelector("canvas"), gl = canvas.getContext("webgl2"), pixel = new Uint8Array(4);
    const finish = () => gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    finish();
    console.log(`first picture: ${performance.now().toFixed(0)} ms`);
    canvas.setPointerCapture = () => {};
    let x = 300, n = 0;
    const event = (type) => canvas.dispatchEvent(new PointerEvent(type, { pointerId: 1, button: 0, buttons: 1, clientX: x, clientY: 180 }));
    event("pointerdown");
    const start = performance.now();
    const turn = () => {
      const passed = performance.now() - start;
      if (passed > 8000) { console.log(`orbiting: ${(1000 * n / passed).toFixed(1)} pictures a second`); return; }
      n++; x += 3; event("pointermove"); finish(); requestAnimationFrame(turn);
    };
    requestAnimationFrame(turn);
  });
}, 5);
</script></body>"""


def main():
    page, size = Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else "640,360"
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        measured = Path(folder) / "page.html"
        text = page.read_text()
        # The scene is the last element, so the script finds all others.
        measured.write_text(text.replace("</body>", MEASURE) if "</body>" in text else text + MEASURE)
        browser = ["chromium", "--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
                   "--enable-logging=stderr", "--remote-debugging-port=0", f"--user-data-dir={folder}/profile",
                   f"--window-size={size}", measured.as_uri()]
        with subprocess.Popen(browser, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as running:
            for line in running.stderr:
                if found := re.search(r"first picture: \d+ ms|orbiting: [\d.]+ pictures a second|Cannot show[^\"]*", line):
                    print(found[0], flush=True)
                    if not found[0].startswith("first"):
                        break
            running.terminate()


if __name__ == "__main__":
    main()
