"""The result that is reported: its record, its numbers in words, its stresses where no force was measured."""
