"""A headless Chromium, spoken to by its own protocol: how wide a page is, what it asks for, what it looks like."""

from __future__ import annotations

import asyncio
import base64
import json
import shutil
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from tornado.httpclient import AsyncHTTPClient, HTTPRequest
from tornado.websocket import websocket_connect

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
PATIENCE = 60.0  # s, of a machine under load
WIDE = """
(() => { const page = document.documentElement.clientWidth, found = [];
  for (const e of document.querySelectorAll("body *")) {
    const box = e.getBoundingClientRect();
    if (box.right > page + 1 && box.width > 0 && !e.closest(".scroll, .card"))
      found.push(e.tagName + "." + e.className);
  }
  return JSON.stringify({overflow: document.documentElement.scrollWidth - page, wide: found,
    broken: [...document.images].filter(i => !i.complete || !i.naturalWidth).length,
    slides: [...document.querySelectorAll(".slide")].map(s => !s.hidden), text: document.body.innerText}); })()
"""


def find_browser() -> str | None:
    """The first Chromium on the path."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


@dataclass(frozen=True)
class Look:
    """What was seen at one width: px beyond the screen, elements that are, requests that left the file, pictures that
    did not load, messages of the console, visible slides before and after the slider was moved to its start."""

    overflow: int
    wide: list[str]
    requests: list[str]
    broken: int
    errors: list[str]
    slides: list[bool]
    moved: list[bool]
    text: str
    screenshot: bytes
    value: object = None


def look_at(page: Path, width: int, height: int = 900, whole: bool = True, script: str = "", part: str = "") -> Look:
    """Open a file without a network at a width in CSS pixels.

    script : evaluated once the page stands, its value is that of the look; part : selector of what the screenshot shows
    """
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        process = subprocess.Popen(
            [find_browser(), "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
             "--no-first-run", "--disable-background-networking", f"--user-data-dir={profile}",
             "--remote-debugging-port=0", "about:blank"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            return asyncio.run(_look(_port(Path(profile)), page, width, height, whole, script, part))
        finally:
            process.terminate()
            process.wait(PATIENCE)


def _port(profile: Path) -> int:
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        file = profile / "DevToolsActivePort"
        if file.exists() and file.read_text().strip():
            return int(file.read_text().splitlines()[0])
        time.sleep(0.1)
    raise TimeoutError("the browser did not start")


async def _look(port: int, page: Path, width: int, height: int, whole: bool, script: str, part: str) -> Look:
    answer = await AsyncHTTPClient().fetch(HTTPRequest(f"http://127.0.0.1:{port}/json"))
    target = next(t for t in json.loads(answer.body) if t["type"] == "page")
    socket = await websocket_connect(target["webSocketDebuggerUrl"], max_message_size=200_000_000)
    events, number = [], 0

    async def ask(method: str, **parameters):
        nonlocal number
        number += 1
        await socket.write_message(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = json.loads(await asyncio.wait_for(socket.read_message(), PATIENCE))
            if message.get("id") == number:
                assert "error" not in message, message
                return message["result"]
            events.append(message)

    async def value(expression: str):
        return (await ask("Runtime.evaluate", expression=expression, returnByValue=True))["result"].get("value")

    for domain in ("Page", "Network", "Runtime", "Log"):
        await ask(f"{domain}.enable")
    await ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 700)
    await ask("Page.navigate", url=page.resolve().as_uri())
    until = time.monotonic() + PATIENCE
    while await value("document.readyState") != "complete" and time.monotonic() < until:
        await asyncio.sleep(0.1)
    answered = await value(script) if script else None
    found = json.loads(await value(WIDE))
    shot = base64.b64decode((await ask("Page.captureScreenshot", captureBeyondViewport=whole))["data"])
    if part:
        box = json.loads(await value(f"""(() => {{
          const b = document.querySelector({json.dumps(part)}).getBoundingClientRect();
          return JSON.stringify({{x: b.x + scrollX, y: b.y + scrollY, width: b.width, height: b.height,
                                  scale: 1}}); }})()"""))
        shot = base64.b64decode((await ask("Page.captureScreenshot", captureBeyondViewport=True, clip=box))["data"])
    elif whole:
        size = (await ask("Page.getLayoutMetrics"))["cssContentSize"]
        clip = {"x": 0, "y": 0, "width": width, "height": min(size["height"], 16000), "scale": 1}
        shot = base64.b64decode((await ask("Page.captureScreenshot", captureBeyondViewport=True, clip=clip))["data"])
    moved = json.loads(await value(
        'var bar = document.querySelector(".slider input");'
        ' if (bar) { bar.value = 0; bar.dispatchEvent(new Event("input")); }'
        ' JSON.stringify([...document.querySelectorAll(".slide")].map(s => !s.hidden))'))
    asked = [e["params"]["request"]["url"] for e in events if e.get("method") == "Network.requestWillBeSent"]
    errors = [str(e["params"]) for e in events if e.get("method") in ("Runtime.exceptionThrown", "Log.entryAdded")]
    socket.close()
    return Look(found["overflow"], found["wide"], [u for u in asked if not u.startswith(("data:", "file:"))],
                found["broken"], errors, found["slides"], moved, found["text"], shot, answered)
