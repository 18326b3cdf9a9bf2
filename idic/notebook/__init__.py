"""idic from Python: an experiment from arrays, its identification in memory or in a RUN, tables and pictures of the
result."""
