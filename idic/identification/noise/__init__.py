"""Noise of cameras and channels: from the recording, and from the residuals of an identification."""
