"""How a virtual camera finds what it sees: points of the deformed body by pixel."""
