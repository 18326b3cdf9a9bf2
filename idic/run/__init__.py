"""What a command does, from the experiment to the RUN folder. No equation and no threshold lives here."""
