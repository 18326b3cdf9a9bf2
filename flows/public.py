"""``idic.flow``: the flows as functions of Python, for scripts and for flows of your own.

A call inside a flow run is a sub-flow on the same server::

    import idic
    from prefect import flow

    @flow
    def overnight(folders: list[str]):
        return [idic.flow.identify([folder], folder + "/run")["status"] for folder in folders]

Outside of one, a Prefect server is started for the call unless PREFECT_API_URL names one. Importing this starts
nothing.
"""

from idic_flows.batch import run_batch as batch
from idic_flows.diagnose import run_diagnosis as diagnose
from idic_flows.identify import run_identification as identify
from idic_flows.systematic import run_systematic as systematic

__all__ = ["batch", "diagnose", "identify", "systematic"]
