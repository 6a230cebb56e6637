"""The learning algorithms, as RLlib algorithms on one interface."""
