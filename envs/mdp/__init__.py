"""The MDP: front, observation, action, reward, and the one step function of all episodes (paper, section 3)."""
