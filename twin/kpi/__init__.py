"""Key performance indicators, row by row, and the verdict of a case."""
