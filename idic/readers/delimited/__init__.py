"""Text of tables as instruments and spreadsheets write it: encodings, layout, numbers and units."""
