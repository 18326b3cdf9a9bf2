"""Step control of the identification: proposal, trust radius, acceptance, schedule, choice of the estimator."""
