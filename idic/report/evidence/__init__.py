"""The data of a report, computed from an experiment and its result: law curves, free fields, noise floors."""
