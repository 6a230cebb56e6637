"""A study's report: its figure and tables out of its runs, with intervals.

results (what lies on disk) -> variants, transfer (figures of each) -> comparisons -> csv_files, pictures, sections
"""

#: Episodes of every policy on every domain, as in the paper.
EPISODES = 10
