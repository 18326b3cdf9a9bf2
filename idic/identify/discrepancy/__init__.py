"""What the model leaves unexplained, as a random discrepancy of motion, stress and channels that widens the error
bars."""
