"""The web server of `idic draw`: loopback only, one random token, no request under another name or from another page.

Every address begins with the token: /TOKEN/… A page of another origin cannot know it, and a request that names another
host (DNS rebinding) or another origin is refused before anything is read. See docs/safety.md.
"""

from __future__ import annotations

import hmac
import json
import secrets
import socket
import threading
import time
from collections.abc import Awaitable, Callable
from importlib.resources import files
from pathlib import Path

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from idic.draw.desk import Desk
from idic.draw.folder import run_folder
from idic.draw.watch import state_of
from idic.errors import InputError
from idic.inside import read_inside

HOST = "127.0.0.1"
GRACE_S, LOOK_S = 2, 0.2  # for answers on their way; between two looks at whether the server ends
MAX_BODY_BYTES = 4_000_000
KINDS = {".html": "text/html; charset=utf-8", ".js": "text/javascript; charset=utf-8",
         ".css": "text/css; charset=utf-8",
         ".svg": "image/svg+xml"}
HEADERS = {"Content-Security-Policy": "default-src 'self'; img-src 'self' blob: data:; frame-ancestors 'none'; "
                                      "base-uri 'none'",
           "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer", "Cache-Control": "no-store",
           "Cross-Origin-Resource-Policy": "same-origin"}
# what fields that no page sends end in: numbers beyond an index, texts where numbers are, names that are no file's
_STRANGE = (KeyError, TypeError, ValueError, AttributeError, ArithmeticError, IndexError, RecursionError, MemoryError)
REPORT = ("sandbox allow-scripts allow-popups; default-src 'none'; script-src 'unsafe-inline'; style-src "
          "'unsafe-inline'; img-src data:")


def open_socket(port: int) -> socket.socket:
    """A listening socket of this machine; port 0: a free one."""
    place = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        place.bind((HOST, port))
    except OSError as problem:
        place.close()
        raise InputError("the port cannot be used", key="--port", expected="a free port of this machine",
                         found=f"{port}: {problem.strerror}",
                         remedy="leave out --port: idic then takes a free one") from None
    place.listen(128)
    return place


def serve(folder: Path, place: socket.socket, token: str, abandon: Callable[[bool], None]) -> None:
    """Answer until the process is interrupted.

    abandon : ends the process at once, where an answer is still computed some seconds later: Python waits for its
        threads. It takes whether this function has returned. Files are written whole or not at all, and runs are
        processes of their own.
    """
    port = place.getsockname()[1]
    desk = Desk(folder)
    threading.Thread(target=desk.read_ahead, daemon=True).start()
    config = uvicorn.Config(application(desk, token, port), log_level="critical", lifespan="off", access_log=False,
                            timeout_graceful_shutdown=GRACE_S)
    server, ended = uvicorn.Server(config), threading.Event()
    threading.Thread(target=_end_for_certain, args=(server, ended, abandon), daemon=True).start()
    try:
        server.run(sockets=[place])
    finally:
        ended.set()


def _end_for_certain(server: uvicorn.Server, ended: threading.Event, abandon: Callable[[bool], None]) -> None:
    while not server.should_exit:
        time.sleep(LOOK_S)
    time.sleep(2 * GRACE_S)
    abandon(ended.is_set())


def new_token() -> str:
    return secrets.token_urlsafe(24)


def application(desk: Desk, token: str, port: int) -> Callable:
    """The ASGI application for the folder of a desk."""
    folder = desk.folder
    guard = Guard(token, port)
    return Starlette(routes=[
        Route("/{token}/", guard(page)),
        Route("/{token}/{file}", guard(page)),
        Route("/{token}/api/files", guard(answer(lambda r: desk.files()))),
        Route("/{token}/api/size", guard(answer(lambda r: desk.size(r["images"])))),
        Route("/{token}/api/area", guard(answer(lambda r: desk.area(r["images"])))),
        Route("/{token}/api/log", guard(answer(lambda r: desk.log(r["name"], r["images"])))),
        Route("/{token}/api/part", guard(picture(desk))),
        Route("/{token}/api/mesh", guard(answer(lambda r: desk.mesh(r["sketch"], r["images"]))), methods=["POST"]),
        Route("/{token}/api/text", guard(answer(lambda r: desk.text(r["plan"]))), methods=["POST"]),
        Route("/{token}/api/write", guard(answer(lambda r: desk.write(r["plan"], r["replace"] is True))),
              methods=["POST"]),
        Route("/{token}/api/identify", guard(answer(lambda r: desk.identify(r["name"]))), methods=["POST"]),
        Route("/{token}/api/run", guard(answer(lambda r: state_of(folder, r["name"])))),
        Route("/{token}/report/{name}", guard(report(folder))),
    ])


class Guard:
    """Lets a request pass that names this host, this token and, if it states one, this origin."""

    def __init__(self, token: str, port: int):
        self.token = token
        self.hosts = {f"{name}:{port}" for name in (HOST, "localhost")}

    def __call__(self, answer: Callable[[Request], Awaitable[Response]]) -> Callable:
        async def guarded(request: Request) -> Response:
            if not self.admits(request):
                return Response("not found", 404, headers=HEADERS)
            response = await answer(request)
            for name, value in HEADERS.items():
                response.headers.setdefault(name, value)
            return response
        return guarded

    def admits(self, request: Request) -> bool:
        origin, site = request.headers.get("origin"), request.headers.get("sec-fetch-site", "same-origin")
        if request.headers.get("host", "") not in self.hosts:
            return False
        if not hmac.compare_digest(request.path_params["token"].encode(), self.token.encode()):
            return False
        if request.method == "POST" and origin is None:
            return False
        return (origin is None
                or origin in {f"http://{host}" for host in self.hosts}) and site in ("same-origin", "none")


async def page(request: Request) -> Response:
    """The files of the page; the name is looked up in the package, never in a folder."""
    name = request.path_params.get("file", "index.html")
    for entry in files("idic.draw").joinpath("page").iterdir():
        if entry.name == name and Path(name).suffix in KINDS:
            return Response(entry.read_bytes(), media_type=KINDS[Path(name).suffix])
    return Response("not found", 404)


def answer(make: Callable[[dict], dict]) -> Callable[[Request], Awaitable[Response]]:
    """A JSON answer from the fields of the query or of the JSON body; input errors as {"what": …}, status 422."""
    async def answered(request: Request) -> Response:
        try:
            return JSONResponse(await run_in_threadpool(make, await _fields(request)))
        except InputError as error:
            return _refusal(error)
        except _STRANGE as problem:
            return _refusal(InputError("a field is missing, or none that the page sends", expected="the page's fields",
                                       found=str(problem)[:80], remedy="load the page again"))
    return answered


def _refusal(error: InputError) -> JSONResponse:
    return JSONResponse({"what": error.what, "key": error.key and str(error.key), "expected": error.expected,
                         "found": error.found, "remedy": error.remedy}, 422)


async def _fields(request: Request) -> dict:
    if request.method != "POST":
        return dict(request.query_params)
    if not request.headers.get("content-type", "").startswith("application/json"):
        raise InputError("not JSON", expected="application/json", found="something else", remedy="load the page again")
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > MAX_BODY_BYTES:
            raise InputError("the drawing is too large", expected=f"{MAX_BODY_BYTES} bytes", found="more",
                             remedy="draw fewer points")
    try:
        fields = json.loads(body, parse_constant=_no_number)
        json.dumps(fields, ensure_ascii=False).encode()  # halves of characters are no text
    except (ValueError, RecursionError):
        fields = None
    if not isinstance(fields, dict):
        raise InputError("not a JSON object", expected="an object", found="something else",
                         remedy="load the page again")
    return fields


def _no_number(text: str) -> float:
    raise ValueError(f"{text} is no number of JSON")


def picture(desk: Desk) -> Callable[[Request], Awaitable[Response]]:
    """A part of a frame as a JPEG: images, frame, x0, y0, x1, y1, width."""
    def made(query: dict) -> bytes:
        x0, y0, x1, y1 = (float(query[name]) for name in ("x0", "y0", "x1", "y1"))
        if not all(abs(value) < 1e9 for value in (x0, y0, x1, y1)):  # NaN too
            raise ValueError("no part of an image")
        return desk.pictures(query["images"]).part(int(query.get("frame", 0)), (x0, y0, x1, y1), int(query["width"]))

    async def answered(request: Request) -> Response:
        try:
            return Response(await run_in_threadpool(made, dict(request.query_params)), media_type="image/jpeg")
        except InputError as error:
            return _refusal(error)
        except _STRANGE:
            return Response("not found", 404)
    return answered


def report(folder: Path) -> Callable[[Request], Awaitable[Response]]:
    """report.html of a run, in a sandbox: a page of a stranger's RUN cannot use this server."""
    async def answered(request: Request) -> Response:
        try:
            run = run_folder(folder, request.path_params["name"])
            content = await run_in_threadpool(read_inside, run, "report.html")
        except (InputError, OSError):
            return Response("not found", 404)
        return Response(content, media_type=KINDS[".html"],
                        headers={"Content-Security-Policy": REPORT})
    return answered
