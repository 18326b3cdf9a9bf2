"""What the terminal shows of a result, a planned test and a diagnosis: sentences and tables without a layout."""
