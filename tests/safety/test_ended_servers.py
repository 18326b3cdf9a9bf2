"""SIGTERM ends the server of `idic draw`, also while it computes a mesh, which cannot be interrupted."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
import urllib.request
from contextlib import suppress
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "draw"))

from drawn_folder import make_folder, plan  # noqa: E402

SMALLEST_PX = 0.6  # 41 000 elements: the mesher computes for longer than any grace
LONG_S = 120  # of a busy machine; a computation is waited for some seconds


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_a_long_computation_does_not_keep_the_server(tmp_path):
    folder = make_folder(tmp_path / "test")
    command = [sys.executable, "-c", "from idic.cli import main; main()", "draw", str(folder), "--no-browser"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert server.stdout is not None
    address = re.search(r"http://\S+", server.stdout.readline())[0]
    answers: list[int] = []
    asking = threading.Thread(target=_ask_for_a_mesh, args=(address, answers), daemon=True)
    asking.start()
    time.sleep(1.0)
    server.send_signal(signal.SIGTERM)
    _, said = server.communicate(timeout=LONG_S)
    assert server.returncode == 4 and said == "idic: interrupted\n"
    assert answers == [], "the mesh was ready: the test showed nothing"


def _ask_for_a_mesh(address, answers):
    body = json.dumps({"sketch": plan()["sketch"] | {"element_px": SMALLEST_PX}, "images": "images/*.tif"}).encode()
    request = urllib.request.Request(f"{address}api/mesh", body, {
        "content-type": "application/json", "origin": re.match(r"http://[^/]+", address)[0]})
    with suppress(OSError):
        answers.append(urllib.request.urlopen(request, timeout=LONG_S).status)
