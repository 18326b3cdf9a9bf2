"""What a report shows, computed from an experiment and its result: law curves, free fields, noise floors."""
