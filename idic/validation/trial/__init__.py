"""The blind trial of the diagnosis: virtual tests with sealed truths, a tool that sees none of them, a judge."""
