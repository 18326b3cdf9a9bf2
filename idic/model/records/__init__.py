"""What an experiment consists of: recording, model, options; records without behaviour of their own."""
