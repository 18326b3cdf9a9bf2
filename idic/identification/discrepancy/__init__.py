"""Model discrepancy (Kennedy and O'Hagan): random errors of motion, stress and channels that widen the error
bars."""
