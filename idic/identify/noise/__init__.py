"""Noise that is not independent from frame to frame, found in what an identification leaves of the channels."""
