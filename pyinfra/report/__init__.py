"""The report: one page that opens from disk, with the tables it was made from beside it."""
