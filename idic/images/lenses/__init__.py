"""Lens models, one file each: the distortion between a central projection and the sensor."""
