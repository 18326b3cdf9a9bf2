"""`idic diagnose`: the chain of a diagnosis on a RUN folder, and the files it leaves."""
