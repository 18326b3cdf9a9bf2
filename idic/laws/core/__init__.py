"""Common parts of all laws: declaration and registry, compilation, loops over points, tensor algebra."""
