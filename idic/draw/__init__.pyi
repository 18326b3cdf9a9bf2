from .folder import list_folder
from .server import HOST, new_token, open_socket, serve
from .speckle_area import speckled_area
from .texture import texture_of

__all__ = [
    "HOST", "list_folder", "new_token", "open_socket", "serve", "speckled_area", "texture_of",
]
