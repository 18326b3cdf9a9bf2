"""The modelled experiment: recording, mesh, drives, loads and laws in records, and the forward model made of them."""
