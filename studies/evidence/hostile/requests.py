"""Requests to `idic draw`, in this process: answered, or refused with one message; nothing outside is opened."""

from __future__ import annotations

import asyncio
import json
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import httpx
import numpy as np
import tifffile

from idic.draw.desk import Desk
from idic.draw.server import application
from idic_studies.evidence.hostile.bases import Base
from idic_studies.evidence.hostile.counting import Case, Failure, Scene, copied
from idic_studies.evidence.hostile.runs import _changed, strange

PORT, TOKEN = 4711, "token"
SHAPE = (160, 240)
GET = ("files", "size", "area", "log", "part", "run")
POST = ("mesh", "text", "write", "identify")
MAX_ELEMENT_CALLS = 1.5  # px: the campaign draws no finer mesh, which is legitimate work of a minute


@cache
def _folder() -> Path:
    """A stretched pattern in three frames, with a log."""
    folder = Path(mkdtemp(prefix="idic-hostile-draw-")) / "test"
    (folder / "images").mkdir(parents=True)
    rng = np.random.default_rng(3)
    blocks = np.kron(rng.integers(30, 220, (SHAPE[0] // 4, SHAPE[1] // 4)), np.ones((4, 4)))
    for k in range(3):
        image = np.clip(blocks + rng.normal(0, 2, SHAPE), 0, 255).astype(np.uint8)
        tifffile.imwrite(folder / "images" / f"f_{k}.tif", image)
    rows = [f"{k},{k}.0,{100 * k},{0.04 * k}" for k in range(3)]
    (folder / "loads.csv").write_text("\n".join(["frame,time_s,force_N,grip_displacement_mm", *rows]) + "\n")
    return folder


def _plan() -> dict:
    sketch = {"outline": [[22.0, 32.0], [218.0, 32.0], [212.0, 80.0, 218.0, 128.0], [22.0, 128.0]],
              "holes": [[120.0, 80.0, 15.0]], "element_px": 16.0, "elements": "quads", "mesher": "idic",
              "edge_names": {"LEFT": [4], "RIGHT": [2]}}
    return {"title": 'strip "A"', "images": "images/*.tif", "loads": "loads.csv", "sketch": sketch,
            "kind": "plane_stress", "thickness_mm": 2.0, "pixel_size_mm": 0.1, "origin_px": [22.0, 128.0],
            "rotation_deg": 0.0,
            "motions": {"LEFT": {"kind": "fixed"},
                        "RIGHT": {"kind": "column", "column": "grip_displacement_mm", "component": "x"}},
            "force": {"column": "force_N", "edge": "RIGHT", "component": "x"}, "law": "elastic",
            "parameters": {"E": {"value": 70000.0, "identify": True}, "nu": {"value": 0.3, "identify": True}}}


def requests(base: Base) -> Case:
    """Queries and bodies changed at random; a RUN below `runs/` is a link or a forged one now and then."""
    source = _folder()

    def case(scene: Scene) -> str:
        folder = copied(source, scene.work / "test")
        if scene.rng.integers(4) == 0:
            (folder / "runs").mkdir()
            (folder / "runs" / "run-1").symlink_to(scene.secret)
        desk = Desk(folder)
        words = "refused"
        for _ in range(int(scene.rng.integers(1, 4))):
            method, path, more = _request(scene)
            response = asyncio.run(_asked(desk, method, path, more))
            words = _judged(response, method, path, more) or words
        return words
    return case


def _request(scene: Scene) -> tuple[str, str, dict]:
    if scene.rng.integers(2):
        return _get(scene)
    name = POST[int(scene.rng.integers(len(POST) - 1))]  # without the last, which starts a run
    content: object = {"sketch": _plan()["sketch"], "images": "images/*.tif"} if name == "mesh" else {
        "plan": _plan(), "replace": bool(scene.rng.integers(2))}
    for _ in range(int(scene.rng.integers(0, 3))):
        content = _changed(scene, content)
    _keep_coarse(content)
    body = json.dumps(content).encode()
    if scene.rng.integers(10) == 0:
        body = body[: int(scene.rng.integers(len(body)))] + scene.rng.bytes(int(scene.rng.integers(1, 50)))
    return "POST", f"api/{name}", {"content": body, "headers": {"content-type": "application/json"}}


def _keep_coarse(content: object) -> None:
    """Elements of some pixels, where they are valid at all."""
    if isinstance(content, dict):
        size = content.get("element_px")
        if isinstance(size, (int, float)) and not isinstance(size, bool) and 0 < size < MAX_ELEMENT_CALLS:
            content["element_px"] = MAX_ELEMENT_CALLS
        for value in content.values():
            _keep_coarse(value)


def _get(scene: Scene) -> tuple[str, str, dict]:
    if scene.rng.integers(8) == 0:
        paths = ("..%2f..%2fsecret%2fsecret.txt", "report/..%2f..%2fsecret", "report/run-1", "%2e%2e/secret.txt",
                 "report/%00", "app.js", "", "api/files/", "%7f", "report/" + "a" * 3000)
        return "GET", paths[int(scene.rng.integers(len(paths)))], {}
    name = GET[int(scene.rng.integers(len(GET)))]
    query = {"images": "images/*.tif", "name": "loads.csv" if name == "log" else "run-1", "x0": 0, "y0": 0, "x1": 90,
             "y1": 60, "width": 90, "frame": 0}
    for _ in range(int(scene.rng.integers(0, 3))):
        key = list(query)[int(scene.rng.integers(len(query)))]
        value = strange(scene)
        query[key] = str(value)[:2000].encode("utf-8", "replace").decode()
        if scene.rng.integers(5) == 0:
            del query[key]
    return "GET", f"api/{name}", {"params": query}


async def _asked(desk: Desk, method: str, path: str, more: dict) -> httpx.Response:
    transport = httpx.ASGITransport(app=application(desk, TOKEN, PORT))
    headers = {"origin": f"http://127.0.0.1:{PORT}"}
    async with httpx.AsyncClient(transport=transport, base_url=f"http://127.0.0.1:{PORT}/{TOKEN}/",
                                 headers=headers) as client:
        return await client.request(method, path, **more)


def _judged(response: httpx.Response, method: str, path: str, more: dict) -> str:
    """"done" or nothing; what lies outside never stands in an answer."""
    if response.status_code not in (200, 307, 404, 405, 422):
        raise Failure("failed", f"{method} {path} {str(more)[:600]}: status {response.status_code}")
    if b"what lies outside" in response.content:
        raise Failure("read outside", f"{method} {path}")
    if response.status_code == 422 and not response.json()["what"]:
        raise Failure("messages", f"{method} {path}: {response.text[:300]}")
    return "done" if response.status_code == 200 else ""
