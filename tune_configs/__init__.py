"""The study and training configurations that ship with the package, as YAML beside this file."""
