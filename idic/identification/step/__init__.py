"""Step control of the identification, its choice of the estimator, and the covariance of the parameters."""
