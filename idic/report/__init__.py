"""Reports: HTML pages, tables and sentences made from the records of a result."""
