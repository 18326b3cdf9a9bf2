"""Free curves of a law: choice of the number of knots by Bayesian evidence."""
