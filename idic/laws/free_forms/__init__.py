"""Free functions of a law outside of the compiled code: their bases, stated smoothness and classical forms."""
