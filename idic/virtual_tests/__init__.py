"""Virtual experiments: renderer, built-in examples, `idic simulate`."""
