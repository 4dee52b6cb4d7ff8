"""What was measured and what the tool removes: maps, influence functions, levelling, one reader per file format."""
