"""Whether a finer mesh makes a solved problem more accurate: problems with known solutions, solved by scikit-fem."""
