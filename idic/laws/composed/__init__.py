"""One elastoplastic law composed of terms: yield surface, hardening, back stresses, rate and damage."""
