"""Virtual tests with perspective cameras: rays traced to deformed surfaces, a speckle in space, the example
`stereo`."""
