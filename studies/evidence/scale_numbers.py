"""Prints the table of docs/scale.md: seconds of each part of an identification, from rates measured on one core.

python studies/evidence/scale_numbers.py [frames] [Mpx] [nodes] [parameters] [evaluations]
"""

from __future__ import annotations

import heapq
import sys

from idic.identification import choose_sensitivity
from idic.identification import chunk_frames

PIXEL_S = 0.12 / 4e6  # s per pixel and frame: 50 frames of 2000 x 2000 px, 10 parameters, 6 s
INGEST_BYTES_S = 380e6  # bytes/s of uint16 frames into Zarr by one process
READ_BYTES_S = 1e9  # bytes/s for each worker; a file system that gives 1000 of them less is the limit instead
FRAME_S, FRAME_NODES = 3.8 / 26, 3800  # s per frame of a simulation with so many nodes (J2, finite strain, quad8)
GROWTH = 1.2  # exponent of the time of a direct solver in two dimensions over the number of nodes
DIRECT = 0.12  # of a simulation, per directly differentiated parameter
TASK_S = 0.003  # s of the scheduler per task


def schedule(tasks: list[float], workers: int) -> float:
    """Length of list scheduling: every task to the worker that is free first, the scheduler handing out one by one."""
    ready_at, end = [0.0] * workers, 0.0
    for number, seconds in enumerate(tasks):
        start = max(heapq.heappop(ready_at), number * TASK_S)
        heapq.heappush(ready_at, start + seconds)
        end = max(end, start + seconds)
    return end


def parts(frames: int, pixels: float, nodes: int, parameters: int, workers: int) -> dict[str, float]:
    """Seconds: ingestion once; simulation and correlation of one evaluation."""
    simulation = frames * FRAME_S * (nodes / FRAME_NODES) ** GROWTH
    direct = choose_sensitivity("auto", parameters, workers) == "direct"
    runs = [simulation * (1 + DIRECT * parameters)] if direct else [simulation] * (1 + parameters)
    chunk = chunk_frames(frames)
    frame = pixels * PIXEL_S + (2 * pixels + 16 * nodes * parameters) / READ_BYTES_S
    chunks = [min(chunk, frames - first) * frame for first in range(0, frames, chunk)]
    return {
        "ingestion": 2 * pixels * frames / INGEST_BYTES_S,
        "simulation": schedule(runs, workers),
        "correlation": schedule(chunks, workers),
    }


def main(
    frames: int = 10_000, megapixels: float = 25, nodes: int = 20_000, parameters: int = 10, evaluations: int = 8
) -> None:
    out = sys.stdout.write
    out(f"{frames} frames of {megapixels:g} Mpx, {nodes} nodes, {parameters} parameters, {evaluations} evaluations\n")
    out(
        "| workers | ingestion | a simulation with its sensitivities | a correlation | all |\n"
        "| --- | --- | --- | --- | --- |\n"
    )
    for workers in (1, 10, 100, 1000):
        durations = parts(frames, megapixels * 1e6, nodes, parameters, workers)
        total = durations["ingestion"] + evaluations * (durations["simulation"] + durations["correlation"])
        row = (durations["ingestion"], durations["simulation"], durations["correlation"], total)
        out(f"| {workers} | " + " | ".join(f"{seconds / 3600:.2f} h" for seconds in row) + " |\n")


if __name__ == "__main__":
    main(*(type_(word) for type_, word in zip((int, float, int, int, int), sys.argv[1:], strict=False)))
