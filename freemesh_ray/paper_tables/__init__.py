"""The paper's tables, measured anew and set beside the printed figures."""
