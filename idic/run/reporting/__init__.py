"""Pages and files made from a RUN folder: report, comparison, check, ParaView files."""
