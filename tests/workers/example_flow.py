"""The smallest flow of the kind that idic runs: a Prefect task per stage, a TaskRunner inside."""

from cluster_jobs import square
from prefect import flow, task

from idic.run import SerialRunner


@task(task_run_name="simulate it{iteration:03d}")
def simulate(runner, iteration, jobs):
    return runner.map(square, jobs, [f"simulate-it{iteration:03d}-{job}" for job in jobs])


@task(task_run_name="frames it{iteration:03d}")
def frames(runner, iteration, results):
    return list(runner.stream(abs, results, [f"frames-it{iteration:03d}-{k}" for k in range(len(results))]))


@task(task_run_name="step it{iteration:03d}")
def step(iteration, shares):
    return sorted(shares)


@flow(name="example")
def example(jobs):
    runner = SerialRunner()
    return step(0, frames(runner, 0, simulate(runner, 0, jobs)))
