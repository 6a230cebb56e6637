"""Files that appear whole or not at all, and archives of arrays that are read without pickle."""
