"""The shipped policies, what a policy is, and how good one is."""
