"""A headless Chromium that a test drives: real pointer and key events over the DevTools protocol, clicks counted."""

from __future__ import annotations

import asyncio
import base64
import json
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

from tornado.httpclient import AsyncHTTPClient, HTTPRequest
from tornado.websocket import websocket_connect

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
PATIENCE = 60.0  # s, of a machine under load
KEYS = {"Enter": (13, "\r"), "Tab": (9, ""), "Escape": (27, ""), "Delete": (46, ""), "Home": (36, ""), "End": (35, ""),
        "ArrowUp": (38, ""),
        "ArrowRight": (39, ""), "ArrowDown": (40, ""), "ArrowLeft": (37, "")}


def find_browser() -> str | None:
    return next((path for name in NAMES if (path := shutil.which(name))), None)


class Browser:
    """One page. `clicks` counts pointer presses; typing does not count."""

    def __init__(self, address: str, width: int = 1440, height: int = 900):
        self.loop = asyncio.new_event_loop()
        self.profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self.process = subprocess.Popen(
            [find_browser(), "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
             "--no-first-run",
             "--disable-background-networking", f"--user-data-dir={self.profile.name}", "--remote-debugging-port=0",
             "about:blank"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.clicks, self.number, self.events = 0, 0, []
        self.loop.run_until_complete(self._connect())
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.ask(f"{domain}.enable")
        self.size(width, height)
        self.began = time.monotonic()
        self.ask("Page.navigate", url=address)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()
        self.process.terminate()
        self.process.wait(PATIENCE)
        self.loop.close()
        self.profile.cleanup()

    async def _connect(self):
        file = Path(self.profile.name) / "DevToolsActivePort"
        until = time.monotonic() + PATIENCE
        while not (file.exists() and file.read_text().strip()):
            if time.monotonic() > until:
                raise TimeoutError("the browser did not start")
            await asyncio.sleep(0.05)
        port = file.read_text().splitlines()[0]
        answer = await AsyncHTTPClient().fetch(HTTPRequest(f"http://127.0.0.1:{port}/json"))
        target = next(t for t in json.loads(answer.body) if t["type"] == "page")
        self.socket = await websocket_connect(target["webSocketDebuggerUrl"], max_message_size=200_000_000)

    def ask(self, method: str, **parameters):
        return self.loop.run_until_complete(self._ask(method, parameters))

    async def _ask(self, method, parameters):
        self.number += 1
        await self.socket.write_message(json.dumps({"id": self.number, "method": method, "params": parameters}))
        while True:
            message = json.loads(await asyncio.wait_for(self.socket.read_message(), PATIENCE))
            if message.get("id") == self.number:
                assert "error" not in message, message
                return message["result"]
            self.events.append(message)

    def value(self, expression: str):
        """What a JavaScript expression gives."""
        found = self.ask("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def wait(self, expression: str, patience: float = PATIENCE):
        """Wait until an expression is true; returns its value."""
        until = time.monotonic() + patience
        while not (found := self.value(expression)):
            if time.monotonic() > until:
                raise TimeoutError(f"{expression}\n{self.value('document.body.innerText')}")
            time.sleep(0.05)
        return found

    @property
    def errors(self) -> list[str]:
        """Exceptions and messages of the console, but for answers with status 422: the page tells these itself."""
        self.value("1")
        told = [e["params"] for e in self.events if e.get("method") in ("Runtime.exceptionThrown", "Log.entryAdded")]
        return [json.dumps(entry)[:600] for entry in told
                if "status of 422" not in entry.get("entry", {}).get("text", "")]

    def size(self, width: int, height: int):
        self.ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1,
                 mobile=width < 700)

    def click_at(self, x: float, y: float):
        """One press of the pointer at a place of the window."""
        self.clicks += 1
        for kind in ("mousePressed", "mouseReleased"):
            self.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1,
                     buttons=1 if kind == "mousePressed" else 0)

    def click(self, selector: str):
        """One press on an element, which is scrolled into view."""
        x, y = self.value(f"""(() => {{ const e = document.querySelector({selector!r});
            e.scrollIntoView({{block: "center"}});
            const b = e.getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]; }})()""")
        self.click_at(x, y)

    def on_image(self, x: float, y: float) -> tuple[float, float]:
        """The place of the window where a pixel of the image is shown."""
        return tuple(self.value(f"window.placeOnScreen([{x}, {y}])"))

    def click_image(self, x: float, y: float):
        self.click_at(*self.on_image(x, y))

    def drag(self, start: tuple[float, float], end: tuple[float, float]):
        """Press, move in steps, let go; counts as a click."""
        self.clicks += 1
        self.ask("Input.dispatchMouseEvent", type="mousePressed", x=start[0], y=start[1], button="left", clickCount=1,
                 buttons=1)
        for k in range(1, 6):
            x, y = (a + (b - a) * k / 5 for a, b in zip(start, end, strict=True))
            self.ask("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y, button="left", buttons=1)
        self.ask("Input.dispatchMouseEvent", type="mouseReleased", x=end[0], y=end[1], button="left", clickCount=1)

    def type(self, text: str):
        self.ask("Input.insertText", text=text)

    def key(self, name: str, shift: bool = False):
        code, text = KEYS.get(name, (ord(name.upper()) if len(name) == 1 else 0, name if len(name) == 1 else ""))
        more = {"text": text} if text else {}
        for kind in ("keyDown", "keyUp"):
            self.ask("Input.dispatchKeyEvent", type=kind, key=name, windowsVirtualKeyCode=code,
                     modifiers=8 if shift else 0,
                     **(more if kind == "keyDown" else {}))

    def choose(self, selector: str, value: str):
        """Open a list with a click and pick an entry with another one; headless browsers show no list, so that the
        value is set."""
        self.clicks += 2
        self.value(f"""(() => {{ const e = document.querySelector({selector!r}); e.value = {value!r};
            e.dispatchEvent(new Event("change", {{bubbles: true}})); }})()""")

    def screenshot(self, file: Path, whole: bool = False):
        Path(file).write_bytes(base64.b64decode(self.ask("Page.captureScreenshot",
                                                         captureBeyondViewport=whole)["data"]))

    def too_wide(self) -> list[str]:
        """Elements that reach beyond the right edge of the window."""
        return self.value("""(() => { const w = document.documentElement.clientWidth, found = [];
            for (const e of document.querySelectorAll("body *")) { const b = e.getBoundingClientRect();
              if (b.width > 0 && b.right > w + 1 && !e.closest("#tools"))
                found.push(e.tagName + "#" + e.id + "." + e.className); }
            if (document.documentElement.scrollWidth > w) found.push("the page"); return found; })()""")
