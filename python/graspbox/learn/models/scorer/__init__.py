"""The scorer: the probability that a grasp holds."""
