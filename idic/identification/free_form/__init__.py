"""Free functions of a law: choice of the number of knots by Bayesian evidence."""
