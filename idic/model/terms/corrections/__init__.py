"""What the log of a grip lacks, one file each."""
