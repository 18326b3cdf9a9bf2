"""What all laws share: declaration and registry, compilation, loops over points, tensor algebra."""
