"""Statistics of a few seeds: robust means, their intervals, profiles, comparisons and verdicts; pure NumPy and SciPy.

After Agarwal, Schwarzer, Castro, Courville, Bellemare (2021), *Deep reinforcement learning at the edge of the
statistical precipice*, NeurIPS 34, "Agarwal et al." below; their library is rliable.

Scores are arrays (..., n, m): n runs (seeds) on m domains, leading axes being different figures of the same runs. The
unit is the run: one policy gives all m scores of a row, so that rows are drawn whole. A domain counts as often as any
other.

The same as rliable 1.2: the interquartile mean (where 4 divides the number of scores; elsewhere rliable, by
``scipy.stats.trim_mean``, cuts off less than a quarter), the score distribution, the probability of improvement, and
sample efficiency as the interquartile mean at each step. Not the same: the intervals. rliable draws the runs of each
domain apart and takes percentiles, which for five runs on five domains covers far less than it says.
"""
