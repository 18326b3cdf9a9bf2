"""Matches between images of a surface that moved far or turned, and the motion of a mesh that they agree on."""
