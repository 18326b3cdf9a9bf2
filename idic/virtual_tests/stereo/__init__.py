"""Virtual tests before cameras with a lens: rays against deformed surfaces, a speckle in space, the example
`stereo`."""
