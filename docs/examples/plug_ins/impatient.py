"""A wrapper: every invalid action in a row costs more than the one before.

env:
  wrappers: [impatient:Impatient]
"""

import gymnasium as gym


class Impatient(gym.Wrapper):
    def reset(self, **options):
        self.in_a_row = 0
        return self.env.reset(**options)

    def step(self, action):
        observation, reward, terminated, truncated, info = self.env.step(action)
        self.in_a_row = self.in_a_row + 1 if info["rejection"] else 0
        return observation, reward - 0.05 * max(0, self.in_a_row - 1), terminated, truncated, info
