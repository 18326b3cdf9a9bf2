"""Where and when the mismatch acts, and on which side: specimen, boundary, camera or force."""
