"""Statistics of a few seeds: robust means, their intervals, profiles and comparisons; pure NumPy and SciPy.

After Agarwal, Schwarzer, Castro, Courville, Bellemare (2021), *Deep reinforcement learning at the edge of the
statistical precipice*, NeurIPS 34, "Agarwal et al." below.

Scores are arrays (..., n, m): n runs (seeds) in each of m strata (domains), leading axes being different figures of the
same runs. Runs are drawn anew within their stratum, so that a hard domain stays as frequent as it is.
"""
