"""A study's report: the paper's figure and table out of its runs, with intervals.

results (what lies on disk) -> learning, transfer (figures of every variant) -> comparisons -> tables, pictures, text
"""
