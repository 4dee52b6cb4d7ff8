"""The commands by topic; each module offers a table from the two letters to a handler."""
