"""The fields section of the report: a viewer that draws from numbers in the page, and the tables of the gauges."""
