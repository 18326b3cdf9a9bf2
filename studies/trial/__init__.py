"""The blind trial of the diagnosis: virtual tests with sealed truths, a tool without access to them, an evaluation."""
