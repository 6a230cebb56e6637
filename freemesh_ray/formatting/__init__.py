"""Tables and figures as text."""
