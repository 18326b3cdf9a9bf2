"""What changes a reading between specimen and log, one file each."""
