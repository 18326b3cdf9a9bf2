"""Register idic's flows with a Prefect server: deployments `idic` of a work pool, run by `prefect worker start`.

    PREFECT_API_URL=http://127.0.0.1:4200/api python deploy/prefect_deploy.py [POOL]

The pool (default "idic", type process) is made where it is not there yet. A deployment names a function of the
installed package; the worker needs the same idic, and nothing else.
"""

from __future__ import annotations

import sys

from prefect.client.orchestration import get_client
from prefect.client.schemas.actions import WorkPoolCreate
from prefect.exceptions import ObjectAlreadyExists
from prefect.flows import EntrypointType

from idic_flows.deployed import batch, identify

NAME = "idic"


def main(pool: str = "idic") -> None:
    """Make the pool and both deployments, or bring them up to date."""
    with get_client(sync_client=True) as client:
        try:
            client.create_work_pool(WorkPoolCreate(name=pool, type="process"))
        except ObjectAlreadyExists:
            pass
    for flow in (identify, batch):
        deployment = flow.to_deployment(NAME, work_pool_name=pool, entrypoint_type=EntrypointType.MODULE_PATH,
                                        concurrency_limit=None)
        deployment.apply()
        print(f"{flow.name}/{NAME} in pool {pool}")


if __name__ == "__main__":
    main(*sys.argv[1:])
