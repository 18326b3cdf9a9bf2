"""What sees a specimen: a telecentric camera, a camera with a lens, a scanner."""

from __future__ import annotations

from idic.images.camera import Camera
from idic.images.placed_camera import PlacedCamera
from idic.images.volumes.scanner import Scanner

AnyCamera = Camera | PlacedCamera | Scanner
