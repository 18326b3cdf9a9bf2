"""From a RUN folder to what a person looks at: report, comparison, check, ParaView files."""
