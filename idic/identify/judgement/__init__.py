"""What an identification is judged by besides the mean of χ²: local tests of the residual, remedies for light and
aliasing."""
