"""What the files of a RUN hold, by name and type, a module for each kind of file."""
