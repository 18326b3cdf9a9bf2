from .batch.identify import identify_batch
from .batch.starts import batch_runs
from .calibration.run import CalibrationRun, run_calibration
from .design import PAGE_FILE, write_design
from .diagnosis.crack import cracks_content
from .diagnosis.diagnose import diagnose_run
from .diagnosis.refits import run_refits
from .diagnosis.source import open_source
from .fields import Fields, FieldsOfRun, checked_frame
from .identify import identify_run
from .judgement.residual_maps import residuals_of
from .memory import identify_in_memory
from .orchestrator import Command, Console, DIRECT, Hooks, Orchestrator
from .points import RunPoints
from .prepared.context import open_run
from .prepared.in_memory import prepare_in_memory
from .prepared.tasks import CorrelationJob, SimulationJob
from .reporting.accepted_residual import accepted_residual
from .reporting.compare import compare_runs, write_comparison
from .reporting.export import export_fields
from .reporting.law_files import export_laws
from .reporting.second_process import SecondProcess, drawing_beside
from .reporting.write import write_report
from .runs import Folders
from .store.arrays import FrameArrays, read_array, write_array
from .store.clean import clean_run
from .store.layout import BASE, FROM_PYTHON, group_name
from .store.result_file import RESULT_FILE, read_result, write_json
from .store.run_folders import folders_of
from .store.run_lock import is_held, process_lives, run_lock, this_process
from .store.run_store import RunStore
from .store.stack import ZarrStack
from .store.state_file import STATE_FILE
from .systematic_run import systematic
from .warm_up import import_meanwhile
from .workers.dask_executor import check_scheduler, checked_memory_limit, open_cluster
from .workers.dask_settings import cpu_seconds, use_one_thread
from .workers.mirrored_runner import refuse_store
from .workers.peak_memory import peak_memory_mb
from .workers.precompiling import compiling_meanwhile
from .workers.prefect_server import PASSWORD, PrefectServer, configured_url
from .workers.runner import SerialRunner, TaskRunner
from .workers.working_folder import empty_folder, in_empty_folder
from .workers.workplace import Workplace

__all__ = [
    "BASE", "DIRECT", "FROM_PYTHON", "PAGE_FILE", "PASSWORD", "RESULT_FILE", "STATE_FILE", "CalibrationRun", "Command",
    "Console", "CorrelationJob", "Fields", "FieldsOfRun", "Folders", "FrameArrays", "Hooks", "Orchestrator",
    "PrefectServer", "RunPoints", "RunStore", "SecondProcess", "SerialRunner", "SimulationJob", "TaskRunner",
    "Workplace", "ZarrStack", "accepted_residual", "batch_runs", "check_scheduler", "checked_frame",
    "checked_memory_limit", "clean_run", "compare_runs", "compiling_meanwhile", "configured_url", "cpu_seconds",
    "cracks_content", "diagnose_run", "drawing_beside", "empty_folder", "export_fields", "export_laws", "folders_of",
    "group_name", "identify_batch", "identify_in_memory", "identify_run", "import_meanwhile", "in_empty_folder",
    "is_held", "open_cluster", "open_run", "open_source", "peak_memory_mb", "prepare_in_memory", "process_lives",
    "read_array", "read_result", "refuse_store", "residuals_of", "run_calibration", "run_lock", "run_refits",
    "systematic", "this_process", "use_one_thread", "write_array", "write_comparison", "write_design", "write_json",
    "write_report",
]
