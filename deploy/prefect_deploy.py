"""Register idic's flows with a Prefect server: deployments `idic` of a work pool, run by `prefect worker start`.

    PREFECT_API_URL=http://127.0.0.1:4200/api python deploy/prefect_deploy.py [POOL] [--at-a-time N]

The pool (default "idic", type process) is made where it is not there yet. A deployment names a function of the
installed package; the worker needs the same idic, and nothing else. With N, at most so many runs of a deployment go on
at a time; further ones wait.
"""

from __future__ import annotations

import argparse
from contextlib import suppress

from prefect.client.orchestration import get_client
from prefect.client.schemas.actions import WorkPoolCreate
from prefect.exceptions import ObjectAlreadyExists
from prefect.flows import EntrypointType

from idic_flows.deployed import FLOWS

NAME = "idic"


def main(pool: str, at_a_time: int | None) -> None:
    """Make the pool and the deployments, or bring them up to date."""
    with get_client(sync_client=True) as client:
        with suppress(ObjectAlreadyExists):
            client.create_work_pool(WorkPoolCreate(name=pool, type="process"))
    for flow in FLOWS:
        deployment = flow.to_deployment(NAME, work_pool_name=pool, entrypoint_type=EntrypointType.MODULE_PATH,
                                        concurrency_limit=at_a_time)
        deployment.apply()
        print(f"{flow.name}/{NAME} in pool {pool}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pool", nargs="?", default="idic")
    parser.add_argument("--at-a-time", type=int, metavar="N")
    main(**vars(parser.parse_args()))
