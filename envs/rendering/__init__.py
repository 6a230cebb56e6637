"""Pictures of an episode, as ``render`` of the environments gives them, and the window that shows them."""

from envs.rendering import quiet_matplotlib as quiet_matplotlib
