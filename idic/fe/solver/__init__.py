"""Linear systems of the free degrees of freedom: numbering, factorisation, solution."""
