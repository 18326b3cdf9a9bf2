"""How idic is examined: studies with known truth, the blind trial, and their pages. The product does not import it."""
