"""Which faults the tests see: small changes of the product, each with the test files that should notice it."""
