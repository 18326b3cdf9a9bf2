"""Assessment of a fit beyond the mean of χ²: local tests of the residual, remedies for light and
aliasing."""
