"""A RUN folder and its experiments on workers that do not see the disk of the driver.

The driver keeps the RUN. It lists what it holds (`manifest`), puts files under the name of their content (`objects`)
and writes what the workers made into the RUN (`adopt`); a worker has local folders that follow the manifest (`mirror`).
"""
