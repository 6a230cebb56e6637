"""The ``freemesh`` command: parse, call, print."""
